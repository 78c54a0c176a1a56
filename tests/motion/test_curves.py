"""Tables and arrays of curves."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import bayesmotion as bm


def long_table():
    rows = [
        {"subject": subject, "condition": condition, "stride": stride, "phase": phase,
         "value": 10.0 * stride + phase, "speed": 1.0 + stride}
        for subject in ("01", "02") for condition in ("slow", "fast") for stride in range(3)
        for phase in (0.0, 50.0, 100.0)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_a_table_of_points_is_strides_with_labels(tmp_path):
    table = long_table().sample(frac=1.0, random_state=0)
    table.to_csv(tmp_path / "knee.csv", index=False)
    for source in (table, tmp_path / "knee.csv"):
        curves = bm.read_curves(source)
        assert dict(curves.sizes) == {"stride": 12, "phase": 3}
        assert set(curves["subject"].values) == {"01", "02"}
        np.testing.assert_array_equal(curves.values, 10.0 * (curves["speed"].values - 1)[:, None]
                                      + np.array([0.0, 50.0, 100.0]))  # fmt: skip


def test_points_at_other_phases_are_brought_to_the_same():
    table = long_table()
    table.loc[1, "phase"] = 40.0
    table.loc[1, "value"] = 40.0
    curves = bm.read_curves(table)
    assert curves.sizes["phase"] == 101
    np.testing.assert_allclose(curves.values[0], np.arange(101.0))
    assert bm.read_curves(long_table(), points=5)["phase"].values.tolist() == [0, 25, 50, 75, 100]


def test_a_table_of_curves_is_read(tmp_path):
    wide = pd.DataFrame(np.arange(9.0).reshape(3, 3), columns=["100", "0", "50"])
    wide.insert(0, "subject", ["a", "b", "c"])
    wide.to_csv(tmp_path / "wide.csv", index=False)
    curves = bm.read_curves(tmp_path / "wide.csv", value="knee")
    assert curves.name == "knee"
    assert curves["phase"].values.tolist() == [0.0, 50.0, 100.0]
    assert curves.values[0].tolist() == [1.0, 2.0, 0.0]


def test_an_array_of_people_and_conditions_leaves_out_what_is_missing():
    values = np.arange(24.0).reshape(2, 3, 4)
    values[1, 2] = np.nan
    array = xr.DataArray(
        values, dims=("subject", "stride", "time"),
        coords={"subject": ["ann", "ben"], "time": [0.0, 0.1, 0.2, 0.3]},
    )  # fmt: skip
    curves = bm.read_curves(array)
    assert curves["subject"].values.tolist() == ["ann"] * 3 + ["ben"] * 2
    assert curves.dims == ("stride", "time")
    np.testing.assert_array_equal(curves.values, values.reshape(6, 4)[:5])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda t: t.drop(columns="phase"), "Name the value's"),
        (lambda t: t.drop(columns="stride"), "stands twice"),
        (lambda t: t.assign(speed=range(len(t))), "speed changes within the stride"),
        (lambda t: t.assign(value="x"), "is not of numbers"),
        (lambda t: t.assign(value=np.nan), "it has no curve"),
    ],
)
def test_what_is_no_table_of_curves_is_refused(change, told):
    with pytest.raises(bm.InputError, match=told):
        bm.read_curves(change(long_table()))


def test_arrays_without_people_are_refused():
    with pytest.raises(bm.InputError, match="whose the strides are"):
        bm.read_curves(np.ones((2, 5)))
    with pytest.raises(bm.InputError, match="3 values for 2 strides"):
        bm.read_curves(np.ones((2, 5)), labels={"subject": [1, 2, 3]})


def test_strides_of_recordings_are_curves_of_their_angles():
    people = ("ann", "ben", "cas", "dee")
    walks = bm.synthetic_walkers(people, ("walk", "stride"), seconds=4.0, noise=0.0)
    curves = bm.curves_of(walks, points=51)
    knee, hip = curves["left knee flexion"], curves["left hip flexion"]
    assert set(knee["gait"].values) == {"walk", "stride"}
    assert knee["phase"].values[[0, -1]].tolist() == [0.0, 100.0]
    for clip in set(knee["clip"].values):
        same = hip.values[knee["clip"].values == clip]
        np.testing.assert_allclose(same - same.mean(axis=0), 0.0, atol=2.5)
    # Noise-free cycles end as they began, at a heel strike: the thigh is ahead.
    np.testing.assert_allclose(hip[:, 0], hip[:, -1], atol=2.5)
    assert np.all(hip[:, 0] > hip.mean("phase"))
    assert np.all((knee["seconds"] > 0.7) & (knee["seconds"] < 1.8))
    with pytest.warns(bm.MotionWarning, match="hardly known"):
        found = bm.contrast(hip, {"gait": "stride"}, {"gait": "walk"}, draws=200)
    truth = {
        (person, gait): hip.values[(hip["subject"] == person) & (hip["gait"] == gait)].mean(axis=0)
        for person in people for gait in ("walk", "stride")
    }  # fmt: skip
    longer = np.mean([truth[p, "stride"] - truth[p, "walk"] for p in people], axis=0)
    np.testing.assert_allclose(found.mean, longer, atol=1.0)


def test_recordings_without_strides_are_refused():
    still = bm.synthetic_walkers(("ann",), ("walk",), seconds=0.5)
    with pytest.raises(bm.InputError, match="straight gait cycle"):
        bm.curves_of(still)
