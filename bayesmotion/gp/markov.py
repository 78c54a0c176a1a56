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
    """Where the frames of clips lie: T places in each of L lanes, B blocks of places.

    frame
        (T, L) the frame, or the number of frames where there is none.
    follows
        (T, L) 1 where the place before has the clip's frame before, else 0.
    clip
        (B, L) the clip of each block, zero for one that is empty.
    """

    frame: Int[AnyArray, "t l"]
    follows: Float[AnyArray, "t l"]
    clip: Int[AnyArray, "b l"]

    def placed(self, values: Float[AnyArray, "n ..."]) -> Float[Array, "t l ..."]:
        """Return values of frames where they lie, zero elsewhere."""
        return jnp.take(jnp.asarray(values), self.frame, axis=0, mode="fill", fill_value=0.0)

    def taken(self, placed: Float[AnyArray, "t l ..."], frames: int) -> Float[Array, "n ..."]:
        """Return values of so many frames that lie in lanes."""
        out = jnp.zeros((frames, *placed.shape[2:]), dtype=placed.dtype)
        return out.at[self.frame].set(placed, mode="drop")

    def of_clips(self, values: Float[AnyArray, " c"]) -> Float[Array, "t l"]:
        """Return values of clips at the places of their blocks."""
        return jnp.repeat(jnp.asarray(values)[self.clip], self._size, axis=0)

    def blocks(self, placed: Float[AnyArray, "t l k"]) -> Float[Array, "m s k"]:
        """Return what lies in lanes block by block, in the order of `clip`."""
        blocks, lanes = self.clip.shape
        apart = jnp.reshape(placed, (blocks, self._size, lanes, placed.shape[2]))
        return jnp.swapaxes(apart, 1, 2).reshape(blocks * lanes, self._size, placed.shape[2])

    @property
    def _size(self) -> int:
        return self.frame.shape[0] // self.clip.shape[0]


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
    return Lanes(frame.T, follows.T, owner.T)


def whiten(
    z: Float[AnyArray, "t l k"],
    seen: Float[AnyArray, "t l"],
    decay: Float[AnyArray, "t l"],
    variance: Float[AnyArray, "t l"],
    noise: Float[AnyArray, "t l"],
) -> tuple[Float[Array, "t l k"], Float[Array, ""]]:
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
        nu; anything where not seen.
    """

    def step(spread: Array, now: tuple[Array, Array, Array, Array]) -> tuple:
        known, decay, fresh, noise = now
        spread = decay**2 * spread + fresh
        total = jnp.where(known > 0.0, spread + noise, 1.0)
        gain = known * spread / total
        return (1.0 - gain) * spread, (gain, known / jnp.sqrt(total), known * jnp.log(total))

    seen, decay = jnp.asarray(seen), jnp.asarray(decay)
    fresh = (1.0 - decay**2) * jnp.asarray(variance)
    rows = (seen, decay, fresh, jnp.asarray(noise))
    _, (gain, scale, log) = jax.lax.scan(step, jnp.zeros_like(seen[0]), rows)
    return errors(z, decay, gain) * scale[:, :, None], jnp.sum(log)


@jax.custom_vjp
def errors(
    z: Float[AnyArray, "t l k"], decay: Float[AnyArray, "t l"], gain: Float[AnyArray, "t l"]
) -> Float[Array, "t l k"]:
    """Return z_t - m_t, with the mean of the past m_t = decay_t (m + gain (z - m))_(t-1)."""
    return _errors(z, decay, gain)


def _errors(z, decay, gain):
    def step(learned: Array, now: tuple[Array, Array, Array]) -> tuple[Array, Array]:
        value, decay, gain = now
        off = value - decay[:, None] * learned
        return value - (1.0 - gain[:, None]) * off, off

    rows = (jnp.asarray(z), jnp.asarray(decay), jnp.asarray(gain))
    return jax.lax.scan(step, jnp.zeros_like(rows[0][0]), rows)[1]


def _errors_forward(z, decay, gain):
    off = _errors(z, decay, gain)
    return off, (z, decay, gain, off)


def _errors_backward(saved, on_off):
    """What reaches the mean learned at a frame comes from later ones."""
    z, decay, gain, off = saved

    def step(on_learned: Array, now: tuple[Array, ...]) -> tuple:
        z, decay, gain, off, on_off = now
        on_mean = (1.0 - gain[:, None]) * on_learned - on_off
        on_decay = jnp.sum(on_mean * (z - off), axis=1)
        on_gain = jnp.sum(on_learned * off, axis=1)
        return decay[:, None] * on_mean, (on_learned - on_mean, on_decay, on_gain)

    rows = (z, decay, gain, off, on_off)
    _, (on_z, on_decay, on_gain) = jax.lax.scan(step, jnp.zeros_like(z[0]), rows, reverse=True)
    # The mean is decay times what was learned; that of a first frame is zero, whatever it was.
    first = decay == 0.0
    return on_z, jnp.where(first, 0.0, on_decay / jnp.where(first, 1.0, decay)), on_gain


errors.defvjp(_errors_forward, _errors_backward)


def draw(
    white: Float[AnyArray, "t l k"],
    decay: Float[AnyArray, "t l"],
    variance: Float[AnyArray, "t l"],
) -> Float[Array, "t l k"]:
    """Return columns of u made of independent standard normal ones."""

    def step(u: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        u = now[0][:, None] * u + now[1]
        return u, u

    decay, white = jnp.asarray(decay), jnp.asarray(white)
    rows = (decay, jnp.sqrt((1.0 - decay**2) * variance)[:, :, None] * white)
    return jax.lax.scan(step, jnp.zeros_like(white[0]), rows)[1]
