"""Gaps of recordings of markers, from file to file."""

import json

import ezc3d
import numpy as np
import pytest
from typer.testing import CliRunner

import bayesmotion as bm
from bayesmotion.cli import app
from bayesmotion.motion import make_markers

NAMES = ["C7", "LASI", "RASI", "LKNE", "RKNE"]


@pytest.fixture(scope="module")
def markers():
    walk = bm.split(bm.synthetic_walkers(("ann",), ("walk",), seconds=6.0))["ann-walk"]
    from bayesmotion.motion import positions

    where = positions(walk).sel(joint=["head", "lfemur", "rfemur", "ltibia", "rtibia"]).values
    return make_markers(NAMES, 1000.0 * where, frame_rate=30.0, clip="walk", metres=0.001)


def cut(markers, *gaps):
    values = markers["position"].values.copy()
    for frames, name in gaps:
        values[frames, NAMES.index(name)] = np.nan
    return markers.assign(position=(markers["position"].dims, values))


def test_what_was_seen_stays_and_gaps_are_filled(markers):
    given = cut(markers, (slice(60, 90), "LKNE"), (slice(0, 9), "C7"))
    filled = bm.fill_gaps(given)
    assert int(filled.filled.sum()) == 39
    whole, true = filled.motion["position"].values, markers["position"].values
    np.testing.assert_array_equal(whole[~filled.filled], true[~filled.filled])
    away = np.linalg.norm(whole - true, axis=-1)[60:90, NAMES.index("LKNE")]
    line = np.linspace(true[59, 3], true[90, 3], 32)[1:-1]
    assert away.mean() < 0.5 * np.linalg.norm(line - true[60:90, 3], axis=-1).mean()
    low, high = filled.interval(0.9)
    assert (high - low)[60:90, 3].min() > 0.0
    assert (high - low)[~filled.filled].max() == 0.0
    table = filled.to_dataset()
    assert table["unit"].values.tolist() == ["mm"] * 15
    np.testing.assert_allclose(table["mean"], whole.reshape(len(whole), -1))
    np.testing.assert_array_equal(table["given"].sel(channel="LKNE/x"), ~filled.filled[:, 3])


def test_markers_that_were_never_seen_stay_missing_and_are_told(markers):
    given = cut(markers, (slice(None), "RKNE"), (slice(5, 9), "C7"))
    with pytest.warns(bm.MotionWarning, match="RKNE is nowhere seen"):
        filled = bm.fill_gaps(given)
    assert np.isnan(filled.motion["position"].sel(joint="RKNE")).all()
    assert np.isfinite(filled.motion["position"].sel(joint="C7")).all()


def test_joint_angles_are_told_the_way():
    _, walks = bm.example("multifactor")
    with pytest.raises(bm.InputError, match="noise_degrees=0"):
        bm.fill_gaps(next(iter(bm.split(walks).values())))


def test_c3d_files_are_written_and_read_alike_by_others(markers, tmp_path):
    given = cut(markers, (slice(60, 90), "LKNE"))
    bm.write(given, tmp_path / "given.c3d")
    back = bm.read(tmp_path / "given.c3d")
    np.testing.assert_allclose(back["position"], given["position"], rtol=1e-6)
    assert (back.attrs["frame_rate"], back.attrs["metres"]) == (30.0, 0.001)
    theirs = ezc3d.c3d(str(tmp_path / "given.c3d"))
    assert theirs["parameters"]["POINT"]["LABELS"]["value"] == NAMES
    points = theirs["data"]["points"][:3].transpose(2, 1, 0)
    np.testing.assert_array_equal(points, back["position"].values)


def test_long_recordings_of_many_markers_are_written(tmp_path):
    names = [f"M{number:03}" for number in range(300)]
    position = np.arange(70_000 * 300, dtype=np.float32).reshape(70_000, 300, 1) % 97.0
    many = make_markers(
        names, np.repeat(position[:8], 3, axis=2), frame_rate=100.0, clip="x", metres=1.0
    )
    long = make_markers(
        names[:1], np.repeat(position[:, :1], 3, axis=2), frame_rate=100.0, clip="x", metres=1.0
    )
    for motion in (many, long):
        bm.write(motion, tmp_path / "x.c3d")
        back = bm.read(tmp_path / "x.c3d")
        assert back["joint"].values.tolist() == motion["joint"].values.tolist()
        # A point at the origin with a residual of zero is how many programs write a gap.
        seen = (motion["position"] != 0.0).all("space").values
        np.testing.assert_array_equal(
            back["position"].values[seen], motion["position"].values[seen]
        )


def test_the_command_fills_a_file(markers, tmp_path):
    bm.write(cut(markers, (slice(60, 90), "LKNE")), tmp_path / "walk.c3d")
    files = [tmp_path / name for name in ("whole.c3d", "whole.csv", "whole.json")]
    told = CliRunner().invoke(app, [
        "fill-gaps", str(tmp_path / "walk.c3d"), "--out", str(files[0]), "--table", str(files[1]),
        "--json", str(files[2]),
    ])  # fmt: skip
    assert told.exit_code == 0, told.output
    assert "LKNE" in told.stdout
    [gap] = json.loads(files[2].read_text())["gaps"]
    assert (gap["marker"], gap["first_frame"], gap["frames"]) == ("LKNE", 60, 30)
    assert np.isfinite(bm.read(files[0])["position"]).all()
