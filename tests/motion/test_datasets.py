"""Public recordings: found where they lie, fetched whole or not at all."""

import hashlib
import json
import socket
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import clips, read_amc, skeletons, write_amc
from bayesmotion.motion.datasets.cmu_registry import SHA256
from bayesmotion.motion.datasets.public import cmu

ASF, AMC = "/99/99.asf", "/99/99_01.amc"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a cache of the test's own, and nothing of this machine's settings."""
    folder = tmp_path / "cache"
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: str(folder))
    monkeypatch.delenv("BAYESMOTION_DATA", raising=False)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    return folder


class Publisher:
    """A server on the loopback address: what it serves, and what it was asked for."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self.files = files
        self.announced: dict[str, int] = {}
        self.asked: list[str] = []
        publisher = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                publisher.asked.append(self.path)
                body = publisher.files.get(self.path)
                if body is None:
                    self.send_error(404)
                    return
                self.send_response(200)
                length = publisher.announced.get(self.path, len(body))
                self.send_header("Content-Length", str(length))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: object) -> None:
                """Keep quiet."""

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}"


@pytest.fixture
def publisher(asf_text: str, amc_bytes: bytes) -> Iterator[Publisher]:
    publisher = Publisher({ASF: asf_text.encode(), AMC: amc_bytes})
    thread = threading.Thread(target=publisher.server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    yield publisher
    publisher.server.shutdown()
    publisher.server.server_close()
    thread.join(5)
    assert not thread.is_alive()


@pytest.fixture
def amc_bytes(make, tmp_path: Path) -> bytes:
    path = tmp_path / "made.amc"
    write_amc(make("99_01", frames=8), path)
    return path.read_bytes()


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


def put(folder: Path, asf_text: str, amc_bytes: bytes) -> Path:
    """Lay subject 99 into a folder."""
    (folder / "99").mkdir(parents=True)
    (folder / "99/99.asf").write_text(asf_text)
    (folder / "99/99_01.amc").write_bytes(amc_bytes)
    return folder


def test_what_is_missing_is_fetched_once(publisher: Publisher, cache: Path, make) -> None:
    motion = cmu("99_01", labels={"99_01": {"gait": "walk"}}, base_url=publisher.url)
    np.testing.assert_allclose(motion["angle"], make("99_01", frames=8)["angle"], atol=1e-6)
    assert set(motion["subject"].values) == {"99"}
    assert set(motion["gait"].values) == {"walk"}
    assert motion.attrs["frame_rate"] == 120.0
    assert publisher.asked == [ASF, AMC]
    assert files(cache) == ["99.asf", "99_01.amc"]
    assert (cache / "cmu/99/99_01.amc").read_bytes() == publisher.files[AMC]
    again = cmu(["99_01"], base_url=publisher.url)
    assert publisher.asked == [ASF, AMC]
    np.testing.assert_array_equal(again["angle"], motion["angle"])


def test_fewer_bytes_than_announced_are_refused(publisher: Publisher, cache: Path) -> None:
    publisher.announced[AMC] = len(publisher.files[AMC]) + 100
    with pytest.raises(InputError, match=r"CMU 99_01.amc: .*transfer broke off.* save it as"):
        cmu("99_01", base_url=publisher.url)
    assert files(cache) == ["99.asf"]


@pytest.mark.parametrize("left", [0.4, 0.7, 0.97])
def test_a_truncated_file_is_refused(publisher: Publisher, cache: Path, left: float) -> None:
    whole = publisher.files[AMC]
    publisher.files[AMC] = whole[: whole.rindex(b" ", 0, int(left * len(whole)))]
    with pytest.raises(InputError, match=r"what came is damaged in line \d+: .*Try again"):
        cmu("99_01", base_url=publisher.url)
    assert files(cache) == ["99.asf"]
    publisher.files[AMC] = whole
    assert cmu("99_01", base_url=publisher.url).sizes["frame"] == 8


def test_a_page_in_place_of_a_file_is_refused(publisher: Publisher, cache: Path) -> None:
    publisher.files[ASF] = b"<html><body>Please log in to this network.</body></html>\n"
    with pytest.raises(InputError, match=r"CMU 99.asf: .*damaged"):
        cmu("99_01", base_url=publisher.url)
    assert files(cache) == []


def test_a_trial_that_does_not_exist(publisher: Publisher, cache: Path) -> None:
    with pytest.raises(InputError, match=r"CMU 99_02.amc: there is no such motion .*answered 404"):
        cmu("99_02", base_url=publisher.url)
    assert files(cache) == ["99.asf"]


def test_no_network(cache: Path) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    with pytest.raises(InputError, match=r"CMU 99.asf: .*cannot be reached.*with a browser"):
        cmu("99_01", base_url=f"http://127.0.0.1:{port}")
    assert files(cache) == []


def test_a_known_checksum_must_agree(
    publisher: Publisher, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = hashlib.sha256(publisher.files[AMC]).hexdigest()
    monkeypatch.setitem(SHA256, "99_01.amc", "0" * 64)
    with pytest.raises(InputError, match="not the file that is known under this name"):
        cmu("99_01", base_url=publisher.url)
    assert files(cache) == ["99.asf"]
    monkeypatch.setitem(SHA256, "99_01.amc", good)
    publisher.files[AMC] = publisher.files[AMC].replace(b"\n", b"\r\n")
    assert cmu("99_01", base_url=publisher.url).sizes["frame"] == 8


def test_a_file_that_is_there_is_left_alone(
    publisher: Publisher, cache: Path, asf_text: str, amc_bytes: bytes
) -> None:
    put(cache / "cmu", asf_text, amc_bytes)
    before = {path: path.stat().st_mtime_ns for path in (cache / "cmu/99").iterdir()}
    publisher.files = {ASF: b"garbage", AMC: b"garbage"}
    cmu("99_01", base_url=publisher.url)
    with pytest.raises(InputError, match="99_03"):
        cmu(["99_01", "99_03"], base_url=publisher.url)
    assert {path: path.stat().st_mtime_ns for path in (cache / "cmu/99").iterdir()} == before
    assert publisher.asked == ["/99/99_03.amc"]


def test_a_cache_that_cannot_be_written(publisher: Publisher, cache: Path) -> None:
    cache.write_text("a file, not a folder")
    with pytest.raises(InputError, match="cannot be written"):
        cmu("99_01", base_url=publisher.url)
    assert cache.read_text() == "a file, not a folder"


def test_folders_are_searched_in_order(
    tmp_path: Path,
    cache: Path,
    monkeypatch: pytest.MonkeyPatch,
    publisher: Publisher,
    asf_text: str,
    make,
) -> None:
    """Each place holds a clip of another length, which tells where it was read from."""
    places = {"root": tmp_path / "root", "data": tmp_path / "data/cmu", "cache": cache / "cmu"}
    for frames, folder in zip((3, 4, 5), places.values(), strict=True):
        write_amc(make("99_01", frames=frames), tmp_path / "one.amc")
        put(folder, asf_text, (tmp_path / "one.amc").read_bytes())

    def frames(root: Path | None = None) -> int:
        return cmu("99_01", root, base_url=publisher.url).sizes["frame"]

    assert frames() == 5
    monkeypatch.setenv("BAYESMOTION_DATA", str(tmp_path / "data"))
    assert frames() == 4
    assert frames(places["root"]) == 3
    (places["root"] / "99/99_01.amc").unlink()
    assert frames(places["root"]) == 4
    assert publisher.asked == []
    monkeypatch.setenv("BAYESMOTION_DATA", str(tmp_path / "nowhere"))
    with pytest.raises(InputError, match="BAYESMOTION_DATA: there is no folder"):
        frames()
    monkeypatch.delenv("BAYESMOTION_DATA")
    with pytest.raises(InputError, match="root: there is no folder"):
        frames(tmp_path / "nowhere")


def test_a_subject_without_skeleton_is_told_so(
    tmp_path: Path, publisher: Publisher, asf_text: str, amc_bytes: bytes
) -> None:
    root = put(tmp_path / "root", asf_text, amc_bytes)
    (root / "99/99.asf").unlink()
    del publisher.files[ASF]
    with pytest.raises(InputError, match=r"CMU 99.asf: there is no such skeleton in .*root"):
        cmu("99_01", root, base_url=publisher.url)


@pytest.mark.parametrize("trials", [[], "2_2", "02_02.amc", ["02_02", "../secret_01"]])
def test_names_that_are_no_trials(trials: str | list[str]) -> None:
    with pytest.raises(InputError, match="02_02"):
        cmu(trials, base_url="http://127.0.0.1:9")


@pytest.mark.real_data
def test_real_trials(data_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BAYESMOTION_DATA", str(data_root))
    motion = cmu(["02_03", "35_18"], base_url="http://127.0.0.1:9")
    assert clips(motion) == ["02_03", "35_18"]
    assert list(skeletons(motion)) == ["02", "35"]
    alone = read_amc(data_root / "cmu/02/02_03.amc")
    np.testing.assert_array_equal(motion["angle"][: alone.sizes["frame"]], alone["angle"])
    assert json.loads(motion.attrs["source"])["35_18"]


@pytest.mark.real_data
def test_real_subject_without_skeleton(data_root: Path) -> None:
    with pytest.raises(InputError, match=r"CMU 06.asf: there is no such skeleton in .*06"):
        cmu("06_01", data_root / "cmu", base_url="http://127.0.0.1:9")


@pytest.mark.real_data
def test_checksums_are_those_of_the_originals(data_root: Path) -> None:
    for name, known in SHA256.items():
        path = data_root / "cmu" / name[:2] / name
        contents = path.read_bytes().replace(b"\r\n", b"\n")
        assert hashlib.sha256(contents).hexdigest() == known, name
        assert b"derived" not in contents[:200].lower(), name
