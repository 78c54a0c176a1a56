"""Conditions compared over people: pairs, groups, strides, covariates, and from file to file."""

import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import bayesmotion as bm
from bayesmotion.cli import app

A, B = {"condition": "a"}, {"condition": "b"}
T = np.linspace(0.0, 100.0, 51)
BUMP = 3.0 * np.exp(-0.5 * ((T - 40.0) / 10.0) ** 2)


def strides(people=8, each=(5,), seed=0, paired=True, bump=BUMP):
    """Rows of labels, and curves; people differ by 1, strides by 1."""
    random, rows, curves = np.random.default_rng(seed), [], []

    def field():
        return random.normal(size=4) @ np.stack([np.cos(k * np.pi * T / 100.0) for k in range(4)])

    for number in range(people):
        common = 2.0 * field()
        for side in "ab" if paired else "ab"[number % 2]:
            own = common * paired + 0.5 * field()
            for _ in range(each[number % len(each)]):
                rows.append((f"p{number:02}", side))
                curves.append(own + 0.5 * field() + bump * (side == "a"))
    subject, condition = zip(*rows, strict=True)
    return bm.read_curves(
        np.array(curves), labels={"subject": list(subject), "condition": list(condition)}
    )


@pytest.mark.parametrize("paired", [True, False])
def test_a_difference_is_found_where_it_is(paired):
    curves = strides(16, paired=paired)
    found = bm.contrast(curves, A, B, rope=0.5, draws=2000)
    assert found.design.paired == paired
    low, high = found.band()
    assert np.all((low < BUMP) & (high > BUMP))
    inner = found.interval()
    assert np.all((low < inner[0]) & (inner[1] < high))
    [region] = found.regions()
    assert 20.0 < region.start < 40.0 < region.end < 60.0
    assert region.sign == 1
    assert region.probability > 0.95
    assert found.positive[20] > 0.999
    assert found.beyond[20] > 0.999
    table = found.to_dataset()
    np.testing.assert_array_equal(table["band_low"], low)
    back = bm.contrast(curves, B, A, draws=200)
    np.testing.assert_allclose(back.mean, -found.mean, atol=1e-9)


def test_strides_do_not_stand_for_people():
    curves = strides(6, (4,))
    found = bm.contrast(curves, A, B, draws=500)
    count = curves.sizes["stride"]
    again = curves.isel(stride=np.tile(np.arange(count), 3))
    assert np.all(bm.contrast(again, A, B, draws=500).sd > 0.75 * found.sd)
    # A control: were each stride a person, the difference would seem known far better.
    own = [f"{name}, {n % 4} {n // count}" for n, name in enumerate(again["subject"].values)]
    alone = bm.contrast(again.assign_coords(subject=("stride", own)), A, B, draws=200)
    assert alone.design.paired
    assert np.all(alone.sd < 0.6 * found.sd)


def test_who_was_seen_in_one_condition_alone_is_left_out_and_named():
    curves = strides(7)
    lone = (curves["subject"] == "p03") & (curves["condition"] == "b")
    with pytest.warns(bm.MotionWarning, match="p03 were seen in one"):
        found = bm.contrast(curves.isel(stride=~lone.values), A, B, draws=50)
    assert found.design.names == ("p00", "p01", "p02", "p04", "p05", "p06")


def test_phases_of_strides_may_be_missing():
    curves = strides(8, (3,)).copy()
    whole = bm.contrast(curves, A, B, draws=200)
    curves.values[::3, 10:30] = np.nan
    found = bm.contrast(curves, A, B, draws=200)
    np.testing.assert_allclose(found.mean[:10], whole.mean[:10], rtol=1e-9)
    assert np.mean(found.sd[10:30] / whole.sd[10:30]) > 1.0
    curves.values[curves["subject"].values == "p00", 40:] = np.nan
    assert np.isfinite(bm.contrast(curves, A, B, draws=50).band()[0]).all()


def test_at_the_same_speed_there_is_no_difference_that_speed_made():
    curves = strides(12, (4,), bump=0.0 * BUMP)
    random = np.random.default_rng(1)
    person = curves["subject"].values
    own = {name: random.normal() for name in person}
    speed = 0.5 * (curves["condition"].values == "a") * np.array([1.0 + own[p] for p in person])
    curves = (curves + 6.0 * speed[:, None]).assign_coords(speed=("stride", speed))
    assert bm.contrast(curves, A, B, draws=500).mean.min() > 1.2
    found = bm.contrast(curves, A, B, covariates=["speed"], draws=500)
    assert np.abs(found.mean).max() < 1.0
    assert not found.regions()


