"""Labels of clips (subject, gait, ...) kept in a csv table beside the recordings."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from ...errors import InputError
from ..dataset import check_labels, clips


@dataclass(frozen=True)
class Labels:
    """Labels by clip, and the lines of the file where they stand.

    Parameters
    ----------
    rows
        ``{"35_01": {"subject": "35", "gait": "walk"}, ...}``; "" means unknown.
    places
        Where each clip's row stands, for messages: ``labels.csv:2``.
    """

    rows: Mapping[str, Mapping[str, str]]
    places: Mapping[str, str]


def read_labels(path: str | Path) -> Labels:
    """Read a table of labels: a csv file with a column ``clip``, one row a clip.

    Parameters
    ----------
    path
        The file, in UTF-8. An empty cell means unknown.

    Raises
    ------
    InputError
        If the file is missing, has no column ``clip`` or no other, a row has another
        number of cells than the first, a clip stands twice, or a label is none that a Motion can
        hold (`check_labels`); file and line are named.
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [(number, row) for number, row in _numbered(csv.reader(file)) if any(row)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"it cannot be read ({error})", "Give a csv table") from error
    columns = [cell.strip() for cell in rows[0][1]] if rows else []
    _check_columns(f"{path}:{rows[0][0] if rows else 1}", columns)
    table: dict[str, dict[str, str]] = {}
    places: dict[str, str] = {}
    for number, row in rows[1:]:
        where = f"{path}:{number}"
        if len(row) != len(columns):
            raise InputError(
                where,
                f"{len(row)} cells in a table of {len(columns)} columns",
                "Leave unknown cells empty, but keep the commas",
            )
        cells = dict(zip(columns, (cell.strip() for cell in row), strict=True))
        clip = cells.pop("clip")
        if not clip or clip in places:
            raise InputError(
                where,
                f"the clip {clip!r} stands twice" if clip else "the clip is not named",
                "Give one row a clip",
            )
        check_labels(where, cells)
        table[clip], places[clip] = cells, where
    return Labels(table, places)


def with_labels(motion: xr.Dataset, table: Labels | Mapping[str, Mapping[str, str]]) -> xr.Dataset:
    """Give a Motion the labels of a table.

    Parameters
    ----------
    motion
        Any Motion. Clips that are not in the table keep the labels they have.
    table
        What `read_labels` gave, or ``{clip: {label: text}}``. An empty text does not
        replace what is known already. The table of a file may be that of a whole study:
        its rows of clips that are not here are left alone.

    Raises
    ------
    InputError
        If a mapping has a clip that the Motion does not have, a file has none that it has, or
        a label bears a name that has a meaning of its own.
    """
    owners, known = motion["clip"].values, clips(motion)
    table = _rows_of(table, known) if isinstance(table, Labels) else Labels(table, {})
    columns: dict[str, np.ndarray] = {}
    for clip, labels in table.rows.items():
        where = table.places.get(clip, f"labels of {clip!r}")
        if clip not in known:
            raise InputError(
                where, f"there is no clip {clip!r}", f"Remove it; there are {', '.join(known)}"
            )
        check_labels(where, labels)
        for name, text in labels.items():
            old = columns.get(name)
            if old is None:
                old = motion[name].values if name in motion.coords else np.full(len(owners), "")
            columns[name] = np.where((owners == clip) & (text != ""), text, old)
    return motion.assign_coords({name: ("frame", values) for name, values in columns.items()})


def _rows_of(table: Labels, known: list[str]) -> Labels:
    """Return the rows of these clips; refuse a table that has none of them."""
    here = {clip: row for clip, row in table.rows.items() if clip in known}
    if not here and table.rows:
        other, place = next(iter(table.places.items()))
        raise InputError(
            place, f"it is of clip {other!r}, and no row is of {' or '.join(known)}",
            "Name clips as their files are called, without the suffix",
        )  # fmt: skip
    return Labels(here, {clip: table.places[clip] for clip in here})


def _numbered(reader) -> list[tuple[int, list[str]]]:
    """Give each row with the line it ends on."""
    return [(reader.line_num, row) for row in reader]


def _check_columns(where: str, columns: list[str]) -> None:
    """Refuse a head line without a column for the clip, or with unusable ones."""
    if "clip" not in columns or len(columns) < 2:
        raise InputError(
            where,
            f"the columns are {', '.join(columns) or 'missing'}",
            "Name the columns in the first line: clip and at least one label, such as gait",
        )
    for name in columns:
        if columns.count(name) > 1:
            raise InputError(
                where, f"two columns are called {name!r}", "Give each a name of its own"
            )
    check_labels(where, dict.fromkeys(set(columns) - {"clip"}, ""))
