"""Reading by suffix, saving and loading."""

import errno
import gc
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.motion import (
    clips,
    concat,
    load,
    make_markers,
    positions,
    read,
    save,
    skeleton_of,
    skeletons,
    split,
    write,
    write_amc,
    write_bvh,
)


@pytest.fixture
def folder(make, asf: Path, tmp_path: Path) -> Path:
    write_amc(make(frames=4), tmp_path / "body_1.amc")
    write_amc(make(frames=5, seed=1), tmp_path / "body_2.AMC")
    write_bvh(make(frames=4), tmp_path / "walk.bvh")
    save(make(frames=4), tmp_path / "walk.nc")
    return tmp_path


@pytest.mark.parametrize("name", ["body_1.amc", "body_2.AMC", "walk.bvh", "walk.nc"])
def test_files_are_read_by_their_suffix(folder: Path, name: str):
    assert read(folder / name).sizes["frame"] >= 4


def test_options_reach_the_reader(folder: Path):
    assert read(folder / "body_1.amc", frame_rate=60.0).attrs["frame_rate"] == 60.0
    assert skeleton_of(read(folder / "body_1.amc", skeleton=folder / "body.asf")).name == "body"
    assert read(folder / "walk.bvh", skip_first_frame=True).sizes["frame"] == 3
    assert clips(read(str(folder / "walk.bvh"), clip="w", labels={"w": {"gait": "walk"}})) == ["w"]


@pytest.mark.parametrize("name", ["body_1.amc", "walk.bvh", "walk.nc", "walk.mot"])
def test_every_format_can_be_told_its_rate(folder: Path, name: str):
    write(read(folder / "walk.bvh"), folder / "walk.mot")
    motion = read(folder / name, frame_rate=59.94)
    assert motion.attrs["frame_rate"] == 59.94
    np.testing.assert_allclose(motion["time"], np.arange(4) / 59.94)
    with pytest.raises(InputError, match="frame rate"):
        read(folder / name, frame_rate=-1.0)


def test_files_of_one_name_in_two_folders(make, tmp_path: Path):
    first, second = make(frames=4), make(frames=5, seed=1)
    write(first, tmp_path / "ann" / "walk.bvh")
    # The same name, and other bones.
    write(second, tmp_path / "ben" / "walk.amc")
    text = (tmp_path / "ben" / "walk.asf").read_text()
    (tmp_path / "ben" / "walk.asf").write_text(text.replace("length 9.0", "length 8.0"))
    files = [tmp_path / "ann" / "walk.bvh", tmp_path / "ben" / "walk.amc"]
    motion = read(*files)
    assert clips(motion) == ["ann/walk", "ben/walk"]
    assert {name: body.name for name, body in skeletons(motion).items()} == {
        "ann/walk": "ann/walk", "ben/walk": "ben/walk",
    }  # fmt: skip
    parts = split(motion)
    for clip, file in zip(clips(motion), files, strict=True):
        np.testing.assert_allclose(positions(parts[clip]), positions(read(file)), atol=1e-12)
    table = {"ben/walk": {"gait": "walk"}}
    assert read(*files, labels=table)["gait"].values[-1] == "walk"


def test_what_is_not_known_is_told(folder: Path):
    with pytest.raises(InputError, match=r"a\.fbx: files ending in '\.fbx' .*\.amc, \.bvh, \.mot"):
        read(folder / "a.fbx")
    with pytest.raises(InputError, match=r"files ending in 'nothing'"):
        read(folder / "a")
    with pytest.raises(
        InputError, match=r"\.amc files have no option 'skip_first_frame'.*skeleton"
    ):
        read(folder / "body_1.amc", skip_first_frame=True)
    with pytest.raises(InputError, match=r"\.nc files have no option 'clip'"):
        read(folder / "walk.nc", clip="c")


def test_several_files_with_labels(folder: Path):
    (folder / "labels.csv").write_text("clip,gait\nbody_2,run\n")
    names = [folder / "body_1.amc", folder / "body_2.AMC"]
    motion = read(*names, labels=folder / "labels.csv")
    assert clips(motion) == ["body_1", "body_2"]
    assert motion["gait"].values[[0, 4]].tolist() == ["", "run"]
    assert "gait" not in read(*names).coords
    assert read(*names, labels={"body_1": {"gait": "walk"}})["gait"].values[0] == "walk"