def test_regions_go_round_a_cycle():
    bump = 3.0 * np.cos(np.pi * T / 100.0) ** 4
    found = bm.contrast(strides(10, bump=bump), A, B, periodic=True, draws=1000)
    [region] = found.regions()
    assert region.start > 60.0
    assert region.end < 40.0
    assert len(bm.contrast(strides(10, bump=bump), A, B, draws=1000).regions()) == 2
    assert found.plot() is not None


def test_practical_equivalence_is_told():
    found = bm.contrast(strides(30, (20,), bump=0.0 * BUMP), A, B, rope=3.0, draws=500)
    [region] = found.equivalent()
    assert (region.start, region.end, region.sign) == (0.0, 100.0, 0)
    assert not found.regions()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (({"condition": "z"}, B), "no stride is of it"),
        (({"gait": "a"}, B), "the strides have none"),
        ((A, A), "strides in common"),
        (({}, B), "it is empty"),
    ],
)
def test_conditions_that_are_none_are_refused(arguments, told):
    with pytest.raises(bm.InputError, match=told):
        bm.contrast(strides(4, (1,)), *arguments)


def test_covariates_that_are_no_numbers_are_refused():
    curves = strides(5, (1,))
    with pytest.raises(bm.InputError, match="not all strides have a number"):
        bm.contrast(curves, A, B, covariates=["subject"])
    speed = np.r_[np.nan, np.ones(curves.sizes["stride"] - 1)]
    with pytest.raises(bm.InputError, match="not all strides have a number"):
        bm.contrast(curves.assign_coords(speed=("stride", speed)), A, B, covariates=["speed"])


def test_too_few_people_are_refused():
    with pytest.raises(bm.InputError, match="3 people in both"):
        bm.contrast(strides(2), A, B)
    with pytest.raises(bm.InputError, match="2 people in each"):
        bm.contrast(strides(3, paired=False), A, B)
    with pytest.warns(bm.MotionWarning, match="hardly known"):
        bm.contrast(strides(3), A, B, draws=50)


def test_the_command_compares_a_file(tmp_path):
    curves = strides(8, (2,))
    table = pd.DataFrame(curves.values, columns=T)
    table.insert(0, "subject", curves["subject"].values)
    table.insert(1, "condition", curves["condition"].values)
    table.to_csv(tmp_path / "knee.csv", index=False)
    files = [tmp_path / name for name in ("out.csv", "out.json", "out.png")]
    told = CliRunner().invoke(app, [
        "contrast", str(tmp_path / "knee.csv"), "--first", "condition=a", "--second",
        "condition=b", "--out", str(files[0]), "--json", str(files[1]), "--plot", str(files[2]),
    ])  # fmt: skip
    assert told.exit_code == 0, told.output
    assert "more from phase" in told.stdout
    assert json.loads(files[1].read_text())["regions"][0]["sign"] == 1
    back = pd.read_csv(files[0])
    found = bm.contrast(curves, A, B)
    np.testing.assert_allclose(back["band_low"], found.band()[0], rtol=1e-4, atol=1e-5)
    assert files[2].stat().st_size > 1000


def test_power_is_what_contrasts_find():
    pilot = bm.contrast(strides(14, (6,), seed=1), A, B, draws=500)
    found = bm.power(pilot, BUMP / 3.0, people=[4, 10], strides=6, simulations=25, seed=1)
    assert found.found[0] + found.error[0] < found.found[1]
    assert found.width[0] > 1.5 * found.width[1]
    hits = []
    for seed in range(25):
        tried = bm.contrast(strides(10, (6,), seed=100 + seed, bump=BUMP / 3.0), A, B, draws=500)
        hits.append(tried.regions() != ())
    error = np.hypot(found.error[1], np.std(hits) / np.sqrt(25))
    assert abs(found.found[1] - np.mean(hits)) < 3.0 * error + 0.1
    fewer = bm.power(pilot, BUMP / 3.0, people=[10], strides=1, simulations=6, seed=1)
    assert fewer.width[0] > 1.1 * found.width[1]
    assert found.enough(2.0) is None
    with pytest.raises(bm.InputError, match="nowhere more"):
        bm.power(pilot, 0.0)


def test_power_of_groups_knows_the_strides_of_each():
    pilot = bm.contrast(strides(16, (6,), paired=False), A, B, draws=200)
    found = bm.power(pilot, 100.0, people=[6], strides=3, simulations=2)
    assert found.found.tolist() == [1.0]
    assert found.enough() == 6
    assert "6 people: 100 %" in repr(found)
