"""Damaged files: refused in a sentence, or read right; in any case soon, and without dying.

A few mutations are tried with every run of the tests, as many as one likes with
``pytest tests/test_fuzz.py --mutations 4000``.
"""

import time
import warnings
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm
from bayesmotion.errors import InputError
from bayesmotion.motion import load, make_markers, read_labels, save
from bayesmotion.motion.io.labels import Labels
from bayesmotion.netcdf import HASH, values_hash

SECONDS = 150.0  # for one file, on a busy machine; a few on an idle one


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
        begun = time.monotonic()
        found = outcome(reader, path)
        assert time.monotonic() - begun < SECONDS, f"mutation {count}"
        if isinstance(found, str):
            refused += 1
            assert str(path) in found, f"mutation {count}: {found}"
            assert "\n" not in found, f"mutation {count}: {found}"
        else:
            assert found == right, f"mutation {count} was read wrong"
    with capfd.disabled():
        print(f"{kind}: {refused} of {mutations} damaged files were refused, the others read right")


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
