"""The commands around voxels, on a walk of a second."""

import json

import numpy as np
import pytest

from bayesmotion.motion import read, save, split
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.sensing.voxels.cameras import circle, write_cameras
from bayesmotion.sensing.voxels.carving import load_voxels


@pytest.fixture(scope="module")
def folder(tmp_path_factory, run):
    folder = tmp_path_factory.mktemp("voxels")
    walkers = synthetic_walkers(["ann", "ben"], ["walk"], seconds=1.0, seed=1)
    for clip, motion in split(walkers).items():
        save(motion, folder / f"{clip}.nc")
    done = run("fit", "voxel-pose", folder / "ann-walk.nc", folder / "ben-walk.nc", "--rate", "15",
               "--components", "8", "--mixture-points", "5000", "--cameras", "4",
               "--out", folder / "fit.nc")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "converged after" in done.stdout
    return folder


def test_voxels_are_carved_and_poses_recognised(folder, run):
    hull, bvh = folder / "hull.nc", folder / "pose.bvh"
    done = run("voxels", folder / "ann-walk.nc", "--cameras", 4, "--rate", 10, "--out", hull,
               "--plot", folder / "hull.png")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "10 frames" in done.stdout
    assert (folder / "hull.png").stat().st_size > 5000
    assert load_voxels(hull).sizes["frame"] == 10
    done = run("recognize-pose", folder / "fit.nc", hull, "--bvh", bvh, "--clip",
               folder / "ann-walk.nc", "--json", folder / "pose.json")  # fmt: skip
    assert done.exit_code == 0, done.output
    error = float(done.stdout.split("error ")[1].split()[0])
    assert error < 8.0
    told = json.loads((folder / "pose.json").read_text())
    assert np.shape(told["angles"]) == np.shape(told["sd"]) == (10, len(told["labels"]))
    motion, true = read(bvh), read(folder / "ann-walk.nc")
    assert motion.sizes["frame"] == 10
    # The middle of the voxels is near the pelvis.
    away = motion["root_position"].values - true["root_position"].values[::3]
    assert np.abs(away).max() < 0.35


def test_cameras_of_a_file_stand_in_the_recordings_world(folder, run, refused):
    write_cameras(folder / "cameras.json", circle(3, radius=5.0))
    out = folder / "other.nc"
    done = run("voxels", folder / "ben-walk.nc", "--camera-file", folder / "cameras.json",
               "--rate", 5, "--flips", 0.01, "--holes", 1, "--out", out)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert load_voxels(out).attrs["cameras"] == 3
    assert all(line.startswith("bayesmotion: ") for line in done.stderr.splitlines())
    done = run("voxels", folder / "ben-walk.nc", "--camera-file", folder / "cameras.json",
               "--radius", 4, "--out", out)  # fmt: skip
    assert "--radius: it says nothing beside --camera-file" in refused(done)


def test_what_does_not_fit_together_is_refused(folder, run, refused):
    clip, fit = folder / "ann-walk.nc", folder / "fit.nc"
    assert "no fit of bayesmotion" in refused(run("recognize-pose", clip, clip))
    assert "holds no voxels" in refused(run("recognize-pose", fit, clip))
    hull = folder / "short.nc"
    run("voxels", clip, "--rate", 5, "--cameras", 3, "--out", hull)
    line = refused(run("recognize-pose", fit, hull, "--clip", folder / "missing.nc"))
    assert "missing.nc" in line
