"""Text files read line by line, with errors that name file and line."""

import math
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from ...errors import InputError, MotionWarning


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a file: where it stands and what it says, without surrounding spaces."""

    path: Path
    number: int
    text: str

    @property
    def words(self) -> list[str]:
        """What stands between the spaces."""
        return self.text.split()

    def error(self, what: str, mend: str) -> InputError:
        """Make the error that names this line."""
        return InputError(f"{self.path}:{self.number}", what, mend)


def read_lines(path: Path) -> list[Line]:
    """Read a text file whole.

    Line numbers are those of an editor, whether lines end with LF, CR LF or CR. What old
    programs leave at the end (Ctrl-Z, NUL) is no part of the text. The encoding is found out
    as in `_decoded`.

    Raises
    ------
    InputError
        If there is no such file, it is empty, or it holds bytes that are not text.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(path, f"it cannot be read ({error.strerror})", "Check the path") from error
    text = _decoded(content).rstrip("\x00\x1a \t\r\n")
    if not text:
        raise InputError(path, "the file is empty", "Get it again from where it came from")
    lines = [
        Line(path, number, line.strip())
        for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1)
    ]
    for line in lines:
        if not line.text.isprintable() and not line.text.startswith("#"):
            _check_characters(line)
    return lines


def _decoded(content: bytes) -> str:
    """Turn bytes into text: UTF-16 where they say so, UTF-8 if they are, Shift-JIS or Latin-1.

    Bytes 0x81 to 0x9f are no letters of Latin-1, but every second one begins a Japanese
    character in Shift-JIS.
    """
    for mark, encoding in ((b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if content.startswith(mark):
            return content[2:].decode(encoding, errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        pass
    if re.search(rb"[\x81-\x9f]", content):
        try:
            return content.decode("cp932")
        except UnicodeDecodeError:
            pass
    return content.decode("latin-1")


def _check_characters(line: Line) -> None:
    """Refuse control characters: a text file of any encoding has none."""
    for character in line.text:
        if (character < " " or character == "\x7f") and character != "\t":
            raise line.error(
                f"the byte {ord(character):#04x} is not text", "Give a text file, not a binary one"
            )


def without_comments(lines: Iterable[Line]) -> list[Line]:
    """Leave out comments, which go from a # on, and lines of which nothing stays."""
    cut = [replace(line, text=re.sub(r"(^|\s)#.*", "", line.text)) for line in lines]
    return [line for line in cut if line.text]


def numbers(line: Line, words: list[str], count: int) -> tuple[float, ...]:
    """Read exactly `count` finite numbers.

    Raises
    ------
    InputError
        If there are more or fewer, or one is not a finite number.
    """
    if len(words) != count:
        raise line.error(
            f"{len(words)} values where {count} belong", f"Give {count} after {line.words[0]!r}"
        )
    return tuple(number(line, word) for word in words)


def number(line: Line, word: str) -> float:
    """Read a finite number.

    Raises
    ------
    InputError
        If it is something else.
    """
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    # Python alone reads 1_0 as ten.
    if math.isfinite(value) and "_" not in word:
        return value
    if re.fullmatch(r"[-+\d.eE]*,[-+\deE]*", word):
        what = f"{word!r} is not a finite number: it has a decimal comma"
        raise line.error(what, "Write numbers with decimal points")
    raise line.error(f"{word!r} is not a finite number", "Correct or remove it")


def numbered(names: Iterable[str]) -> list[str]:
    """Give every name once: a second LKNE becomes LKNE_2."""
    wanted = list(names)
    taken, given = set(wanted), []
    seen: set[str] = set()
    for name in wanted:
        if name in seen:
            count = 2
            while f"{name}_{count}" in taken:
                count += 1
            name = f"{name}_{count}"
            taken.add(name)
        seen.add(name)
        given.append(name)
    return given


def unique(line: Line, names: list[str]) -> list[str]:
    """Number names that stand twice, and warn of it."""
    given = numbered(names)
    new = [after for before, after in zip(names, given, strict=True) if before != after]
    if new:
        warnings.warn(
            f"{line.path}:{line.number}: names that stand twice were numbered: {', '.join(new)}",
            MotionWarning,
            stacklevel=4,
        )
    return given


def row_of(line: Line) -> list[str]:
    """Read the cells of a row: between tabs, where there are any, else between spaces."""
    if "\t" in line.text:
        return [cell.strip() for cell in line.text.split("\t")]
    return line.words
