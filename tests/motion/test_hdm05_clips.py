"""HDM05: clips found by the names of their files, however they are arranged."""

from pathlib import Path

import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import clips, skeletons, write_amc
from bayesmotion.motion.datasets.public import hdm05, hdm05_files


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give a cache of the test's own, and nothing of this machine's settings."""
    folder = tmp_path / "cache"
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: str(folder))
    monkeypatch.delenv("BAYESMOTION_DATA", raising=False)
    return folder


@pytest.fixture
def hdm05_root(tmp_path: Path, asf_text: str, make) -> Path:
    """Lay out clips both ways: by actor, and as the publisher's archive does."""
    root = tmp_path / "hdm"
    write = {"bd/HDM_bd_squat1Reps_001_120.amc": 3, "bd/HDM_bd_squat1Reps_002_120.amc": 4}
    write |= {"cut/grabHighR/HDM_tr_grabHighR_005_120.AMC": 5, "cut/notes.txt": 2}
    for name, frames in write.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        write_amc(make("clip", frames=frames), root / name)
    (root / "bd/HDM_bd.asf").write_text(asf_text)
    (root / "cut/HDM_tr.asf").write_text(asf_text)
    return root


def test_hdm05_labels_say_what_the_names_say(hdm05_root: Path) -> None:
    motion = hdm05(root=hdm05_root)
    assert clips(motion) == [
        "HDM_bd_squat1Reps_001_120",
        "HDM_bd_squat1Reps_002_120",
        "HDM_tr_grabHighR_005_120",
    ]
    last = motion.isel(frame=-1)
    labels = {name: str(last[name].values) for name in ("subject", "task", "repetition")}
    assert labels == {"subject": "tr", "task": "grabHighR", "repetition": "005"}
    assert hdm05("bd", "squat1Reps", hdm05_root).sizes["frame"] == 7
    assert [name[:2] for name in hdm05_files(tasks=["grabHighR"], root=hdm05_root).values()] == [
        ("tr", "grabHighR")
    ]


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"actors": "xx"}, r"HDM05 actor xx: .*Use some of bd, tr"),
        ({"tasks": ["jog", "squat1Reps"]}, r"HDM05 task jog: .*grabHighR, squat1Reps"),
        ({"actors": "tr", "tasks": "squat1Reps"}, r"tr did not perform squat1Reps"),
        ({"actors": []}, r"HDM05 actor \(none\)"),
    ],
)
def test_hdm05_clips_that_are_not_there(hdm05_root: Path, choice: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        hdm05(**choice, root=hdm05_root)


def test_hdm05_is_fetched_by_hand(tmp_path: Path, hdm05_root: Path, cache: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"HDM05_cut_amc.zip.*by hand.*cache"):
        hdm05(root=tmp_path / "empty")
    (hdm05_root / "cut/HDM_tr.asf").unlink()
    with pytest.raises(InputError, match=r"no skeleton HDM_tr.asf for HDM_tr_grabHighR_005"):
        hdm05(root=hdm05_root)
    assert not cache.exists()


@pytest.mark.real_data
def test_real_hdm05(data_root: Path) -> None:
    motion = hdm05(["bd", "dg"], "jogLeftCircle4StepsRstart", data_root / "hdm05")
    assert set(motion["subject"].values) == {"bd", "dg"}
    assert len(clips(motion)) == 3
    assert len(skeletons(motion)) == 2
    actors = {name[0] for name in hdm05_files(root=data_root / "hdm05").values()}
    assert actors == {"bd", "bk", "dg", "mm", "tr"}
