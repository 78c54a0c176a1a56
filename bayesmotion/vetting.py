"""Looks an HDF5 file over: run as a program of its own by `netcdf`, which may have to end it.

Links may not leave the file or go round, no data set may be larger than the file can hold, and
all of it can be read. It knows nothing of the rest of the package, so that it starts at once.
"""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import h5netcdf
import h5py
from h5py import h5o  # pyright: ignore[reportAttributeAccessIssue]

FAULT = 3  # the exit code where something is wrong, which is told in one line
SIGNATURE = b"\x89HDF\r\n\x1a\n"
# Compressed or never written, a data set may be so many times larger than the file.
EXPANSION, ANY_FILE = 200, 2**24
MEMORY = 2**30  # bytes, for the program itself
SECONDS, SECONDS_A_GIGABYTE = 3, 20  # of one core
FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}


class Fault(Exception):
    """Something that no file of ours has, told in a few words."""


def look_over(path: Path) -> None:
    """Read all of a file; raise `Fault`, or what h5py and h5netcdf raise."""
    with path.open("rb") as file:
        if file.read(len(SIGNATURE)) != SIGNATURE:
            raise Fault("it does not begin as one")
    room = EXPANSION * path.stat().st_size + ANY_FILE
    _limit(path.stat().st_size, room)
    with h5py.File(path, "r") as stored:
        for name, one in _objects(stored):
            if isinstance(one, h5py.Dataset):
                room -= _require_plain(name, one)
                if room < 0:
                    raise Fault(f"{name} is said to be larger than the file can hold")
        for _, one in _objects(stored):
            for key in one.attrs:
                one.attrs[key]
            if isinstance(one, h5py.Dataset):
                one[()]
    # What finds dimensions goes its own ways through the file.
    with h5netcdf.File(path, "r") as stored:
        _dimensions(stored)


def _objects(group: h5py.Group) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """Yield all groups and data sets, each once, following no link that is none of the file."""
    seen: set[int] = set()
    left: list[tuple[str, h5py.Group | h5py.Dataset]] = [("/", group)]
    while left:
        path, one = left.pop()
        place = h5o.get_info(one.id).addr
        if place in seen:
            raise Fault(f"{path} stands in several places")
        seen.add(place)
        yield path, one
        if not isinstance(one, h5py.Group):
            continue
        for name in one:
            inside = f"{path.rstrip('/')}/{name}"
            if not isinstance(one.get(name, getlink=True), h5py.HardLink):
                raise Fault(f"{inside} is a link to somewhere else")
            child = one[name]
            if not isinstance(child, h5py.Group | h5py.Dataset):
                raise Fault(f"{inside} is neither a group nor a variable")
            left.append((inside, child))


def _require_plain(name: str, data: h5py.Dataset) -> int:
    """Return how many bytes a data set takes in memory; refuse values kept elsewhere."""
    created = data.id.get_create_plist()
    if created.get_external_count() or data.is_virtual:
        raise Fault(f"{name} is kept in another file")
    filters = {created.get_filter(k)[0] for k in range(created.get_nfilters())}
    if not filters <= FILTERS:
        raise Fault(f"{name} is packed in a way that is not known")
    kind = data.dtype.kind
    if kind not in "iufSUb" and h5py.check_string_dtype(data.dtype) is None:
        raise Fault(f"{name} holds neither numbers nor texts")
    return data.size * data.dtype.itemsize if data.shape is not None else 0


def _dimensions(group: h5netcdf.Group) -> None:
    for variable in group.variables.values():
        _ = variable.dimensions, variable.shape, dict(variable.attrs)
    for child in group.groups.values():
        _dimensions(child)


def _limit(size: int, room: int) -> None:
    """Let the system end this process before it takes all memory, or for ever."""
    try:
        import resource
    except ImportError:  # Windows: the one who started it waits so long and no longer
        return
    seconds = SECONDS + SECONDS_A_GIGABYTE * size // 2**30
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY + room, MEMORY + room))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main(path: str) -> int:
    """Look a file over; say what is wrong with it."""
    try:
        look_over(Path(path))
    except Fault as fault:
        print(fault)
    except MemoryError:
        print("it needs more memory than its size allows")
    except Exception as error:  # noqa: BLE001, whatever libraries make of damaged files is told
        print(" ".join(f"{type(error).__name__} {error}".split())[:200])
    else:
        return 0
    return FAULT


if __name__ == "__main__":
    found = main(sys.argv[1])
    sys.stdout.flush()
    # At the end HDF5 would close what is damaged, and may not come back.
    os._exit(found)
