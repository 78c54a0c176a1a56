"""What is written: nothing of the user's is lost, and nothing half written is left."""

import errno
import multiprocessing
import os
import stat
from pathlib import Path

import pytest

from bayesmotion.errors import InputError
from bayesmotion.files import (
    BVH,
    FIT,
    FOLDER,
    JSON,
    PROBABILITIES,
    SCORES,
    TABLE,
    check_outputs,
    held,
    replacing,
    write_bytes,
    write_json,
)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(
    ("kind", "name", "content"),
    [
        (BVH, "walk.BVH", b"  hierarchy\nROOT hips"),
        (JSON, "a.json", b'{"a": 1}'),
        (FIT, "fit.nc", b"\x89HDF\r\n\x1a\n...data_hash..."),
        (FIT, "empty.nc", b""),
        (TABLE, "f.csv", b"clip,time_s,channel,unit,mean\n"),
        (TABLE, "f.nc", b"\x89HDF\r\n\x1a\n...quantiles..."),
        (PROBABILITIES, "p.csv", b"clip,factor,level,p\n"),
        (PROBABILITIES, "p.nc", b"\x89HDF\r\n\x1a\n...(new)..."),
        (SCORES, "s.csv", b"clip,context,horizon,error\n"),
    ],
)
def test_files_of_the_same_kind_may_be_replaced(kind, name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    kind.check(tmp_path / name)


@pytest.mark.parametrize(
    ("kind", "name", "content"),
    [
        (BVH, "walk.bvh", b":degrees"),
        (JSON, "a.json", b"notes"),
        (FIT, "motion.nc", b"\x89HDF\r\n\x1a\n...skeletons..."),
        (FIT, "text.nc", b"data_hash"),
        (TABLE, "labels.csv", b"clip,subject,gait\n"),
        (TABLE, "fit.nc", b"\x89HDF\r\n\x1a\n...quantiles...data_hash..."),
        (PROBABILITIES, "labels.csv", b"clip,factor,level,people\n"),
        (SCORES, "labels.csv", b"clip,context\n"),
    ],
)
def test_files_of_another_kind_are_kept(kind, name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}: there is a file that holds no"):
        kind.check(tmp_path / name)


def test_outputs_that_cannot_be_written_are_refused(tmp_path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "folder.nc").mkdir()
    for kind, name, said in (
        (FIT, "35_01.amc", "a fit is written as .nc. Let it end in .nc."),
        (FIT, "folder.nc", "it is a folder"),
        (FIT, "file/fit.nc", "file is no folder"),
        (FOLDER, "file", "it is no folder"),
    ):
        with pytest.raises(InputError, match=said):
            kind.check(tmp_path / name)
    FIT.check(tmp_path / "new" / "folder" / "fit.nc")
    FOLDER.check(tmp_path)
    FOLDER.check(tmp_path / "new")
    assert names(tmp_path) == ["file", "folder.nc"]


@pytest.mark.skipif(os.name != "posix" or os.getuid() == 0, reason="root may write everywhere")
def test_folders_that_may_not_be_written_are_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="may not be written to"):
        FIT.check(tmp_path / "fit.nc")


def test_inputs_are_not_written_over_by_any_name(tmp_path):
    walk, link = tmp_path / "walk.bvh", tmp_path / "link.bvh"
    walk.write_text("HIERARCHY")
    link.symlink_to(walk)
    for path in (walk, link, tmp_path / "new" / ".." / "walk.bvh"):
        with pytest.raises(InputError, match="read by the same command"):
            BVH.check(path, [walk])
    with pytest.raises(InputError, match="two things are to be written"):
        check_outputs([(walk, BVH), (link, BVH)])


def test_links_modes_and_umask_are_kept(tmp_path):
    old, link = tmp_path / "old.json", tmp_path / "link.json"
    old.write_text("{}")
    old.chmod(0o640)
    link.symlink_to(old)
    write_json(link, {"a": 1})
    assert link.is_symlink()
    assert old.read_text().startswith("{\n")
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    usual = os.umask(0o027)
    try:
        write_json(tmp_path / "new.json", {})
    finally:
        os.umask(usual)
    assert stat.S_IMODE((tmp_path / "new.json").stat().st_mode) == 0o640


def test_devices_are_written_to(tmp_path):
    write_json("/dev/null", {})
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    FIT.check("/dev/null")
    fifo = tmp_path / "pipe"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    write_bytes(fifo, b"abc")
    assert os.read(reader, 10) == b"abc"
    os.close(reader)
    assert stat.S_ISFIFO(fifo.stat().st_mode)


def fill(path):
    with replacing(path) as temporary:
        temporary.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device", str(temporary))


def test_a_failed_write_leaves_the_old_file_and_names_it(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {})
    with pytest.raises(OSError, match="No space") as caught:
        fill(path)
    assert caught.value.filename == str(path)
    assert path.read_text() == "{}\n"
    assert names(tmp_path) == ["a.json"]


def test_suffixes_in_capitals_are_those_writers_know(tmp_path):
    with replacing(tmp_path / "A.NPZ") as temporary:
        assert temporary.suffix == ".npz"
        temporary.write_bytes(b"PK")
    assert names(tmp_path) == ["A.NPZ"]


def _die(path):
    with replacing(path) as temporary:
        temporary.write_text("half")
        os._exit(9)


def test_what_a_killed_process_left_is_removed(tmp_path):
    path = tmp_path / "a.json"
    child = multiprocessing.get_context("spawn").Process(target=_die, args=(path,))
    child.start()
    child.join()
    assert len(names(tmp_path)) == 1
    with replacing(path) as mine:  # a part that a living process holds stays
        write_json(path, {"a": 1})
        mine.write_text("{}")
    assert names(tmp_path) == ["a.json"]


def test_a_file_is_one_process_s(tmp_path):
    with (
        held([tmp_path / "a.nc", tmp_path / "b.nc"]),
        pytest.raises(InputError, match=r"b\.nc: another process is at work on it"),
        held([tmp_path / "b.nc"]),
    ):
        pass
    with held([tmp_path / "b.nc"]):
        pass
    assert names(tmp_path) == []
