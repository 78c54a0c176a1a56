"""Multivariate relevance vector machine (Tipping 2001; Thayananthan et al. 2006).

Outputs are sums of basis functions, a constant and one Gaussian at every training point,
whose weights have precisions that all outputs share; each output has its noise:

    y_nm = sum_b Phi_nb W_bm + noise_nm
    Phi_n0 = 1,    Phi_nb = exp(-|x_n - x_b|^2 / (2 length_scale^2))
    W_bm ~ N(0, 1 / alpha_b),    noise_nm ~ N(0, sigma_m^2)

Priors, for outputs in units of their standard deviations:

    alpha_b ~ LogNormal(0, 4)                  from a basis that does all to one that does nothing
    sigma_m^2 ~ LogNormal(log(1 / 100), 2)     above `least_noise`

`RelevanceVectors.collapsed` has the weights integrated out (`outputs`). The paper's
estimate maximises that density over alpha and the noise with flat priors on their
logarithms, where most alpha are infinite: `fast_marginal`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import distributions as dist

from ....errors import InputError
from ....gp.linalg import AnyArray
from ....model import About, PointEstimate, Progress, SBCCase, Values
from ....search_state import SearchState
from . import sbc
from .data import Design, RelevanceData, prepare_points
from .example import example
from .fast import Relevant, maximise_marginal
from .outputs import MarginalOutputs, OutputsPredictive, TrainedWeights, prior_weights

# Precision of a basis that is left out: it does nothing, and its density is finite.
LEFT_OUT = 1e10
# Training points at which predictions are among what is identified, at most.
LANDMARKS = 20


@dataclass(frozen=True)
class RelevanceVectors:
    """The machine with its settings; see the module for the equations.

    Parameters
    ----------
    length_scale
        Of the Gaussians, in the units of x.
    least_noise
        Variance that the noise of an output is at least, as a share of the output's.

    Raises
    ------
    InputError
        If the length scale is not positive, or the least noise negative.
    """

    length_scale: float = 1.0
    least_noise: float = 0.0

    name: ClassVar[str] = "relevance_vectors"
    about: ClassVar[About] = About(
        "Tipping 2001; Thayananthan et al. 2006",
        "inputs x (frame, feature) and outputs y (frame, output)",
        ("fast_marginal", "map", "nuts", "ensemble"),
    )

    def __post_init__(self) -> None:
        """Check the settings once."""
        if not self.length_scale > 0:
            raise InputError("length_scale", f"it is {self.length_scale}", "Give a positive number")
        if not self.least_noise >= 0:
            raise InputError("least_noise", f"it is {self.least_noise}", "Give a variance, or zero")

    @classmethod
    def example(cls, seed: int = 0) -> tuple["RelevanceVectors", xr.Dataset]:
        """Return a machine and two noisy curves, some of their points missing."""
        return cls(length_scale=1.5), example(seed)

    def prepare(
        self, recordings: xr.Dataset, trained: RelevanceData | None = None
    ) -> RelevanceData:
        """Make a data set with ``x`` (frame, feature) and ``y`` (frame, output) into arrays.

        Basis functions stand at the training points; of new data y may be missing.

        Raises
        ------
        InputError
            If it has no such variables, an input is missing, or an output does not vary.
        """
        return prepare_points(recordings, self.length_scale, trained)

    def program(self, design: Design, trained: TrainedWeights | None = None) -> None:
        """Sample the outputs (N, M)."""
        if trained is not None:
            self._new(design, trained)
            return
        alpha, noise = self._precisions(design)
        shape = [design.phi.shape[1], design.y.shape[1]]
        weights = dist.Normal(0.0, alpha[:, None] ** -0.5).expand(shape).to_event(2)
        W = jnp.asarray(numpyro.sample("weight", weights))
        mean = jnp.asarray(design.phi) @ W
        seen = ~jnp.isnan(design.y)
        outputs = dist.Normal(mean, jnp.sqrt(noise)).mask(seen)
        numpyro.sample("y", outputs, obs=jnp.where(seen, design.y, 0.0))

    def collapsed(self, design: Design) -> None:
        """Sample the outputs with the weights integrated out."""
        alpha, noise = self._precisions(design)
        numpyro.sample("y", marginal(design, alpha, noise), obs=design.y)

    def _new(self, design: Design, trained: TrainedWeights) -> None:
        weight, root = trained.posterior()
        phi = jnp.asarray(design.phi)
        outputs = MarginalOutputs(phi @ weight.T, phi @ root, jnp.asarray(trained.noise))
        numpyro.sample("y", outputs, obs=design.y)

    def _precisions(self, design: Design) -> tuple[Array, Array]:
        return sample_precisions(design.phi.shape[1], design.y.shape[1], self.least_noise)

    def complete_draw(
        self, key: PRNGKeyArray, frames: Design, values: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Draw the weights given the precisions; return all of them."""
        mean, root = self.condition(frames, values).posterior()
        white = jax.random.normal(key, mean.shape)
        return {**values, "weight": (mean + jnp.einsum("mbc,mc->mb", root, white)).T}

    def initial_values(
        self, data: RelevanceData, seed: int, count: int, trained: TrainedWeights | None = None
    ) -> list[dict[str, np.ndarray]]:
        """Return precisions near one and weights of a ridge regression; nothing of new data."""
        if trained is not None:
            return [{} for _ in range(count)]
        random = np.random.default_rng(seed)
        phi, y = np.asarray(data.design.phi), np.asarray(data.design.y)
        return [initial(phi, y, self.least_noise, random) for _ in range(count)]

    def fast_marginal(
        self,
        data: RelevanceData,
        *,
        seed: int,
        max_steps: int,
        tolerance: float,
        progress: Progress | None = None,
        state: SearchState | None = None,
    ) -> PointEstimate:
        """Maximise the marginal likelihood one basis at a time (Tipping and Faul 2003).

        Parameters
        ----------
        data
            Training points.
        seed
            Of nothing: the search begins with the basis that says most.
        max_steps
            At most so many bases are added, taken out or changed.
        tolerance
            Gain of log marginal likelihood below which no step is taken.
        progress
            Called with the steps done and the log marginal likelihood.
        state
            Where an earlier search stood, and where this one is kept.
        """
        phi, y = np.asarray(data.design.phi), np.asarray(data.design.y)
        found = maximise_marginal(
            phi,
            y,
            least_noise=self.least_noise,
            max_steps=max_steps,
            tolerance=tolerance,
            progress=progress,
            state=state,
        )
        return PointEstimate(
            every_basis(found, phi.shape[1], self.least_noise),
            found.log_marginal,
            found.steps,
            found.converged,
        )

    def condition(self, design: Design, values: Mapping[str, AnyArray]) -> TrainedWeights:
        """Return what the training outputs say of the weights, given one draw of the rest."""
        alpha, noise = jnp.asarray(values["alpha"]), jnp.asarray(values["noise"])
        return prior_weights(alpha, noise).seeing(design.phi, design.y)

    def predict(
        self, trained: TrainedWeights, design: Design, values: Mapping[str, AnyArray]
    ) -> dict[str, OutputsPredictive]:
        """Predict the outputs at new points given those of them that are seen."""
        weight, root = trained.seeing(design.phi, design.y).posterior()
        least = jnp.zeros(len(weight))
        noise = jnp.asarray(trained.noise)
        return {"y": OutputsPredictive(design.phi, weight, root, noise, least)}

    def identified(self, design: Design, values: Mapping[str, AnyArray]) -> Values:
        """Return what data can tell of a draw; single weights and precisions they hardly can.

        Noise, signal at some training points, the log likelihood with the weights integrated
        out, and of every output how many weights the data determine.
        """
        some = landmarks(len(design.y))
        alpha, noise = jnp.asarray(values["alpha"]), jnp.asarray(values["noise"])
        return {
            "noise": noise,
            "signal": jnp.asarray(design.phi)[some] @ jnp.asarray(values["weight"]),
            "log_likelihood": marginal(design, alpha, noise).log_prob(design.y),
            "effective_vectors": determined(self.condition(design, values)),
        }

    def pointwise(self, design: Design, values: Mapping[str, AnyArray]) -> Float[Array, " n"]:
        """Return log p(y_n | y_-n, alpha, noise) of every point, the weights integrated out."""
        alpha, noise = jnp.asarray(values["alpha"]), jnp.asarray(values["noise"])
        return marginal(design, alpha, noise).leave_out(design.y)

    def points(self, data: RelevanceData) -> dict[str, tuple[str, np.ndarray]]:
        """Return names and clips of the points."""
        found = {"frame": ("point", np.array(data.frames))}
        return found if data.clips is None else found | {"clip": ("point", data.clips)}

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of every site and of what is identified."""
        return {
            "y": ("frame", "output"),
            "alpha": ("basis",),
            "noise": ("output",),
            "weight": ("basis", "output"),
            "signal": ("landmark", "output"),
            "log_likelihood": (),
            "effective_vectors": ("output",),
        }

    def coords(self, data: RelevanceData) -> dict[str, list]:
        """Return the labels of every dimension."""
        return {
            "frame": list(data.frames),
            "basis": ["constant", *map(str, range(data.design.phi.shape[1] - 1))],
            "output": list(data.outputs),
            "landmark": [data.frames[i] for i in landmarks(len(data.frames))],
        }

    def sbc_case(self) -> tuple[SBCCase, Design]:
        """Return twelve points on a line, four basis functions, and two outputs."""
        return sbc.case(self)


def sample_precisions(basis: int, outputs: int, least_noise: float) -> tuple[Array, Array]:
    """Sample ``alpha`` (B,) and ``noise`` (M,) from their priors."""
    alpha = numpyro.sample("alpha", dist.LogNormal(0.0, 4.0).expand([basis]).to_event(1))
    prior = noise_prior(least_noise).expand([outputs]).to_event(1)
    return jnp.asarray(alpha), jnp.asarray(numpyro.sample("noise", prior))


def noise_prior(least: float) -> dist.Distribution:
    """Return the prior of a noise variance, cut off below its least."""
    location, scale = np.log(0.01), 2.0
    if least == 0.0:
        return dist.LogNormal(location, scale)
    normal = dist.TruncatedNormal(location, scale, low=np.log(least))
    above = dist.constraints.greater_than(np.log(least))
    return dist.TransformedDistribution(normal, dist.transforms.ExpTransform(above))


def marginal(
    design: Design, alpha: Float[AnyArray, " b"], noise: Float[AnyArray, " m"]
) -> MarginalOutputs:
    """Return the distribution of the outputs with the weights integrated out."""
    phi = jnp.asarray(design.phi)
    return MarginalOutputs(jnp.zeros(design.y.shape), (phi / jnp.sqrt(alpha))[None], noise)


def determined(weights: TrainedWeights) -> Float[Array, " m"]:
    """Return how many weights of every output the data determine: sum_b (1 - alpha_b C_bb)."""
    _, root = weights.posterior()
    return (1.0 - jnp.asarray(weights.alpha) * (root**2).sum(axis=2)).sum(axis=1)


def initial(
    phi: Float[np.ndarray, "n b"],
    y: Float[np.ndarray, "n m"],
    least_noise: float,
    random: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Return precisions near one and the weights of a ridge regression."""
    alpha = np.exp(0.5 * random.standard_normal(phi.shape[1]))
    noise = least_noise + np.exp(-np.log(30.0) + 0.5 * random.standard_normal(y.shape[1]))
    ridge = phi.T @ phi + np.diag(alpha) * noise.mean()
    weight = np.linalg.solve(ridge, phi.T @ np.nan_to_num(y))
    return {"alpha": alpha, "noise": noise, "weight": weight}


def every_basis(found: Relevant, basis: int, least_noise: float) -> dict[str, np.ndarray]:
    """Return values of the sites for all bases: those left out have `LEFT_OUT`, and no weight."""
    # Within the support of the noise, which leaves out its least.
    noise = np.maximum(1.0 / found.beta, (1.0 + 1e-9) * least_noise)
    alpha, weight = np.full(basis, LEFT_OUT), np.zeros((basis, len(found.beta)))
    alpha[found.kept], weight[found.kept] = found.alpha, found.mean.T
    return {"alpha": alpha, "noise": noise, "weight": weight}


def landmarks(count: int) -> np.ndarray:
    """Return the numbers of at most `LANDMARKS` evenly chosen points."""
    return np.unique(np.linspace(0, count - 1, min(count, LANDMARKS)).round().astype(int))
