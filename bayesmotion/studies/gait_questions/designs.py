"""Simulated designs: people, their strides, and a difference between two conditions.

Curves are smooth Gaussian fields of 101 phases, those that spm1d is validated with: white noise
filtered with a Gaussian of a full width at half maximum (FWHM) in per cent of the cycle. Of the
difference all is zero but for a bump.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from ...motion.io.curves import read_curves

PHASES, MARGIN = 101, 150
BUMP_AT, BUMP_SD = 40.0, 8.0


@dataclass(frozen=True)
class Simulated:
    """A design.

    people
        In pairs, or by group.
    fwhm
        Of all fields, in per cent.
    strides
        Of people in turn, in each condition.
    people_sd, both_sd, stride_sd
        Of people in a condition, of people in both alike, and of strides.
    bump
        Height of the difference.
    narrow
        The sds fall to this share away from a part of the cycle.
    wider
        The sd of the second group's people over that of the first.
    """

    people: tuple[int, ...]
    fwhm: float
    strides: tuple[int, ...] = (1,)
    people_sd: float = 1.0
    both_sd: float = 2.0
    stride_sd: float = 0.0
    bump: float = 1.5
    narrow: float = 1.0
    wider: float = 1.0

    @property
    def paired(self) -> bool:
        """Whether everybody is seen in both conditions."""
        return len(self.people) == 1


# Strides of people of whom some were hardly seen.
FEW_OR_MANY = (1, 1, 2, 3, 12, 16, 20, 24)
DESIGNS = {
    "pairs": Simulated((8,), 20.0, bump=2.2),
    "pairs of strides, unbalanced": Simulated((8,), 20.0, FEW_OR_MANY, 0.5, stride_sd=2.0),
    "groups of strides, unbalanced": Simulated(
        (8, 8), 20.0, FEW_OR_MANY, 0.7, both_sd=0.0, stride_sd=2.0, bump=1.5
    ),
    "pairs, rough": Simulated((6,), 10.0, bump=3.0),
    "groups": Simulated((8, 8), 20.0, both_sd=0.0, bump=1.8),
    "pairs, sd changes over the cycle": Simulated((8,), 15.0, bump=2.5, narrow=0.2),
    "pairs of strides": Simulated((8,), 20.0, (10,), 0.7, stride_sd=2.0),
    "groups, one differs twice as much": Simulated(
        (6, 10), 20.0, both_sd=0.0, bump=3.0, wider=2.0
    ),
    "six pairs of strides, unbalanced": Simulated(
        (6,), 20.0, FEW_OR_MANY[::2], 0.5, stride_sd=2.0, bump=2.0
    ),
    "groups, rough": Simulated((6, 6), 10.0, both_sd=0.0, bump=2.4),
}  # fmt: skip


def simulated(design: Simulated, random: np.random.Generator) -> xr.DataArray:
    """Return strides with the labels ``subject`` and ``condition`` (``a`` and ``b``)."""
    sd = envelope(design)
    curves: list[np.ndarray] = []
    subject: list[str] = []
    condition: list[str] = []
    sides = "ab" if design.paired else ""
    people = [(name, group) for group, count in enumerate(design.people) for name in range(count)]
    for number, (name, group) in enumerate(people):
        common = design.both_sd * _field(random, design.fwhm)
        for side in sides or "ab"[group]:
            spread = design.people_sd * (design.wider if group else 1.0)
            own = common + spread * _field(random, design.fwhm)
            lifted = own * sd + (difference_of(design) if side == "a" else 0.0)
            # Numbers of strides are as unbalanced in one group as in the other.
            for _ in range(design.strides[name % len(design.strides)]):
                curves.append(lifted + design.stride_sd * sd * _field(random, design.fwhm))
                subject.append(f"p{number}")
                condition.append(side)
    return read_curves(np.array(curves), labels={"subject": subject, "condition": condition})


def difference_of(design: Simulated) -> Float[np.ndarray, " t"]:
    """Return the true difference."""
    at = np.arange(PHASES) - BUMP_AT
    return design.bump * np.exp(-0.5 * (at / BUMP_SD) ** 2) * envelope(design)


def bump_phases() -> np.ndarray:
    """Return where a difference is to be found: at more than half the bump's height."""
    return np.abs(np.arange(PHASES) - BUMP_AT) < BUMP_SD * np.sqrt(2.0 * np.log(2.0))


def envelope(design: Simulated) -> Float[np.ndarray, " t"]:
    """Return the sd over the cycle, as a share of the largest."""
    wave = np.exp(-0.5 * ((np.arange(PHASES) - 55.0) / 14.0) ** 2)
    return design.narrow + (1.0 - design.narrow) * wave


def _field(random: np.random.Generator, fwhm: float) -> Float[np.ndarray, " t"]:
    sd = fwhm / np.sqrt(8.0 * np.log(2.0))
    white = random.standard_normal(PHASES + 2 * MARGIN)
    field = gaussian_filter1d(white, sd, mode="constant")[MARGIN:-MARGIN]
    return field * np.sqrt(2.0 * sd * np.sqrt(np.pi))
