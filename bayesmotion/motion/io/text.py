"""Text files read line by line, with errors that name file and line."""

import math
from dataclasses import dataclass
from pathlib import Path

from ...errors import InputError


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

    Line numbers are those of an editor, whether lines end with LF or CR LF. Comment
    lines may hold any 8-bit characters, as old recordings do.

    Raises
    ------
    InputError
        If there is no such file, it is empty, or it holds bytes that are not text.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(path, f"it cannot be read ({error.strerror})", "Check the path") from error
    if not content.strip():
        raise InputError(path, "the file is empty", "Get it again from where it came from")
    content = content.removeprefix(b"\xef\xbb\xbf")
    lines = [
        Line(path, number, text.strip())
        for number, text in enumerate(content.decode("latin-1").split("\n"), start=1)
    ]
    for line in lines:
        if not line.text.isprintable() and not line.text.startswith("#"):
            _check_characters(line)
    return lines


def _check_characters(line: Line) -> None:
    """Refuse control characters: a text file of any 8-bit encoding has none."""
    for character in line.text:
        if (character < " " or character == "\x7f") and character not in "\t\r":
            raise line.error(
                f"the byte {ord(character):#04x} is not text", "Give a text file, not a binary one"
            )


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
    values = []
    for word in words:
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        # Python alone reads 1_0 as ten.
        if not math.isfinite(value) or "_" in word:
            raise line.error(f"{word!r} is not a finite number", "Correct or remove it")
        values.append(value)
    return tuple(values)
