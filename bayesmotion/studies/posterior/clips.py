"""The posterior of a new clip's own unknowns, given a trained model.

Its styles, phase, step and deviation: about ten numbers, known from the clip's first
frames alone, and by far the most uncertain part of a forecast. They are sampled by
NUTS or by an ensemble of walkers, whitened as in `inference.sampling.whitening`, styles of linear
factors by length and direction (`distributions.polar`).

Only products of styles enter a kernel that multiplies linear factors: (s, g) and
(-s, -g), or (c s, g / c), predict the same; and of entries that no trained vector has,
novel ones (`Factor.novel_dims`) and those of more entries than levels, only the length counts. So
draws are compared, and convergence is judged, on what is identified: the outer product of
the styles without such entries, the product of their whole lengths, the phase as a point of
the circle, and the logarithms of the positive sites.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ...distributions.polar import log_volume, polar_of, vectors_of
from ...errors import InputError
from ...fit import Fit
from ...inference.density import ProgramDensity, real_values
from ...inference.optimisation.optimise import Unravel, flattened, maximise, stack
from ...inference.sampling.nuts_chains import Chains, Sampler
from ...inference.sampling.walkers import Ensemble, sample_ensemble
from ...inference.sampling.whitening import (
    SampledDensity,
    SamplingProblem,
    chain_starts,
    stage_key,
    whitening_at,
)
from ...models.multifactor import Multifactor
from ...models.multifactor.data import PoseData
from ...models.multifactor.frames import Frames
from ...models.multifactor.prediction import Trained
from ..fits import multifactor_of

# Initial values of the search for the mode, and as many are followed to the end.
INITIAL, KEEP = 64, 8
MAX_STEPS = 400
MAX_TREE_DEPTH = 8
WALKERS_PER_UNKNOWN = 4


@dataclass(frozen=True)
class ClipData:
    """What the program of a new clip is given; `Data` in the samplers' eyes."""

    frames: Frames
    trained: Trained

    @property
    def data(self) -> tuple[Frames, Trained]:
        """The program's arguments."""
        return self.frames, self.trained

    def observed(self) -> xr.Dataset:
        """Return the scaled features of the context frames."""
        return xr.Dataset({"y": (("frame", "feature"), np.asarray(self.frames.y))})

    def constants(self) -> xr.Dataset:
        """Return nothing beside the fit's own."""
        return xr.Dataset()


@dataclass(frozen=True)
class ClipDensity:
    """Log density of a new clip's unknowns, new styles of linear factors by `distributions.polar`.

    Directions count from the mean of the trained styles.
    """

    model: Multifactor
    program: str = "program"

    def __call__(self, real: Mapping[str, ArrayLike], data: tuple) -> Array:
        """Evaluate, Jacobians included."""
        volume = [
            log_volume(jnp.asarray(real[name]), novel)
            for name, novel in self._novel(real, data).items()
        ]
        return self._sites(self._straight(real, data), data) + sum(volume)

    def natural(self, real: Mapping[str, ArrayLike], data: tuple) -> dict[str, Array]:
        """Take coordinates to the sites' own units."""
        return self._sites.natural(self._straight(real, data), data)

    def real(self, natural: Mapping[str, ArrayLike], data: tuple) -> dict[str, Array]:
        """Take values in the sites' own units to coordinates."""
        real = self._sites.real(natural, data)
        polar = {
            name: polar_of(real[name], _centre(name, data), novel)
            for name, novel in self._novel(real, data).items()
        }
        return {**real, **polar}

    @property
    def _sites(self) -> ProgramDensity:
        return ProgramDensity(self.model, self.program, jacobian=True)

    def _novel(self, real: Mapping[str, ArrayLike], data: tuple) -> dict[str, int]:
        """Return the sites that have a length and a direction, and how many entries are novel.

        With novel ones, those that no trained vector has are novel too: they turn into each
        other.
        """
        trained: Trained = data[1]
        out = {}
        for factor in self.model.style_factors:
            name = f"style_{factor.name}"
            if factor.kind == "linear" and factor.size > 1 and name in real:
                levels, size = trained.styles[factor.name].shape
                reached = min(levels, factor.size)
                out[name] = size - reached if factor.novel and reached > 1 else 0
        return out

    def _straight(self, real: Mapping[str, ArrayLike], data: tuple) -> dict[str, ArrayLike]:
        found = {
            name: vectors_of(jnp.asarray(real[name]), _centre(name, data), novel)
            for name, novel in self._novel(real, data).items()
        }
        return {**real, **found}


