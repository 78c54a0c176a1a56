"""Finding recordings, and getting one from its publisher: whole and checked, or not at all."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import platformdirs
import pooch
import requests

from ...errors import InputError

DATA_VARIABLE = "BAYESMOTION_DATA"
_TIMEOUT = 30.0  # seconds without a sign from the server
_CHUNK = 1 << 16


def folders(name: str, root: str | Path | None) -> list[Path]:
    """Give the folders to look into for a data base, the user's cache last.

    Parameters
    ----------
    name
        Folder of the data base in ``$BAYESMOTION_DATA`` and in the cache.
    root
        Folder of the data base itself, to be looked into first.

    Raises
    ------
    InputError
        If `root` or ``$BAYESMOTION_DATA`` is given and is no folder.
    """
    places = []
    if root is not None:
        places.append(Path(root))
    if data := os.environ.get(DATA_VARIABLE):
        if not Path(data).is_dir():
            raise InputError(
                DATA_VARIABLE, f"there is no folder {data}", "Correct or unset the variable"
            )
        places.append(Path(data) / name)
    if root is not None and not places[0].is_dir():
        raise InputError("root", f"there is no folder {root}", "Give the folder of the recordings")
    return [*places, Path(platformdirs.user_cache_dir("bayesmotion")) / name]


def fetch(
    url: str,
    path: Path,
    *,
    check: Callable[[Path], object],
    sha256: str | None = None,
) -> Path:
    """Get a file unless it is there already.

    The file is written under another name and takes its place only after it has
    passed every check, so `path` is never half a file.

    Parameters
    ----------
    url
        Where the file is published.
    path
        Where it is to lie; a file that lies there is left alone.
    check
        Reads the file and raises `InputError` if it cannot be used.
    sha256
        Checksum of the contents with line ends written as LF, if it is known.

    Returns
    -------
    `path`.

    Raises
    ------
    InputError
        If the server cannot be reached, has no such file or sends a damaged one.
    """
    store = pooch.create(
        path=path.parent, base_url=url.rsplit("/", 1)[0] + "/", registry={path.name: None}
    )

    def download(address: str, output: str, _: pooch.Pooch) -> None:
        _receive(address, Path(output))
        _check_contents(url, Path(output), sha256, check)

    try:
        # The type that pooch states for a downloader is that of a processor.
        store.fetch(path.name, downloader=download)  # pyright: ignore[reportArgumentType]
    except requests.HTTPError as error:
        raise _failure(url, path, str(error)) from error
    except requests.ConnectionError as error:
        raise _failure(url, path, "the server cannot be reached") from error
    except requests.RequestException as error:
        raise _failure(url, path, f"the transfer broke off ({error})") from error
    except OSError as error:
        raise InputError(
            path,
            f"it cannot be written ({error.strerror or error})",
            "Free the place or give another root",
        ) from error
    return path


def _receive(url: str, output: Path) -> None:
    """Write what the server sends to a file, and see that it is as long as announced."""
    # Uncompressed, so that the announced length is that of the file.
    headers = {"Accept-Encoding": "identity"}
    with requests.get(url, stream=True, timeout=_TIMEOUT, headers=headers) as response:
        if not response.ok:
            raise requests.HTTPError(f"the server answered {response.status_code}")
        with output.open("wb") as file:
            for chunk in response.iter_content(_CHUNK):
                file.write(chunk)
        announced = response.headers.get("Content-Length")
    if announced is not None and output.stat().st_size != int(announced):
        raise requests.exceptions.ChunkedEncodingError(
            f"{output.stat().st_size} of {announced} bytes came"
        )


def _check_contents(
    url: str, output: Path, sha256: str | None, check: Callable[[Path], object]
) -> None:
    """Refuse a file that is not what is published, or that cannot be read."""
    again = "Try again; if it comes again, fetch it with a browser and look at it"
    contents = output.read_bytes().replace(b"\r\n", b"\n")
    if sha256 is not None and hashlib.sha256(contents).hexdigest() != sha256:
        raise InputError(url, "what came is not the file that is known under this name", again)
    try:
        check(output)
    except InputError as error:
        line = error.where.rpartition(":")[2]
        place = f" in line {line}" if line.isdigit() else ""
        raise InputError(url, f"what came is damaged{place}: {error.what}", again) from error


def _failure(url: str, path: Path, what: str) -> InputError:
    """Say that a file could not be had, and how to get it by hand."""
    return InputError(
        url, what, f"Try again later, or fetch the file with a browser and save it as {path}"
    )
