"""The grid of people and gaits that synthetic walkers fill, checked once."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from .gaits import GAITS

_STATURES = (1.60, 1.88)  # metres: about the 5th to 95th percentile of adults
_SPREAD = 0.9  # how far from the mean the most unusual person's style is


@dataclass(frozen=True)
class Grid:
    """Settings of the synthetic walkers; see `synthetic.synthetic_walkers`.

    Raises
    ------
    InputError
        If no grid can be made of the settings.
    """

    subjects: Sequence[str]
    gaits: Sequence[str]
    seconds: float
    frame_rate: float
    styles: int
    seed: int

    def __post_init__(self) -> None:
        """Refuse settings no grid can be made of."""
        for what, names in (("subjects", self.subjects), ("gaits", self.gaits)):
            if isinstance(names, str) or not all(names) or not 0 < len(names) == len(set(names)):
                raise InputError(what, f"they are {names!r}", "Give different names, at least one")
        for gait in self.gaits:
            if gait not in GAITS:
                raise InputError(f"gait {gait!r}", "it is not known", f"Use some of {list(GAITS)}")
        for what, value in (("seconds", self.seconds), ("frame_rate", self.frame_rate)):
            if not (np.isfinite(value) and value > 0):
                raise InputError(what, f"it is {value}", "Give a positive number")
        if self.frames < 2:
            raise InputError("seconds", f"that makes {self.frames} frames", "Give more seconds")
        if self.styles not in (1, 2):
            raise InputError("styles", f"it is {self.styles}", "Use 1 or 2")
        if self.seed < 0:
            raise InputError("seed", f"it is {self.seed}", "Use an integer from 0 on")

    @property
    def frames(self) -> int:
        """Number of frames of every clip."""
        return round(self.seconds * self.frame_rate)

    def clip(self, subject: str, gait: str) -> str:
        """Give the name of a cell's clip.

        Raises
        ------
        InputError
            If the grid has no such cell.
        """
        if subject not in self.subjects or gait not in self.gaits:
            raise InputError(
                f"cell ({subject!r}, {gait!r})",
                "it is not in the grid",
                f"Use subjects of {list(self.subjects)} and gaits of {list(self.gaits)}",
            )
        return f"{subject}-{gait}"

    def clips_but(self, left_out: Iterable[tuple[str, str]]) -> list[str]:
        """Give the names of the clips of all cells but some.

        Raises
        ------
        InputError
            If one of these is not in the grid, or no other cell is left.
        """
        dropped = {self.clip(*cell) for cell in left_out}
        every = [self.clip(subject, gait) for subject in self.subjects for gait in self.gaits]
        kept = [clip for clip in every if clip not in dropped]
        if not kept:
            raise InputError("leave_out", "no cell of the grid is left", "Leave out fewer")
        return kept

    def random(self, *purpose: str) -> np.random.Generator:
        """Give the random numbers of one purpose, so that no purpose disturbs another."""
        return np.random.default_rng([self.seed, *"/".join(purpose).encode()])

    def statures(self) -> Float[np.ndarray, " subject"]:
        """Draw every person's height in metres."""
        return np.array([self.random("stature", n).uniform(*_STATURES) for n in self.subjects])

    def first_phase(self, subject: str, gait: str) -> float:
        """Draw the phase in radians at which a cell's clip starts."""
        return self.random("phase", self.clip(subject, gait)).uniform(0, 2 * np.pi)

    def style_vectors(self) -> Float[np.ndarray, "subject 3"]:
        """Spread the styles evenly, on a line or on a circle through style space."""
        number, random = len(self.subjects), self.random("styles")
        turn = random.uniform(0, 2 * np.pi)
        if self.styles == 1:
            along = np.linspace(-1, 1, number) if number > 1 else np.zeros(1)
            place = along[:, None] * np.array([np.cos(turn), np.sin(turn)])
        else:
            angle = turn + np.arange(number) * 2 * np.pi / number
            place = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.column_stack([np.ones(number), _SPREAD * random.permutation(place)])