def test_saved_motions_load_the_same(make, tmp_path: Path):
    motion = concat([make("a", gait="walk"), make("b", seed=1)])
    save(motion, tmp_path / "new" / "two.nc")
    again = load(tmp_path / "new" / "two.nc")
    xr.testing.assert_identical(again, motion)
    assert again["gait"].dtype.kind == "U"
    xr.testing.assert_identical(concat([again, make("c")]), concat([motion, make("c")]))
    longer = concat([again, make("a much longer name", gait="swaggering")])
    save(longer, tmp_path / "new" / "two.nc")  # what was loaded does not hold the file
    xr.testing.assert_identical(load(tmp_path / "new" / "two.nc"), longer)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["two.nc"]


def test_markers_load_the_same(tmp_path: Path):
    position = np.ones((3, 1, 3))
    position[1] = np.nan
    motion = make_markers(["a"], position, frame_rate=9.0, clip="c", metres=0.001)
    save(motion, tmp_path / "c.nc")
    xr.testing.assert_identical(load(tmp_path / "c.nc"), motion)


def test_a_failed_save_leaves_the_old_file(make, tmp_path: Path):
    save(make(frames=4), tmp_path / "a.nc")
    with pytest.raises(TypeError):
        save(make(frames=5).assign_attrs(bad=object()), tmp_path / "a.nc")
    assert load(tmp_path / "a.nc").sizes["frame"] == 4
    assert [path.name for path in tmp_path.glob("*.nc")] == ["a.nc"]


def test_what_does_not_load_is_told(tmp_path: Path):
    with pytest.raises(InputError, match=r"none\.nc: there is no such file"):
        load(tmp_path / "none.nc")
    (tmp_path / "bad.nc").write_bytes(b"no netCDF")
    with pytest.raises(InputError, match=r"bad\.nc: it cannot be read as netCDF"):
        load(tmp_path / "bad.nc")
    xr.Dataset({"x": 1.0}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(InputError, match=r"other\.nc: frame_rate, skeletons, source, clip"):
        load(tmp_path / "other.nc")


def test_a_full_disk_leaves_the_motion_and_no_file(make, tmp_path: Path, monkeypatch):
    motion = make(frames=4)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left on device") as caught:
        save(motion, tmp_path / "out" / "a.nc")
    gc.collect()
    assert caught.value.filename == str(tmp_path / "out" / "a.nc")
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize("name", ["again.bvh", "again.amc", "again.nc"])
def test_what_is_written_by_its_suffix_is_read_back(make, tmp_path: Path, name: str):
    motion = make(frames=4)
    write(motion, tmp_path / name)
    again = read(tmp_path / name)
    np.testing.assert_allclose(again["root_position"], motion["root_position"], atol=1e-6)


def test_nothing_is_written_as_what_is_not_known(make, tmp_path: Path):
    with pytest.raises(InputError, match=r"Use \.amc, \.bvh, \.mot, \.trc, \.c3d, \.nc"):
        write(make(frames=4), tmp_path / "walk.fbx")
    with pytest.raises(InputError, match="no file is named"):
        read()


def test_clips_of_one_name_in_two_folders_are_called_by_them(make, asf: Path, tmp_path: Path):
    for folder, seed in (("monday", 0), ("friday", 1)):
        (tmp_path / folder).mkdir()
        write_bvh(make(frames=4, seed=seed), tmp_path / folder / "walk.bvh")
    write_bvh(make(frames=4), tmp_path / "run.bvh")
    files = [tmp_path / "monday/walk.bvh", tmp_path / "friday/walk.bvh", tmp_path / "run.bvh"]
    both = read(*files, labels={"monday/walk": {"gait": "walk"}})
    assert clips(both) == ["monday/walk", "friday/walk", "run"]
    parts = split(both)
    assert set(parts["monday/walk"]["gait"].values) == {"walk"}
    for path, part in zip(files, parts.values(), strict=True):
        np.testing.assert_array_equal(part["angle"], read(path)["angle"])
    with pytest.raises(InputError, match="clip 'walk': two clips have this name"):
        read(files[0], files[0])


def test_different_bodies_of_one_name_are_told_apart(make, asf: Path, tmp_path: Path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "body.asf").write_text(asf.read_text())
        write_amc(make(frames=4), tmp_path / folder / f"body_{folder}.amc")
    body = (tmp_path / "b/body.asf").read_text()
    lengths = re.findall(r"length (\S+)", body)
    (tmp_path / "b/body.asf").write_text(body.replace(f"length {lengths[0]}", "length 9.5", 1))
    both = read(tmp_path / "a/body_a.amc", tmp_path / "b/body_b.amc")
    assert sorted(skeletons(both)) == ["a/body", "b/body"]
    assert skeleton_of(split(both)["body_b"]) != skeleton_of(split(both)["body_a"])
