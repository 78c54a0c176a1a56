"""Tables of labels."""

from pathlib import Path

import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import concat, read_labels, with_labels


def write(folder: Path, text: str) -> Path:
    path = folder / "labels.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_labels_come_from_a_table(make, tmp_path: Path):
    both = concat([make("a", subject="1"), make("b", seed=1)])
    path = write(tmp_path, "clip,subject,gait\na,,walk\n\nb,Ödön, run\n")
    motion = with_labels(both, read_labels(path))
    assert motion["gait"].values[[0, 59, 60]].tolist() == ["walk", "walk", "run"]
    assert motion["subject"].values[[0, 60]].tolist() == ["1", "Ödön"]


def test_labels_come_from_a_mapping(make):
    both = concat([make("a"), make("b", seed=1)])
    motion = with_labels(both, {"b": {"gait": "run"}})
    assert motion["gait"].values[[0, 60]].tolist() == ["", "run"]


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("", 1, "columns are missing"),
        ("subject,gait\n1,walk\n", 1, "subject, gait"),
        ("clip\na\n", 1, "columns are clip"),
        ("clip,gait,gait\na,walk,run\n", 1, "'gait'"),
        ("clip,gait,\na,walk,run\n", 1, "''"),
        ("clip,time\na,noon\n", 1, "'time'"),
        ("clip,gait\na,walk\nb\n", 3, "1 cells in a table of 2"),
        ("clip,gait\na,walk\nb,run,fast\n", 3, "3 cells in a table of 2"),
        ("clip,gait\na,walk\n\na,run\n", 4, "'a' stands twice"),
        ("clip,gait\n,walk\n", 2, "not named"),
        ("clip,gait\nc,walk\nd,walk\n", 2, "it is of clip 'c', and no row is of a or b"),
    ],
)
def test_bad_tables_are_told_with_file_and_line(
    make, tmp_path: Path, text: str, line: int, what: str
):
    motion = concat([make("a"), make("b", seed=1)])
    with pytest.raises(InputError) as caught:
        with_labels(motion, read_labels(write(tmp_path, text)))
    assert caught.value.where.endswith(f"labels.csv:{line}")
    assert what in caught.value.what


def test_unreadable_tables_are_told(tmp_path: Path, make):
    with pytest.raises(InputError, match=r"none\.csv: it cannot be read"):
        read_labels(tmp_path / "none.csv")
    (tmp_path / "latin.csv").write_bytes("clip,gait\nÖ,ö".encode("latin-1"))
    with pytest.raises(InputError, match=r"latin\.csv: it cannot be read"):
        read_labels(tmp_path / "latin.csv")
    with pytest.raises(InputError, match="labels of 'walk': no label can be called 'time'"):
        with_labels(make(), {"walk": {"time": "noon"}})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("clip,angle\nwalk,45\n", r"labels\.csv:1: no label can be called 'angle'"),
        ("clip,content\nwalk,run\n", r"labels\.csv:1: no label can be called 'content'"),
        ("clip,m/f\nwalk,m\n", r"labels\.csv:1: no label can be called 'm/f'"),
        ("clip,gait\nwalk,wa\0lk\n", r"labels\.csv:2: the gait 'wa\\x00lk' has control"),
        ("clip,a,a\nwalk,m,n\n", r"labels\.csv:1: two columns are called 'a'"),
    ],
)
def test_labels_that_no_motion_can_hold_are_refused(tmp_path: Path, text: str, told: str):
    (tmp_path / "labels.csv").write_text(text)
    with pytest.raises(InputError, match=told):
        read_labels(tmp_path / "labels.csv")


def test_one_table_serves_a_whole_study(make, tmp_path: Path):
    table = write(tmp_path, "clip,gait\na,walk\nelsewhere,run\n")
    labelled = with_labels(concat([make("a"), make("b", seed=1)]), read_labels(table))
    assert set(labelled["gait"].values.tolist()) == {"walk", ""}
    with pytest.raises(InputError, match="there is no clip 'elsewhere'"):
        with_labels(make("a"), {"elsewhere": {"gait": "run"}})
