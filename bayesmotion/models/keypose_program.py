"""Keyposes as a generative program: a minimum near a beat is a keypose with a probability.

For the minimum b near a beat let g_b and h_b be the logarithms of its depth in the global
and in the body's frame, both standardised over all minima (`ABSENT` where that frame has no
minimum there), and o_b its distance from the beat in seconds. It is a keypose with

    p_b = [1 - (1 - sigma(slope (g_b - deep_global))) (1 - sigma(slope (h_b - deep_body)))]
          exp(-(o_b - lag)^2 / (2 width^2))
    keypose_b ~ Bernoulli(p_b)

    deep_global, deep_body ~ Normal(0, 1.5)     thresholds, in standard deviations of log depth
    log_slope ~ Normal(log 3, 0.7)              how sharp they are
    lag ~ Normal(0, 0.1 s)                      of keyposes behind the beat
    log_width ~ Normal(log 0.1 s, 0.5)

The two frames of reference act as alternatives, as in the paper's rule. Five numbers: few
enough for an ensemble sampler, which must agree with NUTS.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
from jax.nn import log_sigmoid
from jaxtyping import Float
from numpyro import distributions as dist

from ..errors import InputError
from ..gp.linalg import AnyArray
from .energy import Minima

ABSENT = -4.0
SITES = ("deep_global", "deep_body", "log_slope", "lag", "log_width")


class Minimums(NamedTuple):
    """What the program sees of the minima near beats.

    in_global, in_body
        (B,) standardised log depths.
    offset
        (B,) seconds behind the beat.
    frame
        (B,) the frame of the minimum.
    """

    in_global: Float[AnyArray, " b"]
    in_body: Float[AnyArray, " b"]
    offset: Float[AnyArray, " b"]
    frame: AnyArray


@dataclass(frozen=True)
class KeyposeProgram:
    """The model; see the module for the equations. It has no settings."""

    name = "keypose"

    def program(self, minima: Minimums, keypose: AnyArray | None = None) -> None:
        """The generative program; `keypose` (B,) is 1 for a keypose, 0 for none."""
        priors = {
            "deep_global": dist.Normal(0.0, 1.5),
            "deep_body": dist.Normal(0.0, 1.5),
            "log_slope": dist.Normal(np.log(3.0), 0.7),
            "lag": dist.Normal(0.0, 0.1),
            "log_width": dist.Normal(np.log(0.1), 0.5),
        }
        values = {name: jnp.asarray(numpyro.sample(name, d)) for name, d in priors.items()}
        p = probability(minima, **values)
        with numpyro.plate("minimum", len(minima.offset)):
            numpyro.sample("keypose", dist.BernoulliProbs(p), obs=keypose)

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of the sites."""
        return dict.fromkeys(SITES, ())


def probability(
    minima: Minimums,
    *,
    deep_global: AnyArray,
    deep_body: AnyArray,
    log_slope: AnyArray,
    lag: AnyArray,
    log_width: AnyArray,
) -> AnyArray:
    """Give the probability that each minimum is a keypose, away from 0 and 1 by 1e-9."""
    slope = jnp.exp(log_slope)
    neither = log_sigmoid(-slope * (minima.in_global - deep_global)) + log_sigmoid(
        -slope * (minima.in_body - deep_body)
    )
    near = jnp.exp(-0.5 * jnp.square((minima.offset - lag) / jnp.exp(log_width)))
    return jnp.clip(-jnp.expm1(neither) * near, 1e-9, 1.0 - 1e-9)


def minimums(
    in_global: Minima, in_body: Minima, beats: Float[np.ndarray, " b"], frame_rate: float
) -> Minimums:
    """Make the program's arrays of the minima near beats.

    A beat without a minimum in either frame of reference has no row. The frame of a row is
    that of the global minimum where there is one.

    Raises
    ------
    InputError
        If fewer than two beats have a minimum.
    """
    frame = np.where(in_global.frame >= 0, in_global.frame, in_body.frame)
    kept = frame >= 0
    if kept.sum() < 2:
        raise InputError(
            "keyposes",
            "fewer than two beats have a minimum",
            "Check the beats, or widen the window",
        )
    logs = [np.log(np.maximum(m.depth, 1e-9)) for m in (in_global, in_body)]
    columns = []
    for log in logs:
        there = log[np.isfinite(log)]
        scaled = (log - there.mean()) / max(float(there.std()), 1e-9) if len(there) else log
        columns.append(np.where(np.isfinite(scaled), np.maximum(scaled, ABSENT), ABSENT)[kept])
    offset = (frame - beats)[kept] / frame_rate
    return Minimums(columns[0], columns[1], offset, frame[kept])


def labels(minima: Minimums, keyposes: Sequence[int], tolerance: int) -> Float[np.ndarray, " b"]:
    """Tell which minima are keyposes: those within a tolerance in frames of a known one."""
    known = np.asarray(keyposes, dtype=int)
    if not len(known):
        return np.zeros(len(minima.frame))
    gap = np.abs(np.asarray(minima.frame)[:, None] - known[None]).min(axis=1)
    return (gap <= tolerance).astype(float)
