"""A new clip followed frame by frame, given a trained model with content on a circle.

`Following.program` is the program of the clip's own unknowns, those of `MultifactorProgram`, with
the density of its frames by what `gp.followed` keeps of them: frames that are gone, whose phases
and whitening are as they were when they went, and a window of the last ones, of whose middle the
phase is. While no frame is gone that is the model's density of the clip.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Array, Float, Int, PRNGKeyArray

from ...errors import InputError
from ...gp import followed
from ...gp.harmonics import amplitudes, enough, waves
from ...gp.linalg import AnyArray, cholesky
from ...gp.on_circle import CHOICES, ConditionedOnCircle, Weights
from ...prediction import GPPredictive
from .frames import Frames
from .prediction import Trained
from .program import MultifactorProgram
from .settings import White

# What the covariance of coefficients has added to its diagonal, of its mean.
ROUNDING = 1e-13


class Window(NamedTuple):
    """The last frames of a clip, and those to come.

    rows
        The frames that have come.
    which
        (G,) pattern of the training data that the columns of a group have.
    ahead
        Frames of the window and of the forecast, without outputs: levels, rate.
    """

    rows: followed.Rows
    which: Int[AnyArray, " g"]
    ahead: Frames


class Known(NamedTuple):
    """A trained model, and its weights by harmonics; of what it is conditioned on these are all."""

    trained: Trained
    weights: Weights


@dataclass(frozen=True)
class Following:
    """How the new clips of a model are followed; see the module.

    model
        With content on a circle and linear factors.
    harmonics
        So many are enough for every draw.
    """

    model: MultifactorProgram
    harmonics: int

    def program(self, window: Window, past: followed.Past, given: Known) -> None:
        """Sample the clip's own unknowns; its frames are a factor ``y``."""
        frames, trained = _timed(window), given.trained
        points, own = self.model.unknowns(frames, trained.hyper, trained)
        here, known, residual = self._parts(window, points, {**trained.hyper, **own}, given)
        says = followed.follow(past, window.rows, here[0], residual)
        density = followed.log_density(says, window.rows, known, trained.hyper["scale"])
        numpyro.factor("y", self.model.context_weight * density)

    def condition(self, frames: Frames, values: Mapping[str, AnyArray]) -> Known:
        """Return the trained model of one draw, by harmonics."""
        trained = replace(self.model, form="fourier").condition(frames, values)
        conditioned = trained.conditioned
        assert isinstance(conditioned, ConditionedOnCircle)
        weights = conditioned.weights(self.harmonics)
        none = conditioned._replace(
            inverse=conditioned.inverse[:, :0, :0], half=conditioned.half[:, :0]
        )
        return Known(trained._replace(conditioned=none), weights)

    def nothing(self, given: Known) -> followed.Past:
        """Return the past of a clip that begins."""
        features, _, columns = given.weights.mean.shape
        return followed.nothing(given.weights.covariance.shape[0], features, columns)

    def invariant(self, real: Mapping[str, Array]) -> list[dict[str, Array]]:
        """Return directions of the unknowns in which what frames say does not change.

        Only the product of style vectors counts: one may be longer and another shorter.
        """
        names = [f"style_{one.name}" for one in self.model.style_factors]
        new = [name for name in names if name in real]
        still = {name: jnp.zeros_like(value) for name, value in real.items()}
        return [{**still, new[0]: real[new[0]], name: -real[name]} for name in new[1:]]

    def moved(self, own: Mapping[str, Array], frames: Float[AnyArray, ""]) -> dict[str, Array]:
        """Return the unknowns with the middle so many frames later."""
        turn = own["step"] * frames
        cos, sin = jnp.cos(turn), jnp.sin(turn)
        x, y = own["phase_point"][:, 0], own["phase_point"][:, 1]
        point = jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=1)
        return {**own, "phase_point": point}

    def gone(
        self,
        window: Window,
        past: followed.Past,
        given: Known,
        own: Mapping[str, AnyArray],
        seen: Float[AnyArray, " h"],
        group: Int[AnyArray, " d"],
    ) -> followed.Past:
        """Return the past with the window's first frame, seen by these groups of the past."""
        here, _, residual = self._at(window, given, own)
        y = jnp.asarray(window.rows.y)[0]
        return followed.gone(past, y, seen, group, here[0][0], residual)

    def noise(self, window: Window, key: PRNGKeyArray) -> tuple[Array, PRNGKeyArray]:
        """Return random numbers of a joint draw: standard normal ones (N, D), and a key."""
        key, white = jax.random.split(key)
        shape = len(window.ahead.clip) - window.rows.y.shape[0], window.rows.y.shape[1]
        return jax.random.normal(white, shape), key

    def predict(
        self,
        window: Window,
        past: followed.Past,
        given: Known,
        own: Mapping[str, AnyArray],
        noise: tuple[Array, PRNGKeyArray],
    ) -> tuple[Float[AnyArray, "n d"], Float[AnyArray, "n d"], Float[Array, "n d"]]:
        """Predict the frames that follow the window: mean and variance, and one joint draw."""
        here, known, residual = self._at(window, given, own)
        rows, scale = window.rows, given.trained.hyper["scale"]
        says = followed.follow(past, rows, here[0], residual)
        found = followed.ahead(
            past, rows, says, known, residual, here, scale, self.model.student_df
        )
        columns = jnp.asarray(rows.columns)
        said = GPPredictive(
            found.mean, found.covariance, residual.noise, scale, columns, found.wider
        )
        wider = said.widening(noise[1])
        marginals = said.marginals_of(wider)
        return marginals.mean, marginals.variance, said.sample_of(noise[0], wider)

    def _at(self, window: Window, given: Known, own: Mapping[str, AnyArray]) -> tuple:
        points = self.model.latent_points(_timed(window), own, given.trained)
        return self._parts(window, points, {**given.trained.hyper, **own}, given)

    def _parts(
        self,
        window: Window,
        points: Mapping[str, AnyArray],
        sites: Mapping[str, AnyArray],
        given: Known,
    ) -> tuple[tuple[Array, Array], followed.Coefficients, followed.Residual]:
        """Return the waves of the window and of what follows, their coefficients, the residual."""
        rows = window.rows
        every = waves(points["content"], jnp.ones(self.harmonics + 1))
        size, count = rows.y.shape[0], every.shape[0]
        follow = jnp.asarray(rows.filled) + jnp.arange(count - size)
        first = {name: jnp.asarray(each)[:1] for name, each in points.items()}
        style = self.model.style_products(first)[0]
        # A new level's novel dimensions: as much of the circle's kernel that is nobody else's.
        whole = jnp.ones(())
        for factor in self.model.style_factors:
            whole = whole * jnp.sum(first[factor.name] ** 2)
        amplitude = amplitudes(sites["gamma"], self.harmonics)
        of_waves = jnp.concatenate([amplitude[:1], jnp.repeat(amplitude[1:], 2)])
        mean, covariance = given.weights.of_style(style)
        more = (whole - jnp.sum(style**2)) * jnp.eye(len(mean))
        roots = jnp.stack([cholesky(own + more, ROUNDING) for own in covariance])
        known = followed.Coefficients(
            of_waves[:, None] * mean, of_waves[:, None] * roots[window.which]
        )
        variance, time = jnp.zeros(()), jnp.ones(())
        if not isinstance(self.model.residual, White):
            variance, time = (
                jnp.asarray(sites[f"residual_{name}"])[0] for name in ("variance", "time")
            )
        residual = followed.Residual(
            variance, jnp.exp(-1.0 / time), jnp.asarray(1.0 / sites["beta"])
        )
        return (every[:size], every[follow]), known, residual


def following(model: MultifactorProgram, gammas: Float[AnyArray, " s"]) -> Following:
    """Return how new clips of a model are followed, for draws with these inverse lengths.

    Raises
    ------
    InputError
        If the model has no harmonics, or its kernel is too sharp for them.
    """
    if not model.has_harmonics:
        raise InputError(
            "a fit of multifactor",
            "only content on a circle, with linear factors, is followed frame by frame",
            "Fit Multifactor(content=Circle()), or use forecast",
        )
    harmonics = enough(float(np.max(gammas)))
    if harmonics > CHOICES[-1]:
        raise InputError(
            "a fit of multifactor",
            f"its kernel is too sharp on the circle (gamma {np.max(gammas):.3g})",
            "Use forecast, or fit more recordings",
        )
    return Following(model, harmonics)


def _timed(window: Window) -> Frames:
    """Return the frames with their times, from the middle of those that have come."""
    frames = window.ahead
    time = jnp.arange(1.0 * len(frames.clip)) - (window.rows.filled - 1.0) / 2.0
    return replace(frames, time=time)