def _centre(name: str, data: tuple) -> Array:
    """Return what the directions of a site's styles count from."""
    trained: Trained = data[1]
    return jnp.mean(jnp.asarray(trained.styles[name.removeprefix("style_")]), axis=0)


def clip_problem(fit: Fit, clip: PoseData) -> SamplingProblem:
    """Find the mode of a new clip's unknowns and the Hessian there.

    `clip` are its context frames, as the model has prepared them. Styles and phase are
    estimated by the Gaussian process (`Multifactor.student_df`).

    Raises
    ------
    InputError
        If the model's content is a path, whose frames to come are unknowns too.
    """
    model, training = multifactor_of(fit)
    if not model.on_circle:
        raise InputError(
            f"content {model.content!r}",
            "a new clip's posterior is sampled for content on a circle only",
            "Use a circle model, or the forecast at the mode",
        )
    trained = model.condition(training.frames, fit.values())
    data = ClipData(clip.frames, trained)
    # The same for all degrees of freedom, so that they share a compilation.
    density = ClipDensity(replace(model, student_df=None))
    begin = model.initial_values(clip, 0, INITIAL, trained)
    starts = [real_values(density, start, data.data) for start in begin]
    optimum = maximise(
        density, stack(starts), data.data, max_steps=MAX_STEPS, keep=KEEP, together=KEEP
    )
    target = SampledDensity(density, Unravel(starts[0]))
    mode = flattened(optimum.best())
    transform = whitening_at(target, mode, data.data, together=KEEP)
    return SamplingProblem(model, data, target, transform, bool(optimum.converged[0]))


def sample_nuts(
    problem: SamplingProblem, *, chains: int, warmup: int, draws: int, seed: int
) -> dict[str, np.ndarray]:
    """Sample a new clip's unknowns; return ``z`` (chain, draw, n) and the sampler's figures."""
    sampler = Sampler(problem.target, warmup, "dense", MAX_TREE_DEPTH)
    keys = jax.random.split(stage_key(seed, "chains"), chains)
    begin = chain_starts(problem, stage_key(seed, "starts"), chains, "map")
    runs = Chains(sampler, problem, keys, begin)
    while runs.done < warmup + draws:
        runs.advance()
    return {name: value[:, :draws] for name, value in runs.kept.items()}


def sample_walkers(problem: SamplingProblem, *, warmup: int, steps: int, seed: int) -> Ensemble:
    """Sample a new clip's unknowns by an ensemble of walkers around the mode."""
    count = WALKERS_PER_UNKNOWN * problem.unknowns
    begin = chain_starts(problem, stage_key(seed, "starts"), count, "map")
    return sample_ensemble(problem.log_density, begin, warmup=warmup, steps=steps, seed=seed)


def clip_values(problem: SamplingProblem, z: Float[np.ndarray, "c d n"]) -> dict[str, np.ndarray]:
    """Return the sites' values (chain, draw, ...) of points z."""
    return problem.values(jax.random.PRNGKey(0), z)


def identified(problem: SamplingProblem, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return what the clip's frames can tell of its unknowns, (chain, draw, ...) each.

    ``styles`` is the outer product of the unknown linear factors' vectors, flattened, each
    without the entries that no trained vector has; ``log_length``, where there are such
    entries, the logarithm of the product of their whole lengths. Vectors of other factors
    stand as they are.
    """
    trained: Trained = problem.training.data[1]
    model: Any = problem.model
    out, product, length, beyond = {}, None, 0.0, False
    for factor in model.style_factors:
        style = values.get(f"style_{factor.name}")
        if style is None:
            continue
        if factor.kind == "rbf":
            out[f"style_{factor.name}"] = style
            continue
        # The shape of the trained vectors (L, S) is lower triangular (`distributions.styles`).
        reached = min(trained.styles[factor.name].shape[0], factor.size)
        beyond = beyond or reached < style.shape[-1]
        one = style[:, :, 0, :reached]
        product = one if product is None else product[..., :, None] * one[..., None, :]
        product = product.reshape(*product.shape[:2], -1)
        length = length + np.log(np.linalg.norm(style[:, :, 0], axis=-1))
    if product is not None:
        out["styles"] = product
    if beyond:
        out["log_length"] = length
    point = values["phase_point"]
    out["phase"] = (point / np.linalg.norm(point, axis=-1, keepdims=True))[:, :, 0]
    out["log_step"] = np.log(values["step"])
    own = [name for name in ("residual_variance", "residual_time") if name in values]
    return out | {f"log_{name}": np.log(values[name]) for name in own}
