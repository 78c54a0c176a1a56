"""What is written: checked before any work, and the old file or the new one, never half of one.

A `Kind` knows which files it may take the place of: those that this package wrote itself.
"""

import contextlib
import hashlib
import json
import mmap
import os
import re
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from glob import escape
from pathlib import Path

from .errors import InputError

try:
    import fcntl
except ImportError:  # Windows has no such locks: there nobody is kept from a file.
    fcntl = None

OTHER = "Choose another name, or move that file away"


@dataclass(frozen=True)
class Kind:
    """A kind of file that is written.

    Parameters
    ----------
    what
        What such a file holds, for messages.
    suffixes
        What its name may end in, in small letters; none for a folder.
    pattern
        What is found in every file of this kind, a regular expression of bytes.
    """

    what: str
    suffixes: tuple[str, ...] = ()
    pattern: bytes = b""

    def check(self, path: str | Path, inputs: Iterable[str | Path] = ()) -> None:
        """Refuse a path that cannot be written, or where something of the user's would be lost.

        Parameters
        ----------
        path
            Where something of this kind is to be written; devices may have any name.
        inputs
            Files that are read.

        Raises
        ------
        InputError
            If the suffix is another, the path is one of the inputs, there is a file of
            another kind, or the folder cannot be made or written to.

        Examples
        --------
        >>> from bayesmotion.files import FIT
        >>> FIT.check("fit.nc")
        """
        path = Path(path)
        if written_in_place(path):
            return
        if self.suffixes and path.suffix.lower() not in self.suffixes:
            ends = ", ".join(self.suffixes)
            raise InputError(path, f"{self.what} is written as {ends}", f"Let it end in {ends}")
        for other in inputs:
            if _same(path, Path(other)):
                raise InputError(
                    path, "it is read by the same command, and would be lost",
                    "Choose another name for what is written",
                )  # fmt: skip
        target = path.resolve()
        if target.is_dir() != (not self.suffixes) and target.exists():
            is_one = "it is a folder" if self.suffixes else "it is no folder"
            raise InputError(path, is_one, f"Give the name of {self.what}")
        _check_folder(path, target if target.is_dir() else target.parent)
        if target.is_file():
            if not os.access(target, os.W_OK):
                raise InputError(path, "it may not be written over", OTHER)
            if not self.found_in(target):
                raise InputError(path, f"there is a file that holds no {_bare(self.what)}", OTHER)

    def holds(self, path: Path) -> bool:
        """Whether a path is a file of this kind that is there, with its suffix and content."""
        return path.suffix.lower() in self.suffixes and path.is_file() and self.found_in(path)

    def found_in(self, path: Path) -> bool:
        """Whether a file is of this kind; an empty one may become any."""
        if path.stat().st_size == 0:
            return True
        with (
            path.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
        ):
            return re.search(self.pattern, content, re.DOTALL) is not None


HDF5 = rb"\A\x89HDF\r\n\x1a\n"
FIT = Kind("a fit", (".nc",), HDF5 + rb".*data_hash")
MOTION = Kind("a motion", (".nc",), HDF5 + rb"(?!.*data_hash).*skeletons")
VOXELS = Kind("a file of voxels", (".nc",), HDF5 + rb".*voxel")
RANKS = Kind("a table of ranks", (".nc",), HDF5 + rb".*rank")
JSON = Kind("a file of results", (".json",), rb"\A\s*[{\[]")
TABLE = Kind(
    "a table of means and quantiles", (".csv", ".nc"),
    rb"\Aclip,time_s,channel,|" + HDF5 + rb"(?!.*data_hash).*quantiles",
)  # fmt: skip
PROBABILITIES = Kind(
    "a table of probabilities", (".csv", ".nc"),
    rb"\Aclip,factor,level,p\s|" + HDF5 + rb"(?!.*data_hash).*\(new\)",
)  # fmt: skip
CURVES = Kind(
    "a table of a contrast", (".csv", ".nc"),
    rb"\A(?:phase|time),mean,sd,|" + HDF5 + rb"(?!.*data_hash).*band_low",
)  # fmt: skip
SCORES = Kind("a table of scores", (".csv",), rb"\Aclip,context,horizon,")
MARKERS = Kind(
    "a recording of markers", (".c3d", ".trc", ".nc"),
    rb"\A.\x50|\APathFileType|%s" % MOTION.pattern,
)  # fmt: skip
BVH = Kind("a BVH motion", (".bvh",), rb"\A\s*(?i:HIERARCHY)")
RECORDING = Kind("a motion", (".bvh", ".nc"), rb"%s|%s" % (BVH.pattern, MOTION.pattern))
PAGE = Kind("a page", (".html",), rb'<meta name="generator" content="bayesmotion">')
PICTURE = Kind("a picture", (".png", ".pdf", ".svg"), rb"(?i:matplotlib)")
VIDEO = Kind("a video of ours", (".mp4",), rb"\A....ftyp.*bayesmotion")
FACE = Kind("a video or a table of a face", (*VIDEO.suffixes, *TABLE.suffixes),
            VIDEO.pattern + b"|" + TABLE.pattern)  # fmt: skip
