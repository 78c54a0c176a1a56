"""Keyposes as a generative program: a minimum near a beat is a keypose with a probability.

For the minimum b near a beat let g_b and h_b be the logarithms of its depth in the global
and in the body's frame, both standardised over the clip's minima (-4 where that frame has no
minimum there), and o_b its distance from the beat in seconds. It is a keypose with

    p_b = [1 - (1 - sigma(slope (g_b - deep_global))) (1 - sigma(slope (h_b - deep_body)))]
          exp(-(o_b - lag)^2 / (2 width^2))
    keypose_b ~ Bernoulli(p_b)

    deep_global, deep_body ~ Normal(0, 1.5)     thresholds, in standard deviations of log depth
    log_slope ~ Normal(log 3, 0.7)              how sharp they are
    lag ~ Normal(0, 0.1 s)                      of keyposes behind the beat
    log_width ~ Normal(log 0.1 s, 0.5)

The two frames of reference act as alternatives, as in the paper's rule. Minima whose answer
is not known have no part in the likelihood.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jax.nn import log_sigmoid
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import About, SBCCase, Values
from ...motion.dataset import skeleton_of
from ...motion.masses import joint_masses
from ...prediction import Bernoulli
from .data import KeyposeData, Recorded, recorded
from .example import example
from .flows import flows_of
from .sbc import small_case

Weights = Literal["equal", "masses"]


class TrainedKeyposes(NamedTuple):
    """One draw of the thresholds; see the module."""

    deep_global: AnyArray
    deep_body: AnyArray
    log_slope: AnyArray
    lag: AnyArray
    log_width: AnyArray


SITES = TrainedKeyposes._fields


@dataclass(frozen=True)
class Keyposes:
    """The model with its settings; see the module for the equations.

    Parameters
    ----------
    window
        Seconds around a beat in which minima are looked for; half the median time between
        beats where None.
    tolerance
        Seconds between a minimum and the keypose it stands for.
    smoothing
        Standard deviation in seconds of the Gaussian that takes noise out of positions.
    weights
        Of joints in the energy: ``equal``, or ``masses`` of the body's segments.

    Raises
    ------
    InputError
        If a time is not positive, or there are no such weights.
    """

    window: float | None = None
    tolerance: float = 0.1
    smoothing: float = 0.08
    weights: Weights = "equal"
    name: ClassVar[str] = "keyposes"
    about: ClassVar[About] = About(
        "Perera, Kudoh and Ikeuchi 2009", "clips with joint angles, beats and known keyposes"
    )

    def __post_init__(self) -> None:
        """Check the settings once."""
        times = (1.0 if self.window is None else self.window, self.tolerance)
        if not all(time > 0 for time in times) or self.smoothing < 0:
            raise InputError(
                "keyposes",
                f"window {self.window}, tolerance {self.tolerance}, smoothing {self.smoothing}",
                "Give positive seconds",
            )
        if self.weights not in ("equal", "masses"):
            raise InputError(
                f"weights {self.weights!r}", "there are no such weights", "Use equal or masses"
            )

    @classmethod
    def example(cls, seed: int = 0) -> tuple["Keyposes", xr.Dataset]:
        """Return the model, and two synthetic dances with beats and keyposes."""
        return cls(), example(seed)

    def prepare(self, recordings: xr.Dataset, trained: Recorded | None = None) -> Recorded:
        """Make dances into arrays: the energy minima near their beats.

        Parameters
        ----------
        recordings
            Clips with joint angles and ``beat`` (frame), and ``keypose`` (frame) where known;
            see `data.with_beats` and `data.with_keyposes`.
        trained
            The training dances, where `recordings` are new ones; of these no answer needs
            to be known.

        Raises
        ------
        InputError
            If there are no beats, fewer than two have a minimum, or for training no answer is
            known.
        """
        made = recorded(recordings, self._flows, self.window, self.tolerance)
        if trained is None and not np.asarray(made.minima.known).any():
            raise InputError(
                "keyposes", "no answer is known", "Add keyposes: with_keyposes(motion, frames)"
            )
        return made

    def program(self, data: KeyposeData, trained: TrainedKeyposes | None = None) -> None:
        """The generative program; with `trained` of new minima."""
        if trained is None:
            priors = {
                "deep_global": dist.Normal(0.0, 1.5),
                "deep_body": dist.Normal(0.0, 1.5),
                "log_slope": dist.Normal(np.log(3.0), 0.7),
                "lag": dist.Normal(0.0, 0.1),
                "log_width": dist.Normal(np.log(0.1), 0.5),
            }
            values = {name: jnp.asarray(numpyro.sample(name, d)) for name, d in priors.items()}
            trained = TrainedKeyposes(**values)
        answer = dist.BernoulliProbs(probability(data, trained)[:, None])
        numpyro.sample("keypose", answer.mask(data.known), obs=data.keypose)

    def initial_values(
        self, data: Any, seed: int, count: int, trained: TrainedKeyposes | None = None
    ) -> list[dict[str, np.ndarray]]:
        """Return values to begin the search from: the first fixed, others random about it."""
        if trained is not None:
            return [{}]
        random = np.random.default_rng(seed)
        centre = np.array([0.0, 0.0, np.log(3.0), 0.0, np.log(0.1)])
        scale = np.array([0.5, 0.5, 0.3, 0.03, 0.2])
        rows = [centre, *(centre + scale * random.normal(size=(count - 1, len(SITES))))]
        return [dict(zip(SITES, map(np.asarray, row), strict=True)) for row in rows]

    def condition(self, arrays: KeyposeData, values: Mapping[str, AnyArray]) -> TrainedKeyposes:
        """Return the thresholds of one draw."""
        return TrainedKeyposes(*(jnp.asarray(values[name]) for name in SITES))

    def predict(
        self, trained: TrainedKeyposes, arrays: KeyposeData, values: Mapping[str, AnyArray]
    ) -> dict[str, Bernoulli]:
        """Return the probability of each minimum to be a keypose; `values` is empty."""
        return {"keypose": Bernoulli(probability(arrays, trained)[:, None])}

    def identified(self, arrays: KeyposeData, values: Mapping[str, AnyArray]) -> Values:
        """Return the five sites: nothing can be said in two ways."""
        return {name: jnp.asarray(values[name]) for name in SITES}

    def pointwise(self, arrays: KeyposeData, values: Mapping[str, AnyArray]) -> Float[Array, " b"]:
        """Return the log probability of every answer that is known, zero of the others."""
        p = probability(arrays, self.condition(arrays, values))
        log = jnp.where(arrays.keypose[:, 0] > 0.5, jnp.log(p), jnp.log1p(-p))
        return jnp.where(arrays.known[:, 0], log, 0.0)

    def points(self, data: Recorded) -> dict[str, tuple[str, np.ndarray]]:
        """Return the clip and the frame of every minimum."""
        return {"clip": ("point", np.array(data.clip)), "frame": ("point", data.frame)}

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of the sites."""
        return dict.fromkeys(SITES, ()) | {"keypose": ("minimum", "answer")}

    def coords(self, data: Recorded) -> dict[str, list]:
        """Return the labels of the dimensions."""
        return {"minimum": list(range(len(data.clip))), "answer": ["keypose"]}

    def sbc_case(self) -> tuple[SBCCase, KeyposeData]:
        """Return this model of a few minima."""
        return small_case(self)

    def _flows(self, motion: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
        weight = joint_masses(skeleton_of(motion)) if self.weights == "masses" else None
        return flows_of(motion, weight, self.smoothing)


def probability(data: KeyposeData, at: TrainedKeyposes) -> Float[Array, " b"]:
    """Return the probability that each minimum is a keypose, away from 0 and 1 by 1e-9."""
    slope = jnp.exp(jnp.asarray(at.log_slope))
    neither = log_sigmoid(-slope * (data.in_global - at.deep_global)) + log_sigmoid(
        -slope * (data.in_body - at.deep_body)
    )
    near = jnp.exp(-0.5 * jnp.square((data.offset - at.lag) / jnp.exp(jnp.asarray(at.log_width))))
    return jnp.clip(-jnp.expm1(neither) * near, 1e-9, 1.0 - 1e-9)
