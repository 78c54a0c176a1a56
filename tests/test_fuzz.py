"""Damaged files: refused in a sentence, or read right; in any case soon, and without dying.

A few mutations are tried with every run of the tests, as many as one likes with
``pytest tests/test_fuzz.py --mutations 4000``.
"""

import resource
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import ezc3d
import h5py
import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm
from bayesmotion.errors import InputError
from bayesmotion.motion import Skeleton, load, make_markers, read_labels, save, skeleton_of
from bayesmotion.motion.io.acclaim import write_asf
from bayesmotion.motion.io.asf import read_body
from bayesmotion.motion.io.labels import Labels
from bayesmotion.motion.validation import require_motion
from bayesmotion.netcdf import HASH, values_hash
from bayesmotion.sensing.audio.beats import read_beats
from bayesmotion.sensing.face.landmarks import write_landmarks
from bayesmotion.sensing.face.views import read_tracks
from bayesmotion.sensing.voxels.cameras import circle, read_cameras, write_cameras

SECONDS = 20.0  # of processor time, for one file
GIGABYTE = 2**20  # in kilobytes, as the system counts


@pytest.fixture(scope="module")
def motion_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("motion") / "motion.nc"
    random = np.random.default_rng(0)
    clip = {"frame_rate": 30.0, "clip": "walk", "labels": {"subject": "02", "gait": "walk"}}
    save(make_markers(["left", "right"], random.normal(size=(20, 2, 3)), **clip), path)
    return path


@pytest.fixture(scope="module")
def fit_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("fit") / "fit.nc"
    model, recordings = bm.example("mixture_ppca")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bm.MotionWarning)
        bm.fit(model, recordings, method=bm.EM(max_steps=2), seed=0).save(path)
    return path


def values_of(found: bm.Fit | xr.Dataset | Labels) -> list[str]:
    """Return hashes of all values of what was read."""
    if isinstance(found, Labels):
        return [repr(found.rows)]
    if isinstance(found, xr.Dataset):
        return [values_hash(found)]
    nodes = [node.to_dataset(inherit=False) for node in found.tree.subtree]
    return [values_hash(data) for data in (*nodes, found.motion)]


def outcome(reader: Callable, path: Path) -> list[str] | str:
    """Return hashes of what was read, or the sentence in which it was refused."""
    try:
        return values_of(reader(path))
    except InputError as error:
        return str(error)


def damaged(content: bytes, random: np.random.Generator) -> bytes:
    """Return the bytes of a file after one accident."""
    changed = bytearray(content)
    at, length = int(random.integers(len(changed))), int(2 ** random.uniform(2, 12))
    match random.integers(6):
        case 0:
            for place in random.integers(len(changed), size=random.integers(1, 9)):
                changed[place] ^= 1 << int(random.integers(8))
        case 1:
            changed[at : at + length] = bytes(len(changed[at : at + length]))
        case 2:
            del changed[at:]
        case 3:
            changed[at:at] = random.bytes(length)
        case 4:
            del changed[at : at + length]
        case _:
            other = int(random.integers(len(changed)))
            changed[at : at + length] = changed[other : other + length]
    return bytes(changed)


@pytest.mark.parametrize("kind", ["motion", "fit"])
def test_damaged_files_are_refused_or_read_right(kind, request, tmp_path, mutations, capfd):
    source: Path = request.getfixturevalue(f"{kind}_file")
    reader: Callable = load if kind == "motion" else bm.load
    content, path, random = source.read_bytes(), tmp_path / "damaged.nc", np.random.default_rng(1)
    right, refused = values_of(reader(source)), 0
    for count in range(mutations):
        path.write_bytes(damaged(content, random))
        with in_time_and_memory(f"mutation {count}"):
            found = outcome(reader, path)
        if isinstance(found, str):
            refused += 1
            assert str(path) in found, f"mutation {count}: {found}"
            assert "\n" not in found, f"mutation {count}: {found}"
        else:
            assert found == right, f"mutation {count} was read wrong"
    with capfd.disabled():
        print(f"{kind}: {refused} of {mutations} damaged files were refused, the others read right")


@contextmanager
def in_time_and_memory(what: str) -> Iterator[None]:
    """Fail if reading takes too long, or more memory than a small file can need."""
    begun, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert time.process_time() - begun < SECONDS, what
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < GIGABYTE, what