TRACKS = Kind("a table of tracks", (".csv",), rb"\Atime,[^\n]* sd")
PARAMETERS = Kind("a table of a face's parameters", (".csv",), rb"\Aface0")
PORTRAIT = Kind("a portrait", (".npz",), rb"\APK.*mesh_reference")
FOLDER = Kind("a folder")


def require_file(path: str | Path) -> None:
    """Refuse a path where there is no file.

    Raises
    ------
    InputError
        If there is none.
    """
    if not Path(path).is_file():
        raise InputError(path, "there is no such file", "Check the path")


def check_outputs(outputs: Iterable[tuple[Path, Kind]], inputs: Iterable[Path] = ()) -> None:
    """Refuse outputs as `Kind.check` does, and two that are one file."""
    inputs, seen = list(inputs), []
    for path, kind in outputs:
        kind.check(path, inputs)
        if any(_same(path, other) for other in seen):
            raise InputError(path, "two things are to be written to it", "Give each its own name")
        if not written_in_place(path):
            seen.append(path)


@contextmanager
def held(paths: Iterable[Path]) -> Iterator[None]:
    """Keep other processes of the same user from writing these files while the block runs.

    Raises
    ------
    InputError
        If another one is at it.
    """
    with contextlib.ExitStack() as stack:
        for path in paths:
            if fcntl is None or written_in_place(path):
                continue
            name = hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:24]
            # Beside the file it would have to be removed, and be left behind by who is killed.
            folder = Path(tempfile.gettempdir()) / f"bayesmotion-{os.getuid()}"
            folder.mkdir(mode=0o700, exist_ok=True)
            handle = os.open(folder / f"{name}.lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
            stack.callback(os.close, handle)
            if not _locked(handle):
                raise InputError(
                    path, "another process is at work on it", "Wait for it, or choose another name"
                )
        yield


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success it takes the place of `path`.

    A process that dies inside the block leaves `path` as it was; what it leaves beside it is
    removed by the next one. The temporary name keeps the suffix, in small letters, so that
    writers that go by the suffix work unchanged. A link is kept, and what it leads to replaced;
    a device is written to.

    Raises
    ------
    OSError
        If the folder cannot be made or written to, or the disk is full; with `path` as its name.
    """
    path = Path(path)
    try:
        if written_in_place(path):
            with tempfile.TemporaryDirectory() as folder:
                temporary = Path(folder) / f"out{path.suffix.lower()}"
                yield temporary
                with temporary.open("rb") as source, path.open("ab") as sink:
                    shutil.copyfileobj(source, sink)
        else:
            with _replaced(path.resolve()) as temporary:
                yield temporary
    except OSError as error:
        # The name that users gave, instead of that of the hidden part or of none at all.
        if error.errno is None:
            raise OSError(f"{path}: {error}") from error
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def _replaced(target: Path) -> Iterator[Path]:
    target.parent.mkdir(parents=True, exist_ok=True)
    _remove_leftovers(target)
    temporary = target.with_name(f"{_part(target)}{secrets.token_hex(4)}{target.suffix.lower()}")
    # The mode of a new file is what the umask leaves, which `open` knows.
    handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        _locked(handle)
        if target.exists():
            temporary.chmod(stat.S_IMODE(target.stat().st_mode))
        yield temporary
        _to_disk(temporary)
        os.replace(temporary, target)
        if os.name == "posix":
            _to_disk(target.parent)
    finally:
        os.close(handle)
        temporary.unlink(missing_ok=True)


def write_bytes(path: str | Path, content: bytes | memoryview) -> None:
    """Write bytes; an older file stays until the new one is whole."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: str | Path, value: object) -> None:
    """Write `value` as JSON; an older file stays until the new one is whole."""
    write_bytes(path, (json.dumps(value, indent=2) + "\n").encode())


def written_in_place(path: Path) -> bool:
    """Whether a path is a device or a pipe, such as /dev/null and /dev/stdout."""
    if Path("/dev") in path.absolute().parents or Path("/proc") in path.absolute().parents:
        return path.exists() and not path.is_dir()
    return path.exists() and not path.is_file() and not path.is_dir()


def _same(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.samefile(other)
    return one.resolve() == other.resolve()


def _bare(what: str) -> str:
    return what.removeprefix("a ")


def _check_folder(path: Path, folder: Path) -> None:
    """Refuse a folder that cannot be made, or where nothing can be written."""
    there = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if not there.is_dir():
        raise InputError(path, f"{there} is no folder", "Give a path in a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(
            path, f"the folder {there} may not be written to", "Give a path in another folder"
        )


def _part(target: Path) -> str:
    return f".{target.stem}-"


def _remove_leftovers(target: Path) -> None:
    """Remove what dead processes left of writing this file: nobody holds it any more."""
    if fcntl is None:
        return
    for old in target.parent.glob(
        f"{escape(_part(target))}{'[0-9a-f]' * 8}{target.suffix.lower()}"
    ):
        handle = os.open(old, os.O_RDWR)
        try:
            if _locked(handle):
                old.unlink(missing_ok=True)
        finally:
            os.close(handle)


def _locked(handle: int) -> bool:
    """Lock an open file, until it is closed or the process dies; False where another has it."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False  # it is another's, or this file system has no locks
    return True


def _to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
