"""The one way bayesmotion says that something given to it cannot be used.

Every message is a sentence with three parts: where, what, and what to do.
"""


class InputError(ValueError):
    """An input that cannot be used, told as *where: what. what to do.*, on one line.

    What a file has where text belongs is shown escaped: a terminal would act on it.

    Parameters
    ----------
    where
        The file, file and line (``walk.amc:12``), clip, site or argument at fault.
    what
        What is wrong there.
    mend
        What the user can do about it.
    """

    def __init__(self, where: object, what: str, mend: str) -> None:
        self.where, self.what, self.mend = str(where), what, mend
        told = f"{where}: {what.rstrip('.')}. {mend.rstrip('.')}."
        super().__init__("".join(map(_shown, told)))


def _shown(character: str) -> str:
    """Return a character as it can be printed."""
    return character if character.isprintable() else ascii(character)[1:-1]


class NumericalError(ArithmeticError):
    """A computation that broke down (for example a Cholesky factorisation), told by site."""


class MotionWarning(UserWarning):
    """Something suspicious that does not stop the work."""