def _written(kind: str, folder: Path) -> Path:
    """Write a file that users have."""
    path, random = folder / f"source.{kind.rpartition('-')[2]}", np.random.default_rng(0)
    walk = bm.split(bm.synthetic_walkers(("ann",), ("walk",), seconds=0.5))["ann-walk"]
    match kind:
        case "asf":
            write_asf(skeleton_of(walk), path)
        case "amc" | "bvh" | "mot" | "nc":
            bm.write(walk, path)
        case "trc":
            markers = random.normal(size=(9, 2, 3))
            motion = make_markers(["HEAD", "LKNE"], markers, frame_rate=100.0, clip="x")
            bm.write(motion.assign_attrs(metres=0.001), path)
        case "c3d":
            recording = ezc3d.c3d()
            points = np.ones((4, 2, 9))
            points[:3] = random.normal(size=(3, 2, 9))
            recording["parameters"]["POINT"]["RATE"]["value"] = [100.0]
            recording["parameters"]["POINT"]["LABELS"]["value"] = ["HEAD", "LKNE"]
            recording["data"]["points"] = points
            recording.write(str(path))
        case "npz":
            poses = 0.1 * random.normal(size=(9, 66))
            np.savez(path, poses=poses, trans=np.zeros((9, 3)), mocap_framerate=120.0)
        case "landmarks-csv" | "landmarks-npz":
            write_landmarks(path, random.uniform(0, 99, size=(3, 4, 2)))
        case "landmarks-pts":
            path.write_text("version: 1\nn_points: 2\n{\n10.5 11.25\n12 13\n}\n")
        case "tracks-csv":
            path.write_text("jaw,lips\n" + "".join(f"{k}.25,{k}e-2\n" for k in range(9)))
        case "beats-csv":
            path.write_text("# seconds\n" + "".join(f"{0.5 * k}\n" for k in range(1, 9)))
        case "cameras-json":
            write_cameras(path, circle(2))
    return path


# How every kind of file is read, and the numbers in what was read.
READERS: dict[str, Callable] = {
    **dict.fromkeys(("amc", "bvh", "mot", "trc", "c3d", "npz", "nc"), bm.read),
    "asf": read_body,
    **dict.fromkeys(("landmarks-csv", "landmarks-npz", "landmarks-pts"), bm.read_landmarks),
    "tracks-csv": read_tracks,
    "beats-csv": read_beats,
    "cameras-json": read_cameras,
}


def numbers_of(found: object) -> np.ndarray:
    """Return all numbers of what was read."""
    match found:
        case xr.Dataset():
            require_motion(found, "what was read")
            kept = [v.values.ravel() for v in found.data_vars.values() if v.dtype.kind == "f"]
        case np.ndarray():
            kept = [found.ravel()]
        case (Skeleton() as body, _):
            kept = [np.ravel([joint.offset for joint in body])]
        case (_, np.ndarray() as values):
            kept = [values.ravel()]
        case [*cameras]:
            kept = [camera.projection.ravel() for camera in cameras]
        case _:
            raise TypeError(type(found))
    return np.concatenate([np.zeros(1), *kept])


def read_or_told(kind: str, path: Path) -> str:
    """Return the sentence in which a file was refused; one that is read must be usable."""
    try:
        found = READERS[kind](path)
    except InputError as error:
        return str(error)
    assert not np.isinf(numbers_of(found)).any(), path
    return ""


@pytest.mark.filterwarnings("ignore::bayesmotion.errors.MotionWarning")
@pytest.mark.parametrize("kind", list(READERS))
def test_damaged_recordings_are_refused_or_read(kind, tmp_path, mutations, capfd):
    """Text has no checksum: what is read is another recording, but one that can be."""
    source = _written(kind, tmp_path)
    content, random = source.read_bytes(), np.random.default_rng(3)
    assert np.isfinite(numbers_of(READERS[kind](source))).all()
    path, refused = source, 0
    for count in range(mutations):
        path.write_bytes(damaged(content, random))
        with in_time_and_memory(f"{kind}, mutation {count}"):
            told = read_or_told(kind, path)
        refused += bool(told)
        assert not told or path.stem in told, f"mutation {count}: {told}"
        assert told.isprintable(), f"mutation {count}: {told}"
    with capfd.disabled():
        print(f"{kind}: {refused} of {mutations} damaged files were refused")


