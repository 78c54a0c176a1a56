"""Where the search for a point estimate of the multifactor model begins.

Everything here looks only at the frames it is given: phases and steps come from
the spectrum of the clip, content from principal components or the estimated
phases, styles from a random draw around one common vector.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ...distributions.circle import circle
from ...distributions.dynamics import path_root, path_scale
from ...distributions.styles import entries_of
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import complete, misfit_of_columns
from .frames import Frames
from .prediction import Trained
from .program import MultifactorProgram
from .settings import White

# Cycles a second that a gait may have; the search for the step stays inside.
CYCLES_PER_SECOND = (0.4, 2.5)
# About how precisely poses tell a place of the content: some tens of features, each
# about a hundred times its noise. It scales the search and has no part in the density.
PATH_PRECISION = 1e4


def cycle(
    y: Float[np.ndarray, "n d"], frame_rate: float
) -> tuple[float, Complex[np.ndarray, " d"]]:
    """Estimate the angular frequency of a periodic clip and its first harmonic.

    The frequency (radians a frame) has the largest summed power of a Hann window's
    periodogram over the columns; the harmonic is every column's complex amplitude
    at it, with time counted from the middle of the clip.
    """
    n = len(y)
    low, high = (2.0 * np.pi * f / frame_rate for f in CYCLES_PER_SECOND)
    # Slower than one and a half cycles in the clip cannot be told from a drift.
    low = min(max(low, 3.0 * np.pi / n), high)
    frequencies = np.linspace(low, high, 400)
    time = np.arange(n) - (n - 1) / 2.0
    window = np.hanning(n + 2)[1:-1, None]
    centred = (y - np.average(y, axis=0, weights=window[:, 0])) * window
    waves = np.exp(-1j * frequencies[:, None] * time)
    amplitude = waves @ centred
    best = int(np.argmax(np.sum(np.abs(amplitude) ** 2, axis=1)))
    return float(frequencies[best]), amplitude[best]


def phases(frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the phase at each clip's middle and its step, in one common phase.

    Clips are brought into one phase by the leading singular vector of their first
    harmonics: two clips whose columns swing alike differ by a turn of that vector.
    """
    y, clip = np.asarray(frames.y), np.asarray(frames.clip)
    rate = float(frames.frame_rate)
    found = [cycle(y[clip == c], rate) for c in range(frames.n_clips)]
    # A clip in which nothing moves has no phase.
    amplitude = np.stack([a / max(np.linalg.norm(a), np.finfo(float).tiny) for _, a in found])
    common = np.linalg.svd(amplitude, full_matrices=False)[0][:, 0]
    return np.angle(common), np.array([step for step, _ in found])


def preconditioners(
    model: MultifactorProgram,
    frames: Frames,
    start: Mapping[str, AnyArray],
    trained: Trained | None = None,
) -> dict[str, AnyArray]:
    """Root of the approximate covariance of a latent path near a start, for `maximise`."""
    if model.on_circle:
        return {}
    alpha = model.dynamics_alpha(start if trained is None else trained.hyper)
    past = None if trained is None else trained.steps
    weight = model.balance(frames.y.shape[1])
    return {"x": path_root(alpha, start["x"], frames.steps, past, weight, PATH_PRECISION)}


def training_values(
    model: MultifactorProgram,
    frames: Frames,
    seed: int,
    count: int,
    on_circle: Mapping[str, AnyArray] | None = None,
) -> list[dict[str, np.ndarray]]:
    """Give `count` starting values of the program's sites for training.

    Parameters
    ----------
    model, frames
        What is fitted to what.
    seed
        Of the random part.
    count
        Number of starts.
    on_circle
        Site values of the same model with circle dynamics fitted to the same frames:
        the first start of other dynamics is that fit, its content in the plane.
    """
    random = np.random.default_rng(seed)
    middle, step = phases(frames)
    starts = []
    for index in range(count):
        start = _training_value(model, frames, middle, step, index, random)
        if on_circle is not None:
            start |= _nested(model, frames, on_circle, start, index)
        starts.append(start)
    return starts


