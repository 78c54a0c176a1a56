"""Multifactor Gaussian process model of motion (Wang, Fleet and Hertzmann 2007).

The pose at frame t of clip c, of subject i and gait j, is a function of three
factors with a Gaussian process prior (eq. 15):

    y_d(t) ~ GP(0, k / w_d^2)
    k = (s^T s') (g^T g') exp(-gamma / 2 |x - x'|^2) + delta / beta

    s_i                                  one style vector in R^3 a subject
    g_j                                  one a gait, and so on for any factor
    x_t                                  the content, by one of three dynamics:
      circle     x_t = (cos theta_t, sin theta_t),  theta_t = phase_c + step_c (t - middle)
      gp         x_1, x_2 ~ N(0, I_3),  x_t ~ GP(x_{t-1}, x_{t-1} - x_{t-2}),
                 of first order x_t ~ GP(x_{t-1}) as in the paper   (`priors.dynamics`)
      balanced   the same with its log density times D / Q

With Gaussian process dynamics the training content has unit mean square about the
mean of each clip: k sees only gamma |x - x'|^2, and a smaller x always makes its
dynamics more probable.

A clip whose label is unknown has a style vector of its own. Without factors k
is the RBF kernel on the content alone (GPDM, B-GPDM).

Nothing is left free that no data can tell. Style vectors of a linear factor count
up to a rotation and a common length: the first level's is (1, 0, 0), the second's
lies in the plane of the first two axes (`priors.styles`). Phases count up to a
common shift: the first training clip's is zero.

Priors. ``priors="proper"`` (features are scaled to unit spread first):

    gamma ~ LogNormal(0, 1)              inverse squared length, content has unit size
    beta ~ LogNormal(log 100, 2)         signal to noise variance
    w_d ~ HalfNormal(1)                  one over the spread of a scaled feature
    s, g ~ shapes of N(0, I_3) vectors   for a linear factor; N(0, I_3) for an rbf one
    step ~ LogNormal(log(2 pi / (1 s x frame rate)), 0.4)   radians a frame: a cycle
                                         takes about one second, 0.45 s to 2.2 s in 95 %
    drift_c ~ LogNormal(log 0.01, 2)     variance of a clip's own deviation (noise="own_drift")
    drift_time_c ~ LogNormal(log (1/3 s x frame rate), 1)   its time scale in frames
    alpha ~ LogNormal(log medians, 1)    of the dynamics (`Multifactor.alpha_median`), but
                                         their noise, which is a setting (`dynamics_noise`);
                                         balanced D / Q times as sharp, like the dynamics
    phase ~ uniform on the circle        sampled as a point near it (`priors.circle`)

``priors="paper"``: p(beta, gamma) ~ 1 / (beta gamma), p(alpha) ~ prod 1 / alpha_i,
everything else flat; improper, so for point estimates only.

`Multifactor.program` samples every site. `Multifactor.collapsed` is the same model of
the training clips with the scales w integrated out, which `complete_draw` draws again.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Float, PRNGKeyArray
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ..errors import InputError
from ..gp.collapsed import CollapsedProcess, draw_scale
from ..gp.kernels import Kernel, linear, rbf
from ..gp.linalg import AnyArray
from ..gp.matrix_normal import GaussianProcess, condition, smooth, spread_of_columns
from ..gp.unnormalised import Marked, NoDensity
from ..priors.circle import Ring, angle_of, circle
from ..priors.dynamics import GPDynamics, UnitScale, given_steps, unit_scale
from ..priors.styles import StyleShape, entry_names, later_styles, styles_of
from .factors import SUBJECT_AND_GAIT, Factor, standard_styles
from .poses import Frames
from .predicting import Given, Prediction
from .training import Training, prepare

Dynamics = Literal["circle", "gp", "balanced"]
Noise = Literal["white", "drift", "own_drift"]
# A residual's variance that is too small to matter, of the first levels' outputs.
SLIGHT = 0.01
ALPHA_PARTS = {
    1: ["variance", "gamma", "linear_variance"],
    2: ["variance", "gamma", "gamma_velocity", "linear_variance", "linear_variance_velocity"],
}

BALANCED = NoDensity(
    "the density of balanced dynamics is taken D / Q times, and its constant, which depends on "
    "alpha, is not known",
    "Use dynamics 'gp' or 'circle', method map, or fix alpha",
    ("alpha",),
)


@dataclass(frozen=True)
class Multifactor:
    """The multifactor model with its settings; see the module for the equations.

    The defaults are what forecasts of training people who are left out choose
    (`studies.multifactor_defaults`).

    Parameters
    ----------
    dynamics
        ``circle``, ``gp`` or ``balanced``.
    factors
        Style factors; none gives the plain GPDM, B-GPDM or circle model.
    content_size
        Q, the size of x with gp and balanced dynamics; the circle has 2.
    priors
        ``proper`` or ``paper``.
    noise
        ``white`` (the paper), ``drift`` or ``own_drift``. With ``drift`` each clip also has a
        deviation of its own, an Ornstein-Uhlenbeck process in time for every output, of one
        size and slowness for all clips. With ``own_drift``, the default, these are each clip's
        own: a new clip of a new person strays farther from what the factors make of it than
        the training clips do, and its intervals are wider; but at the mode the deviation can
        also take the place of what the factors should explain.
    freedom
        Every output of a new clip may stray from what the trained process makes of it
        by more than the training clips, whose styles were fitted to them, or by less:
        in forecasts its covariance is multiplied by lambda_d, as the frames given tell of it
        (`gp.matrix_normal.spread_of_columns`), with lambda_d ~ InverseGamma(freedom / 2,
        freedom / 2) beforehand. None: by one. Styles and phase are estimated as if it were
        one: with lambda_d integrated out there, a body that walks upside down, most of
        its outputs straying, can be likelier than one that walks.
    order
        Of the gp and balanced dynamics: 1, the paper's, where a place of the latent
        space has one speed, or 2, where a path goes on at the speed it came.
    dynamics_noise
        Standard deviation of a step of x about its mean, with x of unit scale. It
        is set, not estimated: as it goes to zero, paths can be found that make the
        density of the dynamics as large as one likes.
    """

    dynamics: Dynamics = "circle"
    factors: tuple[Factor, ...] = SUBJECT_AND_GAIT
    content_size: int = 3
    priors: Literal["proper", "paper"] = "proper"
    noise: Noise = "own_drift"
    freedom: float | None = 16.0
    order: Literal[1, 2] = 2
    dynamics_noise: float = 0.03

    name: ClassVar[str] = "multifactor"

    def __post_init__(self) -> None:
        """Refuse outputs without a variance."""
        if self.freedom is not None and not 2.0 < self.freedom < np.inf:
            raise InputError(
                f"freedom {self.freedom:g}",
                "with two degrees of freedom or less an output has no variance",
                "Use a finite number above two, or leave it out for a Gaussian process",
            )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> "Multifactor":
        """Make the model from its settings as plain values."""
        factors = tuple(Factor(**factor) for factor in settings["factors"])
        return cls(**{**settings, "factors": factors})

    def prepare(self, motion: xr.Dataset, *, turned: bool = False) -> Training:
        """Make training clips into arrays; see `models.training.prepare`."""
        names = tuple(factor.name for factor in self.factors)
        return prepare(motion, names, turned=turned)

    @property
    def init_from(self) -> "Multifactor | None":
        """The same model on the circle, the plainest path: its mode is where others begin."""
        return None if self.dynamics == "circle" else replace(self, dynamics="circle")

    @property
    def rotations(self) -> tuple[str, ...]:
        """A latent path: its kernels see distances and inner products alone."""
        return () if self.dynamics == "circle" else ("x",)

    def initial_values(
        self, training: Training, seed: int, count: int
    ) -> list[dict[str, np.ndarray]]:
        """Give values of the sites to begin the search for the mode from."""
        from .starts import training_starts  # it needs the model in turn

        return training_starts(self, training.frames, seed, count)

    def initial_values_from(
        self, training: Training, seed: int, count: int, simpler: Mapping[str, AnyArray]
    ) -> list[dict[str, np.ndarray]]:
        """Give starts of which every other one is the mode of the circle."""
        from .starts import training_starts

        return training_starts(self, training.frames, seed, count, simpler)

    def preconditioners(
        self, training: Training, start: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Root of the approximate covariance of the latent path near a start."""
        from .starts import search_roots

        return search_roots(self, training.frames, start)

    def program(self, frames: Frames, given: Given | None = None) -> None:
        """Generate the poses `frames.y` (N, D); with `given`, those of new clips.

        Conditioned on a trained model the hyperparameters and the styles of known
        levels are given, and the outputs are what the trained process predicts.
        """
        hyper = self._hyperparameters(frames) if given is None else given.hyper
        points = self._points(frames, hyper, given)
        K = self.kernel(hyper).matrix(points, points)
        K = K + self._noise(hyper, self._deviation(frames, given), frames)
        loc = None
        if given is not None:
            loc, K = given.conditioned(self.kernel(hyper).matrix(points, given.points), K)
        outputs = GaussianProcess(K, hyper["scale"], loc, frames.missing)
        numpyro.sample("y", outputs, obs=frames.y)

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
        K = self.kernel(hyper).matrix(points, points)
        K = K + self._noise(hyper, self._deviation(frames, None), frames)
        outputs = CollapsedProcess(K, frames.y.shape[1], frames.missing)
        numpyro.sample("y", outputs, obs=frames.y)

    def complete_draw(
        self, key: PRNGKeyArray, frames: Frames, values: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Draw the scales that go with a draw of the other sites; give all of them."""
        K = self.covariance(frames, values)
        scale = draw_scale(key, jnp.asarray(frames.y), K, frames.missing)
        return {**values, "scale": scale}

    def kernel(self, hyper: Mapping[str, AnyArray]) -> Kernel:
        """Covariance of one output of scale 1 without the noise (eq. 15)."""
        k: Kernel = rbf("content", length_scale=hyper["gamma"] ** -0.5)
        for factor in self.factors:
            k = k * (linear(factor.name) if factor.kind == "linear" else rbf(factor.name))
        return k

    def _points(
        self, frames: Frames, hyper: Mapping[str, AnyArray], given: Given | None
    ) -> dict[str, AnyArray]:
        """Sample the factors and the content of every frame."""
        points = {}
        for index, factor in enumerate(self.factors):
            style = self._style(factor, index, frames, given)
            points[factor.name] = style[frames.level[factor.name]][frames.clip]
        return {**points, "content": self._content(frames, hyper, given)}

    def _white(self, hyper: Mapping[str, AnyArray], frames: Frames) -> Float[AnyArray, "n n"]:
        return jnp.eye(len(frames.clip)) / hyper["beta"]

    def _deviation(self, frames: Frames, given: Given | None) -> Mapping[str, AnyArray]:
        """Sample how large and how slow clips' own deviations are: (C,) each, or (1,)."""
        if self.noise == "white":
            return {}
        common = self.noise == "drift"
        if common and given is not None:
            return given.hyper
        count, third = [1 if common else frames.n_clips], jnp.log(frames.frame_rate / 3.0)
        size = dist.LogNormal(jnp.log(0.01), 2.0).expand(count).to_event(1)
        slowness = dist.LogNormal(third, 1.0).expand(count).to_event(1)
        drift = self._positive("drift", size, -1.0)
        return {"drift": drift, "drift_time": self._positive("drift_time", slowness, -1.0)}

    def _drift(self, own: Mapping[str, AnyArray], frames: Frames) -> Float[AnyArray, "n n"]:
        """Covariance of what a clip does of its own accord, beside the factors."""
        clip = frames.clip
        if self.noise == "white":
            return jnp.zeros((len(clip), len(clip)))
        which = clip if self.noise == "own_drift" else 0 * clip
        apart = jnp.abs(frames.time[:, None] - frames.time[None, :]) / own["drift_time"][which]
        same = clip[:, None] == clip[None, :]
        return own["drift"][which] * same * jnp.exp(-apart)

    def _noise(
        self, hyper: Mapping[str, AnyArray], own: Mapping[str, AnyArray], frames: Frames
    ) -> Float[AnyArray, "n n"]:
        """Covariance of all that no factor explains."""
        return self._white(hyper, frames) + self._drift(own, frames)

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
        points = self.points(frames, values) if points is None else points
        noise = self._noise(values, values, frames) if white else self._drift(values, frames)
        return self.kernel(values).matrix(points, points) + noise

    def _hyperparameters(self, frames: Frames, scales: bool = True) -> dict[str, AnyArray]:
        priors: dict[str, tuple[dist.Distribution, float]] = {
            "gamma": (dist.LogNormal(0.0, 1.0), -1.0),
            "beta": (dist.LogNormal(jnp.log(100.0), 2.0), -1.0),
        }
        if scales:
            half_normal = dist.HalfNormal(1.0).expand([frames.y.shape[1]]).to_event(1)
            priors["scale"] = (half_normal, 0.0)
        if self.dynamics != "circle":
            medians = jnp.log(jnp.asarray(self.alpha_median(frames.frame_rate)))
            # What is known of the dynamics counts as often as the dynamics themselves.
            spread = self.balance(frames.y.shape[1]) ** -0.5
            priors["alpha"] = (dist.LogNormal(medians, spread).to_event(1), -1.0)
        return {name: self._positive(name, *prior) for name, prior in priors.items()}

    def dynamics_alpha(self, hyper: Mapping[str, AnyArray]) -> Float[AnyArray, " a"]:
        """Hyperparameters of the gp and balanced dynamics, the last their precision."""
        return jnp.append(jnp.asarray(hyper["alpha"]), self.dynamics_noise**-2)

    def alpha_median(self, frame_rate: Float[AnyArray, ""] | float) -> tuple[AnyArray | float, ...]:
        """Prior medians of the dynamics' hyperparameters, all but the noise."""
        if self.order == 1:
            return 0.1, 1.0, 1.0
        # Smooth over the loop and over its speeds: velocities are per frame, of a cycle a
        # second they are so many times its radius. The linear part goes on as before.
        second = 2.0 * np.pi / frame_rate
        return 0.01, 0.3, 0.15 * second**-2, 1.0, 1.0

    def balance(self, d: int) -> float:
        """What the log density of the dynamics is multiplied by."""
        return d / self.content_size if self.dynamics == "balanced" else 1.0

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

    def _style(self, factor: Factor, index: int, frames: Frames, given: Given | None) -> AnyArray:
        """Give the style vectors of all levels (L, S); those of known levels are given."""
        levels, name = frames.levels[index], f"style_{factor.name}"
        if given is None:
            if factor.kind == "rbf":
                return self._real(name, standard_styles(levels, factor.size))
            entries = self._real(f"shape_{factor.name}", StyleShape(levels, factor.size))
            styles = styles_of(entries, levels, factor.size)
            return jnp.asarray(numpyro.deterministic(name, styles))
        known = given.styles[factor.name]
        new = levels - known.shape[0]
        if new == 0:
            return known
        if factor.kind == "rbf":
            return jnp.concatenate([known, self._real(name, standard_styles(new, factor.size))])
        return jnp.concatenate([known, self._real(name, later_styles(known, new, factor.spare))])

    def _content(
        self, frames: Frames, hyper: Mapping[str, AnyArray], given: Given | None
    ) -> Float[AnyArray, "n q"]:
        if self.dynamics == "circle":
            return circle(self._phases(frames, given))
        shape = (len(frames.clip), self.content_size)
        balance = self.balance(frames.y.shape[1])
        past = None if given is None else given.steps
        dynamics = GPDynamics(self.dynamics_alpha(hyper), frames.steps, shape, past, balance)
        if given is not None:
            return jnp.asarray(numpyro.sample("x", dynamics))
        path: dist.Distribution = UnitScale(dynamics)
        if self.dynamics == "balanced":
            path = Marked(path, BALANCED)
        x = jnp.asarray(numpyro.sample("x", path))
        return unit_scale(x, frames.steps)

    def _phases(self, frames: Frames, given: Given | None) -> Float[AnyArray, " n"]:
        """Phase of every frame; a clip's own phase is that of its middle.

        At the middle, and with steps that cannot change sign, phase and step hardly
        depend on each other, and the direction of time is fixed. The first training
        clip's phase is zero.
        """
        fixed = 1 if given is None else 0
        points = numpyro.sample("phase_point", Ring(frames.n_clips - fixed))
        angles = jnp.concatenate([jnp.zeros(fixed), angle_of(jnp.asarray(points))])
        phase = jnp.asarray(numpyro.deterministic("phase", angles))
        step = self._positive_step(frames)
        return phase[frames.clip] + step[frames.clip] * frames.time

    def _positive_step(self, frames: Frames) -> Float[AnyArray, " c"]:
        second = jnp.log(2.0 * np.pi / frames.frame_rate)
        proper = dist.LogNormal(second, 0.4).expand([frames.n_clips]).to_event(1)
        return self._positive("step", proper, 0.0)

    def points(
        self, frames: Frames, values: Mapping[str, AnyArray], given: Given | None = None
    ) -> dict[str, AnyArray]:
        """Factors and content of every frame for given site values, by the program itself."""
        with numpyro.handlers.block():
            return self._points_at(frames, values, given)

    def _points_at(
        self, frames: Frames, values: Mapping[str, AnyArray], given: Given | None = None
    ) -> dict[str, AnyArray]:
        sites = {name: jnp.asarray(value) for name, value in values.items()}
        with numpyro.handlers.substitute(data=sites):
            return self._points(frames, values if given is None else given.hyper, given)

    def condition(self, frames: Frames, values: Mapping[str, AnyArray]) -> Given:
        """Condition on training frames and trained site values (one draw)."""
        hyper = {name: values[name] for name in self.hyper_names}
        with numpyro.handlers.trace() as sites:
            points = self._points_at(frames, values)
        styles: dict[str, AnyArray] = {
            f.name: f.padded(sites[f"style_{f.name}"]["value"]) for f in self.factors
        }
        K = self.kernel(hyper).matrix(points, points) + self._noise(hyper, values, frames)
        conditioned = condition(jnp.asarray(frames.y), K, frames.missing)
        steps = None
        if self.dynamics != "circle":
            steps = given_steps(self.dynamics_alpha(hyper), points["content"], frames.steps)
        points |= {f.name: f.padded(points[f.name]) for f in self.factors}
        return Given(hyper, styles, points, conditioned, steps)

    def predict(self, frames: Frames, values: Mapping[str, AnyArray], given: Given) -> Prediction:
        """Predict every frame of new clips, seen or not, given training and all seen entries."""
        points = self.points(frames, values, given)
        kernel = self.kernel(given.hyper)
        cross = kernel.matrix(points, given.points)
        # What the clip does of its own accord goes on into the frames to come.
        own = kernel.matrix(points, points) + self._drift({**given.hyper, **values}, frames)
        loc, K = given.conditioned(cross, own)
        white = self._white(given.hyper, frames)
        mean, covariance = smooth(jnp.asarray(frames.y), loc, K, white, frames.missing)
        noise, scale = 1.0 / given.hyper["beta"], given.hyper["scale"]
        stray = None
        if self.freedom is not None:
            residual = jnp.asarray(frames.y) - loc
            stray = spread_of_columns(residual, K + white, scale, self.freedom, frames.missing)
        return Prediction(mean, covariance, noise, scale, frames.missing.columns, stray)

    def cautions(self, training: Training, values: Mapping[str, AnyArray]) -> list[str]:
        """Tell of residuals slower than their clips: poses that synthesis leaves out."""
        if self.noise == "white":
            return []
        frames = np.bincount(np.asarray(training.frames.clip))
        own = self.noise == "own_drift"
        late = np.asarray(values["drift_time"]) > (frames if own else frames.max())
        late &= np.asarray(values["drift"]) > SLIGHT
        whose = ", ".join(np.asarray(training.clips)[late]) if own else "the clips"
        told = (
            f"the residuals of {whose} change more slowly than the clips are long: they hold "
            "poses that the factors do not explain, and synthesis leaves them out"
        )
        return [told] if late.any() else []

    @property
    def hyper_names(self) -> tuple[str, ...]:
        """Names of the sites that new clips share with the training clips."""
        alpha = () if self.dynamics == "circle" else ("alpha",)
        drift = ("drift", "drift_time") if self.noise == "drift" else ()
        return ("gamma", "beta", "scale", *drift, *alpha)

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of every site."""
        clips = ("all_clips",) if self.noise == "drift" else ("training_clip",)
        names: dict[str, tuple[str, ...]] = {
            "y": ("frame", "feature"),
            "gamma": (),
            "beta": (),
            "scale": ("feature",),
            "drift": clips,
            "drift_time": clips,
            "phase": ("training_clip",),
            "phase_point": ("moving_clip", "plane"),
            "step": ("training_clip",),
            "alpha": ("alpha_part",),
            "x": ("frame", "latent"),
        }
        styles = {f"style_{f.name}": (f"level_{f.name}", f"axis_{f.name}") for f in self.factors}
        shapes = {f"shape_{f.name}": (f"entry_{f.name}",) for f in self.factors}
        return names | styles | shapes

    def coords(self, training: Any) -> dict[str, list]:
        """Give the labels of every dimension for the training clips."""
        frames: Frames = training.frames
        out: dict[str, list] = {
            "feature": list(training.encoding.layout.labels),
            "training_clip": list(training.clips),
            "all_clips": ["all"],
            "moving_clip": list(training.clips[1:]),
            "plane": ["cos", "sin"],
            "alpha_part": ALPHA_PARTS[self.order],
            "frame": list(range(len(frames.clip))),
            "latent": list(range(self.content_size)),
        }
        for factor, count in zip(self.factors, frames.levels, strict=True):
            known = training.levels[factor.name]
            unknown = [f"unknown {i + 1}" for i in range(count - len(known))]
            out |= {f"level_{factor.name}": [*known, *unknown]}
            out |= {f"axis_{factor.name}": list(range(factor.size))}
            out |= {f"entry_{factor.name}": entry_names(count, factor.size)}
        return out