def _external(file: h5py.File, name: str, secret: Path) -> None:
    shape = file[name].shape
    del file[name]
    file.create_dataset(name, shape, "u1", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def _virtual(file: h5py.File, name: str, secret: Path) -> None:
    shape = file[name].shape
    del file[name]
    layout = h5py.VirtualLayout(shape, "f8")
    layout[...] = h5py.VirtualSource(secret, "x", shape)
    file.create_virtual_dataset(name, layout)


def _huge(file: h5py.File, name: str, secret: Path) -> None:
    del file[name]
    file.create_dataset(name, (10**6, 10**6), "f8", chunks=(1, 10**6))


def _cycle(file: h5py.File, name: str, secret: Path) -> None:
    file.create_group("one")["loop"] = file["/"]


def _link(file: h5py.File, name: str, secret: Path) -> None:
    file["linked"] = h5py.ExternalLink(str(secret), "/x")


def _soft(file: h5py.File, name: str, secret: Path) -> None:
    file["soft"] = h5py.SoftLink(f"/{name}")


def _gone(file: h5py.File, name: str, secret: Path) -> None:
    del file[name]


def _texts(file: h5py.File, name: str, secret: Path) -> None:
    shape = file[name].shape
    del file[name]
    file.create_dataset(name, data=np.full(shape, "x", dtype=h5py.string_dtype()))


def _infinite(file: h5py.File, name: str, secret: Path) -> None:
    file[name][...] = np.inf


MADE_ON_PURPOSE = [_external, _virtual, _huge, _cycle, _link, _soft, _gone, _texts, _infinite]


@pytest.mark.parametrize("change", MADE_ON_PURPOSE)
@pytest.mark.parametrize("kind", ["motion", "fit"])
def test_files_made_on_purpose_are_refused(kind, change, request, tmp_path):
    path, secret = tmp_path / "made.nc", tmp_path / "secret.h5"
    path.write_bytes(request.getfixturevalue(f"{kind}_file").read_bytes())
    with h5py.File(secret, "w") as file:
        file["x"] = np.full((20, 2, 3), 42.0)
    with h5py.File(path, "r+") as file:
        del file.attrs[HASH]  # whoever makes such a file can make its hash, too
        name = "position"
        if kind == "fit":
            name = max(file["posterior"], key=lambda n: file["posterior"][n].ndim)
            name = f"posterior/{name}"
        change(file, name, secret)
    with pytest.raises(InputError, match=r"made\.nc") as caught:
        (load if kind == "motion" else bm.load)(path)
    assert "42" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("model", "{"), ("model", '{"name": "mixture_ppca", "components": "many"}'),
        ("model", "[]"), ("schema", "three"), ("schema", 2), ("warnings", "{}"),
        ("data_hash", "0"), ("settings", 7.5),
    ],
)  # fmt: skip
def test_attributes_of_other_kinds_are_refused(fit_file, tmp_path, name, value):
    path = tmp_path / "made.nc"
    path.write_bytes(fit_file.read_bytes())
    with h5py.File(path, "r+") as file:
        del file.attrs[HASH]
        file.attrs[name] = value
    with pytest.raises(InputError, match=r"made\.nc"):
        bm.load(path)


def test_values_that_were_changed_are_noticed(fit_file, motion_file, tmp_path):
    path = tmp_path / "made.nc"
    for source, name, reader in (
        (motion_file, "position", load), (fit_file, "sample_stats/lp", bm.load),
    ):  # fmt: skip
        path.write_bytes(source.read_bytes())
        with h5py.File(path, "r+") as file:
            file[name][...] = file[name][...] + 1e-9
        with pytest.raises(InputError, match="not those that were written"):
            reader(path)


def test_damaged_labels_are_refused_or_read(tmp_path, mutations):
    text = "clip,subject,gait\n02_02,02,walk\n02_03,02,run\n35_01,,Gång\n".encode()
    path, random = tmp_path / "labels.csv", np.random.default_rng(2)
    for _ in range(10 * mutations):
        path.write_bytes(damaged(text, random))
        found = outcome(read_labels, path)
        assert "labels.csv" in found if isinstance(found, str) else found
