"""The one way bayesmotion says that something given to it cannot be used.

Every message is a sentence with three parts: where, what, and what to do.
"""


class InputError(ValueError):
    """An input that cannot be used: where it is, what is wrong, and what to do.

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
        super().__init__(f"{where}: {what.rstrip('.')}. {mend.rstrip('.')}.")


class NumericalError(ArithmeticError):
    """A computation that broke down (for example a Cholesky factorisation), told by site."""


class MotionWarning(UserWarning):
    """Something suspicious that does not stop the work."""
