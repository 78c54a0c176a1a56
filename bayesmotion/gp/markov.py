"""Ornstein-Uhlenbeck processes of many clips with white noise: whitened in O(N).

Of each clip u is a process of its own, seen with noise of variance nu,

    u_t ~ N(0, sigma^2),   cov(u_s, u_t) = sigma^2 exp(-|s - t| / tau),   z_t = u_t + e_t.

u is Markov, so a scalar Kalman filter gives one step's prediction of z_t from the past of its
clip, with variance F_t: what it misses, divided by sqrt(F_t), is white, and the log determinant of
the covariance of z is the sum of log F_t. The gains do not depend on z, so any number of columns
is whitened by the same ones. A frame that is not seen has gain zero.

Clips lie in lanes, one after another, padded to blocks of frames: all lanes are filtered
at once, and a block belongs to one clip.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .linalg import AnyArray

BLOCK = 64


class Lanes(NamedTuple):
    """Where the frames of clips lie: L lanes of T places, B blocks each.

    frame
        (L, T) the frame, or the number of frames where there is none.
    follows
        (L, T) 1 where the place before has the clip's frame before, else 0.
    clip
        (L, B) the clip of each block, zero for one that is empty.
    """

    frame: Int[AnyArray, "l t"]
    follows: Float[AnyArray, "l t"]
    clip: Int[AnyArray, "l b"]

    def placed(self, values: Float[AnyArray, "n ..."]) -> Float[Array, "l t ..."]:
        """Return values of frames where they lie, zero elsewhere."""
        return jnp.take(jnp.asarray(values), self.frame, axis=0, mode="fill", fill_value=0.0)

    def taken(self, placed: Float[AnyArray, "l t ..."], frames: int) -> Float[Array, "n ..."]:
        """Return values of so many frames that lie in lanes."""
        out = jnp.zeros((frames, *placed.shape[2:]), dtype=placed.dtype)
        return out.at[self.frame].set(placed, mode="drop")

    def of_clips(self, values: Float[AnyArray, " c"]) -> Float[Array, "l t"]:
        """Return values of clips at the places of their blocks."""
        each = jnp.asarray(values)[self.clip]
        return jnp.repeat(each, self.frame.shape[1] // self.clip.shape[1], axis=1)

    def blocks(self, placed: Float[AnyArray, "l t k"]) -> Float[Array, "b s k"]:
        """Return what lies in lanes block by block."""
        size = self.frame.size // self.clip.size
        return jnp.reshape(placed, (self.clip.size, size, placed.shape[2]))


def lanes_of(sizes: Sequence[int]) -> Lanes:
    """Lay out clips of so many frames, which follow each other among all frames.

    A lane is as long as the longest clip; shorter ones share one.
    """
    size = min(BLOCK, max(sizes))
    blocks = [-(-frames // size) for frames in sizes]
    longest, begin = max(blocks), np.concatenate([[0], np.cumsum(sizes)])
    lanes: list[list[int]] = []
    free: list[int] = []
    for clip in sorted(range(len(sizes)), key=lambda clip: -blocks[clip]):
        lane = next((i for i, left in enumerate(free) if left >= blocks[clip]), len(lanes))
        if lane == len(lanes):
            lanes.append([])
            free.append(longest)
        lanes[lane].append(clip)
        free[lane] -= blocks[clip]
    frame = np.full((len(lanes), longest * size), begin[-1])
    follows, owner = np.zeros(frame.shape), np.zeros((len(lanes), longest), int)
    for lane, clips in enumerate(lanes):
        place = 0
        for clip in clips:
            frame[lane, place : place + sizes[clip]] = np.arange(begin[clip], begin[clip + 1])
            follows[lane, place + 1 : place + sizes[clip]] = 1.0
            owner[lane, place // size : place // size + blocks[clip]] = clip
            place += size * blocks[clip]
    return Lanes(frame, follows, owner)


def whiten(
    z: Float[AnyArray, "l t k"],
    seen: Float[AnyArray, "l t"],
    decay: Float[AnyArray, "l t"],
    variance: Float[AnyArray, "l t"],
    noise: Float[AnyArray, ""],
) -> tuple[Float[Array, "l t k"], Float[Array, ""]]:
    """Return the whitened columns, zero where not seen, and the log determinant.

    Parameters
    ----------
    z
        K columns; anything finite where not seen.
    seen
        1 where seen, else 0.
    decay
        Correlation of u with the frame before, zero at the first frame of a clip.
    variance
        sigma^2 of the clip.
    noise
        nu.
    """
    decay, variance = jnp.asarray(decay), jnp.asarray(variance)

    def step(state: tuple[Array, Array], now: tuple[Array, ...]) -> tuple:
        mean, spread = state
        value, known, decay, fresh = now
        mean, spread = decay[:, None] * mean, decay**2 * spread + fresh
        off = known[:, None] * (value - mean)
        gain = known * spread / (spread + noise)
        return (mean + gain[:, None] * off, (1.0 - gain) * spread), (off, spread + noise)

    begin = (jnp.zeros((z.shape[0], z.shape[2])), jnp.zeros(z.shape[0]))
    rows = (z, seen, decay, (1.0 - decay**2) * variance)
    over_time = tuple(jnp.swapaxes(jnp.asarray(row), 0, 1) for row in rows)
    _, (off, total) = jax.lax.scan(step, begin, over_time)
    white = jnp.swapaxes(off / jnp.sqrt(total)[:, :, None], 0, 1)
    return white, jnp.sum(jnp.asarray(seen) * jnp.log(total).T)


def draw(
    white: Float[AnyArray, "l t k"],
    decay: Float[AnyArray, "l t"],
    variance: Float[AnyArray, "l t"],
) -> Float[Array, "l t k"]:
    """Return columns of u made of independent standard normal ones."""
    decay = jnp.asarray(decay)
    fresh = jnp.sqrt((1.0 - decay**2) * variance)[:, :, None] * white

    def step(u: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        u = now[0][:, None] * u + now[1]
        return u, u

    over_time = (decay.T, jnp.swapaxes(fresh, 0, 1))
    return jnp.swapaxes(jax.lax.scan(step, jnp.zeros_like(fresh[:, 0]), over_time)[1], 0, 1)
