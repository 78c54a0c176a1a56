"""Multifactor Gaussian process model of motion (Wang, Fleet and Hertzmann 2007).

The pose at frame t of clip c, of subject i and gait j, is a function of three
factors with a Gaussian process prior (eq. 15):

    y_d(t) ~ GP(0, k / w_d^2)
    k = (s^T s') (g^T g') exp(-gamma / 2 |x - x'|^2) + delta / beta

    s_i                                  one style vector in R^3 a subject
    g_j                                  one a gait, and so on for any factor
    x_t                                  the content, by one of three dynamics:
      Circle       x_t = (cos theta_t, sin theta_t),  theta_t = phase_c + step_c (t - middle)
      GPDynamics   x_1, x_2 ~ N(0, I_3),  x_t ~ GP(x_{t-1}, x_{t-1} - x_{t-2}),
                   of first order x_t ~ GP(x_{t-1}) as in the paper   (`distributions.dynamics`)
      balanced     the same with its log density times D / Q

With Gaussian process dynamics the training content has unit mean square about the
mean of each clip: k sees only gamma |x - x'|^2, and a smaller x always makes its
dynamics more probable.

A clip whose label is unknown has a style vector of its own. Without factors k
is the RBF kernel on the content alone (GPDM, B-GPDM).

Nothing is left free that no data can tell. Style vectors of a linear factor count
up to a rotation and a common length: the first level's is (1, 0, 0), the second's
lies in the plane of the first two axes (`distributions.styles`). Phases count up to a
common shift: the first training clip's is zero.

Priors. ``priors="proper"`` (features are scaled to unit spread first):

    gamma ~ LogNormal(0, 1)              inverse squared length, content has unit size
    beta ~ LogNormal(log 100, 2)         signal to noise variance
    w_d ~ HalfNormal(1)                  one over the spread of a scaled feature
    s, g ~ shapes of N(0, I_3) vectors   for a linear factor; N(0, I_3) for an rbf one
    step ~ LogNormal(log(2 pi / (1 s x frame rate)), 0.4)   radians a frame: a cycle
                                         takes about one second, 0.45 s to 2.2 s in 95 %, of
                                         each clip (pace ``free``), or with a mean, a map from
                                         the styles and a spread that are learned (``learned``,
                                         see `pace`)
    residual_variance_c ~ LogNormal(log 0.01, 2)   of a clip's own residual (`OU`)
    residual_time_c ~ LogNormal(log (1/3 s x frame rate), 1)   its time scale in frames
    alpha ~ LogNormal(log medians, 1)    of the dynamics (`Multifactor.alpha_median`), but
                                         their noise, which is a setting (`GPDynamics`);
                                         balanced D / Q times as sharp, like the dynamics
    phase ~ uniform on the circle        sampled as a point near it (`distributions.circle`)

``priors="paper"``: p(beta, gamma) ~ 1 / (beta gamma), p(alpha) ~ prod 1 / alpha_i,
everything else flat; improper, so for point estimates only.

`Multifactor.program` samples every site. `Multifactor.collapsed` is the same model of
the training clips with the scales w integrated out, which `complete_draw` draws again.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Array, Float, PRNGKeyArray
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ...distributions import dynamics as latent_dynamics
from ...distributions.circle import Ring, angle_of, circle
from ...distributions.styles import StyleShape, later_styles, population_styles, styles_of
from ...errors import InputError
from ...gp.collapsed import CollapsedProcess, draw_scale
from ...gp.kernels import Kernel, linear, rbf
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import (
    Conditioned,
    GaussianProcess,
    condition,
    smooth,
    spread_of_columns,
)
from ...gp.on_circle import CHOICES, CircleCovariance
from ...gp.unnormalised import Marked, NoDensity
from ...motion.size import Lengths
from ...prediction import GPPredictive
from ...settings import BEFORE
from .frames import Frames
from .pace import step_distribution, wandering
from .prediction import Trained
from .settings import OU, SUBJECT_AND_GAIT, Circle, Factor, GPDynamics, White, standard_styles

Priors = Literal["proper", "paper"]
Form = Literal["auto", "dense", "fourier"]
ALPHA_PARTS = {
    1: ["variance", "gamma", "linear_variance"],
    2: ["variance", "gamma", "gamma_velocity", "linear_variance", "linear_variance_velocity"],
}
BALANCED = NoDensity(
    "the density of balanced dynamics is taken D / Q times, and its constant, which depends on "
    "alpha, is not known",
    "Use dynamics that are not balanced, a circle, or method map",
    ("alpha",),
)
# Training frames for each weight of few harmonics from which these are the cheaper form. Where
# the kernel is so sharp that many are needed, that is from about three frames on.
FRAMES_A_WEIGHT = 2


@dataclass(frozen=True)
class MultifactorProgram:
    """The settings of the model, and its program; see the module for the equations.

    The defaults are what forecasts of training people who are left out choose
    (`studies.multifactor.defaults`).

    Parameters
    ----------
    content
        What moves: `Circle`, or `GPDynamics` with its settings.
    factors
        Style factors, or their names; none gives the plain GPDM, B-GPDM or circle model.
    priors
        ``proper``, or ``paper``: improper ones, for point estimates only.
    residual
        What clips do of their own accord beside the factors: `White` noise alone (the paper),
        or `OU`.
    student_df
        Every output of a new clip may deviate from what the trained process makes of it by
        more than the training clips, whose styles were fitted to them, or by less: in
        predictions its covariance is multiplied by lambda_d, as the context frames tell of it
        (`gp.matrix_normal.spread_of_columns`), with lambda_d ~ InverseGamma(df / 2, df / 2)
        beforehand. None: by one. Styles and phase are estimated as if it were one: with
        lambda_d integrated out there, a body that walks upside down, most of its outputs
        far off, can be likelier than one that walks.
    align_heading
        Whether each clip's heading is taken out before, and put back into predictions: which way
        somebody goes then does not matter.
    lengths
        What the root's velocity is told in: ``body``, leg lengths of each clip's own body, so
        that the unit of files does not matter, or ``file``, that unit.
    context_weight
        The power, of at most one, that the density of a new clip's context is taken to when its
        phase, step and styles are told by it. What the factors do not explain is independent from
        output to output in the model, and correlated in bodies: D outputs tell as much as
        fewer independent ones, and taken for D they make the model too sure (a power
        posterior; Miller and Dunson 2019). Of bodies with few outputs, or outputs that deviate
        each by itself, contexts tell more: 1.
    unknown_draws
        How many draws of a new clip's phase, step and styles about each of their modes
        predictions average over; 0 for the modes alone.
    form
        How the covariance of training frames is worked with, the model being the same:
        ``dense``, whose cost grows with the cube of their number, or ``fourier``, by the
        harmonics of the circle, which costs as much a frame however many there are
        (`gp.on_circle`): for content on a circle and linear factors. ``auto`` takes the
        cheaper one: with two factors of size 3 ``fourier`` from 594 frames on.

    Raises
    ------
    InputError
        If outputs would have no variance, or the form is not the model's.
    """

    content: Circle | GPDynamics = Circle()  # noqa: RUF009 (frozen)
    factors: tuple[Factor | str, ...] | list[Factor | str] = SUBJECT_AND_GAIT
    priors: Priors = "proper"
    residual: White | OU = OU()  # noqa: RUF009 (frozen)
    student_df: float | None = 16.0
    align_heading: bool = True
    lengths: Lengths = field(default="body", metadata={BEFORE: "file"})
    context_weight: float = field(default=0.1, metadata={BEFORE: 1.0})
    unknown_draws: int = field(default=32, metadata={BEFORE: 0})
    form: Form = field(default="auto", metadata={BEFORE: "auto"})

    def __post_init__(self) -> None:
        """Take names of factors for factors; refuse settings without a density."""
        made = tuple(Factor(one) if isinstance(one, str) else one for one in self.factors)
        object.__setattr__(self, "factors", made)
        if self.student_df is not None and not 2.0 < self.student_df < np.inf:
            raise InputError(
                f"student_df {self.student_df:g}",
                "with two degrees of freedom or less an output has no variance",
                "Use a finite number above two, or None for a Gaussian process",
            )
        if not 0.0 < self.context_weight <= 1.0:
            raise InputError(
                f"context_weight {self.context_weight:g}",
                "it is the power that the density of a context is taken to",
                "Use a number above 0 and at most 1",
            )
        if self.form == "fourier" and not self.has_harmonics:
            raise InputError(
                "form 'fourier'",
                "only content on a circle, with linear factors, is a sum of harmonics",
                "Use form 'auto' or 'dense'",
            )

    @property
    def style_factors(self) -> tuple[Factor, ...]:
        """The style factors, whose names may have been given for them."""
        return tuple(one for one in self.factors if isinstance(one, Factor))

    @property
    def on_circle(self) -> bool:
        """Whether the content is on a circle."""
        return isinstance(self.content, Circle)

    @property
    def learns_pace(self) -> bool:
        """Whether clips' steps have a prior that the training clips tell."""
        learned = isinstance(self.content, Circle) and self.content.pace == "learned"
        return learned and self.priors == "proper"

    @property
    def wander_sd(self) -> float:
        """How much a new clip's log speed wanders about its pace."""
        return self.content.wander_sd if isinstance(self.content, Circle) else 0.0

    @property
    def has_harmonics(self) -> bool:
        """Whether the covariance is a sum of few harmonics, of any number of frames."""
        return self.on_circle and all(factor.kind == "linear" for factor in self.style_factors)

    @property
    def path(self) -> GPDynamics:
        """The settings of a latent path, where the content is one."""
        assert isinstance(self.content, GPDynamics), "the content is on a circle"
        return self.content

    @property
    def per_clip(self) -> bool:
        """Whether residuals are each clip's own."""
        return isinstance(self.residual, OU) and self.residual.per_clip

    @property
    def one_residual(self) -> bool:
        """Whether residuals have one size and time scale for all clips."""
        return isinstance(self.residual, OU) and not self.residual.per_clip

    def program(self, frames: Frames, trained: Trained | None = None) -> None:
        """Generate the poses `frames.y` (N, D); with `trained`, those of new clips.

        Conditioned on a trained model the hyperparameters and the styles of known
        levels are given, and the outputs are what the trained process predicts.
        """
        hyper = self._hyperparameters(frames) if trained is None else trained.hyper
        points, own = self.unknowns(frames, hyper, trained)
        sites = {**hyper, **own}
        loc = None
        if trained is None:
            K = self.process(frames, sites, points)
        else:
            loc, K = self.outputs(trained, points, self.covariance(frames, sites, points))
        outputs = GaussianProcess(K, hyper["scale"], loc, frames.missing)
        weight = 1.0 if trained is None else self.context_weight
        with numpyro.handlers.scale(scale=weight):
            numpyro.sample("y", outputs, obs=frames.y)

    def unknowns(
        self, frames: Frames, hyper: Mapping[str, AnyArray], trained: Trained | None
    ) -> tuple[dict[str, AnyArray], Mapping[str, AnyArray]]:
        """Sample factors and content of every frame, and the sites of the residuals."""
        points = self._points(frames, hyper, trained)
        return points, self._residual_sites(frames, trained)

    def collapsed(self, frames: Frames) -> None:
        """Generate the training poses with the scales integrated out."""
        if self.priors != "proper":
            raise InputError(
                "priors 'paper'",
                "the scales have no prior to integrate over",
                "Use priors 'proper'",
            )
        hyper = self._hyperparameters(frames, scales=False)
        points = self._points(frames, hyper, None)
        K = self.process(frames, {**hyper, **self._residual_sites(frames, None)}, points)
        outputs = CollapsedProcess(K, frames.y.shape[1], frames.missing)
        numpyro.sample("y", outputs, obs=frames.y)

    def complete_draw(
        self, key: PRNGKeyArray, frames: Frames, values: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Draw the scales that go with a draw of the other sites; give all of them."""
        K = self.process(frames, values)
        scale = draw_scale(key, jnp.asarray(frames.y), K, frames.missing)
        return {**values, "scale": scale}

    def kernel(self, hyper: Mapping[str, AnyArray]) -> Kernel:
        """Covariance of one output of scale 1 without the noise (eq. 15)."""
        k: Kernel = rbf("content", length_scale=hyper["gamma"] ** -0.5)
        for factor in self.style_factors:
            k = k * (linear(factor.name) if factor.kind == "linear" else rbf(factor.name))
        return k

    def _points(
        self, frames: Frames, hyper: Mapping[str, AnyArray], trained: Trained | None
    ) -> dict[str, AnyArray]:
        """Sample the factors and the content of every frame."""
        points = {}
        for index, factor in enumerate(self.style_factors):
            style = self._style(factor, index, frames, trained)
            points[factor.name] = style[frames.level[factor.name]][frames.clip]
        return {**points, "content": self._content(frames, hyper, trained, points)}

    def _white(self, hyper: Mapping[str, AnyArray], frames: Frames) -> Float[AnyArray, "n n"]:
        return jnp.eye(len(frames.clip)) / hyper["beta"]

    def _residual_sites(self, frames: Frames, trained: Trained | None) -> Mapping[str, AnyArray]:
        """Sample how large and how slow clips' own deviations are: (C,) each, or (1,)."""
        if isinstance(self.residual, White):
            return {}
        common = not self.per_clip
        if common and trained is not None:
            return trained.hyper
        count, third = [1 if common else frames.n_clips], jnp.log(frames.frame_rate / 3.0)
        size = dist.LogNormal(jnp.log(0.01), 2.0).expand(count).to_event(1)
        slowness = dist.LogNormal(third, 1.0).expand(count).to_event(1)
        variance = self._positive("residual_variance", size, -1.0)
        slow = self._positive("residual_time", slowness, -1.0)
        return {"residual_variance": variance, "residual_time": slow}

    def _residual(self, own: Mapping[str, AnyArray], frames: Frames) -> Float[AnyArray, "n n"]:
        """Covariance of what a clip does of its own accord, beside the factors."""
        clip = frames.clip
        if isinstance(self.residual, White):
            return jnp.zeros((len(clip), len(clip)))
        which = clip if self.per_clip else 0 * clip
        apart = jnp.abs(frames.time[:, None] - frames.time[None, :]) / own["residual_time"][which]
        same = clip[:, None] == clip[None, :]
        return own["residual_variance"][which] * same * jnp.exp(-apart)

    def _noise(
        self, hyper: Mapping[str, AnyArray], own: Mapping[str, AnyArray], frames: Frames
    ) -> Float[AnyArray, "n n"]:
        """Covariance of all that no factor explains."""
        return self._white(hyper, frames) + self._residual(own, frames)

    def covariance(
        self,
        frames: Frames,
        values: Mapping[str, AnyArray],
        points: Mapping[str, AnyArray] | None = None,
        *,
        white: bool = True,
    ) -> Float[AnyArray, "n n"]:
        """Covariance of one output of scale 1, with or without the white noise.

        The frames lie at `points`, by default where the site values put them.
        """
        points = self.latent_points(frames, values) if points is None else points
        noise = self._noise(values, values, frames) if white else self._residual(values, frames)
        return self.kernel(values).matrix(points, points) + noise

    def process(
        self,
        frames: Frames,
        values: Mapping[str, AnyArray],
        points: Mapping[str, AnyArray] | None = None,
    ) -> Float[AnyArray, "n n"] | CircleCovariance:
        """Covariance of one output of scale 1 over training frames, in the model's form.

        The frames lie at `points`, by default where the site values put them.
        """
        points = self.latent_points(frames, values) if points is None else points
        if not self._by_harmonics(frames):
            return self.covariance(frames, values, points)
        clips = jnp.zeros(frames.n_clips)
        own = (clips, clips + 1.0)
        if isinstance(self.residual, OU):
            own = (clips + values["residual_variance"], clips + values["residual_time"])
        first = {name: jnp.asarray(each)[frames.steps.first] for name, each in points.items()}
        noise = 1.0 / values["beta"]
        return CircleCovariance(
            values["gamma"], points["content"], self.style_products(first), *own, noise,
            frames.time, frames.lanes,
        )  # fmt: skip

    def outputs(
        self, trained: Trained, points: Mapping[str, AnyArray], own: Float[AnyArray, "m m"]
    ) -> tuple[Float[Array, "m d"], Float[Array, "p m m"]]:
        """Return mean (M, D) and covariances (P, M, M) that a trained model has at points.

        `own` is their covariance beforehand.
        """
        if isinstance(trained.conditioned, Conditioned):
            cross = self.kernel(trained.hyper).matrix(points, trained.points)
            return trained.conditioned(cross, own)
        return trained.conditioned(points["content"], self.style_products(points), own)

    def _by_harmonics(self, frames: Frames) -> bool:
        """Whether the covariance of training frames is worked with by harmonics."""
        if self.form != "auto" or not self.has_harmonics:
            return self.form == "fourier"
        weights = (2 * CHOICES[0] + 1) * math.prod(factor.size for factor in self.style_factors)
        return len(frames.clip) >= FRAMES_A_WEIGHT * weights

    def style_products(self, points: Mapping[str, AnyArray]) -> Float[Array, "m s"]:
        """Return the Kronecker products of style vectors, without their novel dimensions."""
        out = jnp.ones((len(points["content"]), 1))
        for factor in self.style_factors:
            style = jnp.asarray(points[factor.name])[:, : factor.size]
            out = (out[:, :, None] * style[:, None, :]).reshape(len(out), -1)
        return out

    def _hyperparameters(self, frames: Frames, scales: bool = True) -> dict[str, AnyArray]:
        priors: dict[str, tuple[dist.Distribution, float]] = {
            "gamma": (dist.LogNormal(0.0, 1.0), -1.0),
            "beta": (dist.LogNormal(jnp.log(100.0), 2.0), -1.0),
        }
        if scales:
            half_normal = dist.HalfNormal(1.0).expand([frames.y.shape[1]]).to_event(1)
            priors["scale"] = (half_normal, 0.0)
        if not self.on_circle:
            medians = jnp.log(jnp.asarray(self.alpha_median(frames.frame_rate)))
            # What is known of the dynamics counts as often as the dynamics themselves.
            spread = self.balance(frames.y.shape[1]) ** -0.5
            priors["alpha"] = (dist.LogNormal(medians, spread).to_event(1), -1.0)
        return {name: self._positive(name, *prior) for name, prior in priors.items()}

    def dynamics_alpha(self, hyper: Mapping[str, AnyArray]) -> Float[AnyArray, " a"]:
        """Hyperparameters of the gp and balanced dynamics, the last their precision."""
        return jnp.append(jnp.asarray(hyper["alpha"]), self.path.noise_sd**-2)

    def alpha_median(self, frame_rate: Float[AnyArray, ""] | float) -> tuple[AnyArray | float, ...]:
        """Prior medians of the dynamics' hyperparameters, all but the noise."""
        if self.path.order == 1:
            return 0.1, 1.0, 1.0
        # Smooth over the loop and over its speeds: velocities are per frame, of a cycle a
        # second they are so many times its radius. The linear part goes on as before.
        second = 2.0 * np.pi / frame_rate
        return 0.01, 0.3, 0.15 * second**-2, 1.0, 1.0

    def balance(self, d: int) -> float:
        """What the log density of the dynamics is multiplied by."""
        return d / self.path.size if self.path.balanced else 1.0

    def _positive(self, name: str, proper: dist.Distribution, power: float) -> AnyArray:
        """Sample a positive site; the paper's prior is theta^power, improper."""
        if self.priors == "proper":
            return jnp.asarray(numpyro.sample(name, proper))
        flat = dist.ImproperUniform(constraints.positive, (), proper.shape())
        value = jnp.asarray(numpyro.sample(name, flat))
        numpyro.factor(f"{name}_prior", power * jnp.sum(jnp.log(value)))
        return value

    def _real(self, name: str, proper: dist.Distribution) -> AnyArray:
        """Sample a real site; with the paper's priors it is flat."""
        flat = dist.ImproperUniform(constraints.real, (), proper.event_shape)
        return jnp.asarray(numpyro.sample(name, proper if self.priors == "proper" else flat))

    def _style(
        self, factor: Factor, index: int, frames: Frames, trained: Trained | None
    ) -> AnyArray:
        """Give the style vectors of all levels (L, S); those of known levels are given."""
        levels, name = frames.levels[index], f"style_{factor.name}"
        if trained is None:
            if factor.kind == "rbf":
                return self._real(name, standard_styles(levels, factor.size))
            entries = self._real(f"shape_{factor.name}", StyleShape(levels, factor.size))
            styles = styles_of(entries, levels, factor.size)
            return jnp.asarray(numpyro.deterministic(name, styles))
        known = trained.styles[factor.name]
        new = levels - known.shape[0]
        if new == 0:
            return known
        if factor.kind == "rbf":
            return jnp.concatenate([known, self._real(name, standard_styles(new, factor.size))])
        later = later_styles if factor.new_levels == "isotropic" else population_styles
        return jnp.concatenate([known, self._real(name, later(known, new, factor.novel))])

    def _content(
        self,
        frames: Frames,
        hyper: Mapping[str, AnyArray],
        trained: Trained | None,
        styles: Mapping[str, AnyArray],
    ) -> Float[AnyArray, "n q"]:
        if self.on_circle:
            return circle(self._phases(frames, trained, styles))
        shape = (len(frames.clip), self.path.size)
        balance = self.balance(frames.y.shape[1])
        past = None if trained is None else trained.steps
        dynamics = latent_dynamics.GPDynamics(
            self.dynamics_alpha(hyper), frames.steps, shape, past, balance
        )
        if trained is not None:
            return jnp.asarray(numpyro.sample("x", dynamics))
        path: dist.Distribution = latent_dynamics.UnitScale(dynamics)
        if self.path.balanced:
            path = Marked(path, BALANCED)
        x = jnp.asarray(numpyro.sample("x", path))
        return latent_dynamics.unit_scale(x, frames.steps)

    def _phases(
        self, frames: Frames, trained: Trained | None, styles: Mapping[str, AnyArray]
    ) -> Float[AnyArray, " n"]:
        """Phase of every frame; a clip's own phase is that of its middle.

        At the middle, and with steps that cannot change sign, phase and step hardly
        depend on each other, and the direction of time is fixed. The first training
        clip's phase is zero.
        """
        fixed = 1 if trained is None else 0
        points = numpyro.sample("phase_point", Ring(frames.n_clips - fixed))
        angles = jnp.concatenate([jnp.zeros(fixed), angle_of(jnp.asarray(points))])
        phase = jnp.asarray(numpyro.deterministic("phase", angles))
        step = self._step(frames, trained, styles)
        if trained is None or not self.wander_sd:
            return phase[frames.clip] + step[frames.clip] * frames.time
        normal = dist.Normal(0.0, 1.0).expand([frames.n_clips, 2]).to_event(2)
        white = jnp.asarray(numpyro.sample("wander", normal))
        until = -jnp.asarray(frames.time)[frames.steps.first]
        gone = wandering(
            frames.time, until[frames.clip], step[frames.clip], white[frames.clip],
            self.wander_sd, frames.frame_rate,
        )  # fmt: skip
        return phase[frames.clip] + gone

    def _step(
        self, frames: Frames, trained: Trained | None, styles: Mapping[str, AnyArray]
    ) -> Float[AnyArray, " c"]:
        """Sample the step of every clip; with a learned pace given those of trained clips."""
        if not self.learns_pace:
            second = jnp.log(2.0 * np.pi / frames.frame_rate)
            free = dist.LogNormal(second, 0.4).expand([frames.n_clips]).to_event(1)
            return self._positive("step", free, 0.0)
        firsts = {name: jnp.asarray(each)[frames.steps.first] for name, each in styles.items()}
        known = None
        if trained is not None:
            first, known = trained.frames.steps.first, jnp.asarray(trained.values["step"])
            firsts = {
                name: jnp.concatenate([jnp.asarray(trained.points[name])[first], each])
                for name, each in firsts.items()
            }
        count = frames.n_clips + (0 if known is None else len(known))
        alike = self._alike(firsts, count)
        steps = step_distribution(frames.frame_rate, alike, known)
        return jnp.asarray(numpyro.sample("step", steps))

    def _alike(self, styles: Mapping[str, AnyArray], count: int) -> Float[Array, "a a"]:
        """Return how alike the styles of clips are: one for a clip of the first levels."""
        alike = jnp.ones((count, count))
        for factor in self.style_factors:
            k = linear(factor.name) if factor.kind == "linear" else rbf(factor.name)
            alike = alike * k.matrix(styles, styles)
        return alike

    def latent_points(
        self, frames: Frames, values: Mapping[str, AnyArray], trained: Trained | None = None
    ) -> dict[str, AnyArray]:
        """Factors and content of every frame for given site values, by the program itself."""
        with numpyro.handlers.block():
            return self._points_at(frames, values, trained)

    def _points_at(
        self, frames: Frames, values: Mapping[str, AnyArray], trained: Trained | None = None
    ) -> dict[str, AnyArray]:
        sites = {name: jnp.asarray(value) for name, value in values.items()}
        with numpyro.handlers.substitute(data=sites):
            return self._points(frames, values if trained is None else trained.hyper, trained)

    def condition(self, frames: Frames, values: Mapping[str, AnyArray]) -> Trained:
        """Condition on training frames and trained site values (one draw)."""
        hyper = {name: values[name] for name in self.hyper_names}
        with numpyro.handlers.trace() as sites:
            points = self._points_at(frames, values)
        styles: dict[str, AnyArray] = {
            f.name: f.padded(sites[f"style_{f.name}"]["value"]) for f in self.style_factors
        }
        K, y = self.process(frames, values, points), jnp.asarray(frames.y)
        if isinstance(K, CircleCovariance):
            conditioned = K.condition(y, frames.missing)
        else:
            conditioned = condition(y, K, frames.missing)
        steps = None
        if not self.on_circle:
            steps = latent_dynamics.given_steps(
                self.dynamics_alpha(hyper), points["content"], frames.steps
            )
        points |= {f.name: f.padded(points[f.name]) for f in self.style_factors}
        return Trained(hyper, styles, points, conditioned, steps, frames, dict(values))

    def predict(
        self, trained: Trained, frames: Frames, values: Mapping[str, AnyArray]
    ) -> dict[str, GPPredictive]:
        """Predict every frame of new clips, seen or not, given all that is seen of them."""
        points = self.latent_points(frames, values, trained)
        # What the clip does of its own accord goes on into the frames to come.
        own = self.covariance(frames, {**trained.hyper, **values}, points, white=False)
        loc, K = self.outputs(trained, points, own)
        white = self._white(trained.hyper, frames)
        mean, covariance = smooth(jnp.asarray(frames.y), loc, K, white, frames.missing)
        noise, scale = 1.0 / trained.hyper["beta"], trained.hyper["scale"]
        wider = None
        if self.student_df is not None:
            residual = jnp.asarray(frames.y) - loc
            wider = spread_of_columns(residual, K + white, scale, self.student_df, frames.missing)
        columns = frames.missing.columns
        return {"y": GPPredictive(mean, covariance, noise, scale, columns, wider)}

    @property
    def hyper_names(self) -> tuple[str, ...]:
        """Names of the sites that new clips share with the training clips."""
        alpha = () if self.on_circle else ("alpha",)
        own = ("residual_variance", "residual_time") if self.one_residual else ()
        return ("gamma", "beta", "scale", *own, *alpha)
