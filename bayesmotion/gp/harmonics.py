"""The RBF kernel on a circle as a sum of harmonics.

Two points of the unit circle at the angles t and t' are apart by |x - x'|^2 = 2 - 2 cos(t - t'), so

    exp(-gamma / 2 |x - x'|^2) = exp(-gamma (1 - cos(t - t'))) = sum_j c_j cos(j (t - t')),
    c_0 = exp(-gamma) I_0(gamma),    c_j = 2 exp(-gamma) I_j(gamma),

with the modified Bessel functions I_j. All c_j are positive and their sum is one, so that what the
first J harmonics leave out is at most one minus their sum, at any two points. The ratios
r_j = I_j / I_(j-1) follow from 1 / r_j = 2 j / gamma + r_(j+1), downwards from a j where they are
next to nothing (Miller's algorithm), to full relative precision also of the smallest c_j.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int
from scipy.special import ive

from .linalg import AnyArray

# What harmonics may leave out of a kernel whose largest value is one: about its rounding.
TOLERANCE = 1e-14
# Harmonics beyond the last one wanted from which the ratios come downwards.
BEYOND = 40
# More than any kernel has of which at most forty are taken.
MOST = 200


def amplitudes(gamma: Float[AnyArray, ""], harmonics: int) -> Float[Array, " j"]:
    """Return sqrt(c_j) of j = 0 and of the harmonics.

    All are NaN where the harmonics leave out more than `TOLERANCE`: the kernel is sharper
    than they can tell.
    """
    gamma = jnp.asarray(gamma)

    def down(above: Array, j: Array) -> tuple[Array, Array]:
        ratio = gamma / (2.0 * j + gamma * above)
        return ratio, ratio

    order = jnp.arange(harmonics + BEYOND, 0, -1.0)
    _, ratios = jax.lax.scan(down, jnp.zeros_like(gamma), order)
    log = jnp.cumsum(jnp.log(ratios[::-1]))
    # Of I_j / I_0, j = 1, 2, ...; the exponential of half the logarithm has a derivative at zero.
    both = 2.0 * jnp.exp(log)
    whole = 1.0 + jnp.sum(both)
    found = jnp.concatenate([jnp.ones(1), jnp.sqrt(2.0) * jnp.exp(0.5 * log[:harmonics])])
    enough = jnp.sum(both[harmonics:]) <= TOLERANCE * whole
    return jnp.where(enough, found / jnp.sqrt(whole), jnp.nan)


def enough(gamma: float) -> int:
    """Return the smallest number of harmonics that leaves out `TOLERANCE` at most.

    Examples
    --------
    >>> enough(0.77)
    12
    """
    left = np.cumsum(2.0 * ive(np.arange(MOST, 0, -1), gamma))[::-1]
    return int(np.argmax(np.append(left, 0.0) <= 0.5 * TOLERANCE))


def fewest(gamma: Float[AnyArray, ""], choices: tuple[int, ...]) -> Int[Array, ""]:
    """Return which of ascending numbers of harmonics is enough, the last one if none is."""
    short = [jnp.isnan(amplitudes(gamma, harmonics)[0]) for harmonics in choices[:-1]]
    return jnp.sum(jnp.stack(short))


def waves(points: Float[AnyArray, "n 2"], amplitude: Float[AnyArray, " j"]) -> Float[Array, "n f"]:
    """Return features (N, 2 J + 1) of points of the circle whose inner products are the kernel.

    A constant, and for each harmonic its cosine and sine, with `amplitudes`.
    """
    harmonics = len(amplitude) - 1
    powers = _powers(points[:, 0] + 1j * points[:, 1], harmonics)
    both = jnp.stack([powers.real, powers.imag], axis=2) * amplitude[1:, None]
    constant = jnp.broadcast_to(amplitude[0], (len(points), 1))
    return jnp.concatenate([constant, both.reshape(len(points), 2 * harmonics)], axis=1)


def _powers(z: Complex[AnyArray, " n"], most: int) -> Complex[Array, "n m"]:
    """Return z, z^2, ... by products of few factors: each rounds once more."""
    out = jnp.asarray(z)[:, None]
    while out.shape[1] < most:
        out = jnp.concatenate([out, out * out[:, -1:]], axis=1)
    return out[:, :most]