def _training_value(model, frames, middle, step, index, random) -> dict[str, np.ndarray]:
    values: dict[str, np.ndarray] = {"gamma": np.array(1.0), "beta": np.array(100.0)}
    if not isinstance(model.residual, White):
        each = np.ones(frames.n_clips if model.per_clip else 1)
        values |= {
            "residual_variance": 0.01 * each,
            "residual_time": frames.frame_rate / 3.0 * each,
        }
    for factor, levels in zip(model.style_factors, frames.levels, strict=True):
        common = np.full(factor.size, factor.size**-0.5)
        styles = common + 0.5 * random.normal(size=(levels, factor.size))
        if factor.kind == "linear":
            values[f"shape_{factor.name}"] = np.asarray(entries_of(styles))
        else:
            values[f"style_{factor.name}"] = styles
    if model.on_circle:
        values |= {"phase_point": np.asarray(circle(middle[1:] - middle[0])), "step": step}
    else:
        values |= {"alpha": np.array(model.alpha_median(float(frames.frame_rate)))}
        values |= {"x": _content(model, frames, middle, step, index, random)}
    return values | {"scale": _scale(model, frames, values)}


def _nested(model, frames, on_circle, start, index) -> dict[str, np.ndarray]:
    """Take from the circle's fit what the models share, and on even starts its content."""
    shared = {name: np.asarray(value) for name, value in on_circle.items() if name in start}
    if index % 2 == 1 or model.path.size < 2:
        return shared
    clip = np.asarray(frames.clip)
    angle = on_circle["phase"][clip] + on_circle["step"][clip] * np.asarray(frames.time)
    # Pairs of columns go round once, twice, ...; the later ones are small and smooth, but
    # not nothing, where the gradient along them is none.
    turns = [circle((1 + k) * angle) for k in range((model.path.size + 1) // 2)]
    size = np.where(np.arange(model.path.size) < 2, 1.0, 0.1)
    x = np.concatenate(turns, axis=1)[:, : model.path.size] * size
    # The content is brought to unit scale, and its length scale with it.
    scale = np.asarray(path_scale(x, frames.steps))
    return shared | {"x": x / scale, "gamma": np.asarray(on_circle["gamma"] * scale**2)}


def _content(model, frames, middle, step, index, random) -> Float[np.ndarray, "n q"]:
    """Principal components on odd starts, on even ones the circle of estimated phases."""
    n, q = len(frames.clip), model.path.size
    y = np.asarray(frames.y)
    if index % 2 == 1 or q < 2:
        left, size, _ = np.linalg.svd(y - y.mean(axis=0), full_matrices=False)
        x = left[:, :q] * size[:q]
        x = x / np.asarray(path_scale(x, frames.steps))
        return x + 0.01 * (index > 1) * random.normal(size=(n, q))
    clip = np.asarray(frames.clip)
    angle = middle[clip] + step[clip] * np.asarray(frames.time)
    x = 0.05 * random.normal(size=(n, q))
    x[:, 0] += np.cos(angle)
    x[:, 1] += np.sin(angle)
    return x


def _scale(model: MultifactorProgram, frames: Frames, values: Mapping) -> Float[np.ndarray, " d"]:
    """Give the scales that are best for the other values: w_d^2 = N / (y_d^T K^-1 y_d)."""
    n, quadratic = len(frames.clip), np.asarray(_quadratic(model, frames, dict(values)))
    # Of a feature that is never seen nothing is known.
    return np.sqrt(n / np.where(quadratic > 0.0, np.maximum(quadratic, 1e-12), n))


@partial(jax.jit, static_argnames="model")
def _quadratic(
    model: MultifactorProgram, frames: Frames, values: Mapping[str, AnyArray]
) -> Float[Array, " d"]:
    """Return y_d^T K^-1 y_d, K without residuals."""
    K = replace(model, residual=White()).process(frames, values)
    return misfit_of_columns(jnp.asarray(frames.y), K, complete(*frames.y.shape))[0]
