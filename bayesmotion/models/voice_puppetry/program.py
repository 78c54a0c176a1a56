"""Voice puppetry: sound drives a face through a chain of facial states (Brand 1999).

States s_t of every clip follow a Markov chain, and every frame's outputs o, which are the
face, its velocity and the sound, are normal given its state:

    s_1 ~ Categorical(pi),   s_t ~ Categorical(A[s_{t-1}]),   y_o,t ~ N(mu_o,s, Lambda_o,s^-1)

States are summed over (`hidden_markov`): the first output has its density, each further one
that given those before it. Features are scaled to zero mean and unit standard deviation; the
velocity counts as a measurement of its own, as in the paper. Priors:

    pi, rows of A ~ exp(-H) / Z, Brand's entropic prior (`entropic`), a density
    Lambda_o,s    ~ Wishart(D + 1 + 6, 6 w^2 I), with w = `state_sd` the size of an output
                    within a state
    mu_o,s        ~ N(0, 1.5^2 I)

Brand's entropic prior of a normal, exp(-H) ~ |Lambda|^(1/2), is one of the Wishart's six
frames, the other five the ridge that he needs too. What differs from the paper: its chain is
learned of the face alone, and the sound's normals afterwards, from the states' probabilities;
here all outputs are learned together.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Array, Float

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...model import About, PointEstimate, Progress, SBCCase, Values
from ...search_state import SearchState
from ...sensing.face.views import read_views
from . import em, example, identified, prediction, sbc
from .data import VELOCITY, Frames, PuppetryData, prepare_clips
from .hidden_markov import Chain, Outputs, chain, log_emissions
from .prediction import StateMixture, Trained
from .priors import site_priors
from .trajectory import Normals, trajectory


@dataclass(frozen=True)
class VoicePuppetry:
    """The chain with its settings; see the module for the equations.

    Parameters
    ----------
    states
        K.
    face, audio
        Names of the views.
    velocity
        Whether the face's velocity is an output too.
    state_sd
        Prior size of an output within a state, of features of unit standard deviation.

    Raises
    ------
    InputError
        If a number is not positive, or both views are one.
    """

    states: int = 20
    face: str = "face"
    audio: str = "audio"
    velocity: bool = True
    state_sd: float = 0.5

    name: ClassVar[str] = "voice_puppetry"
    about: ClassVar[About] = About(
        "Brand 1999", "speech and a face, or other views of the same frames",
        ("em", "map", "nuts", "ensemble"),
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Check the settings once."""
        if self.states < 1 or not self.state_sd > 0:
            raise InputError("voice puppetry", "a number is not positive", "Use positive ones")
        if self.face == self.audio:
            raise InputError(repr(self.face), "face and audio are one view", "Name two")

    @classmethod
    def example(cls, seed: int = 0) -> tuple["VoicePuppetry", xr.Dataset]:
        """Return a model of three states and clips drawn from a chain of three."""
        return cls(states=3, velocity=False), example.three_mouths(seed)

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the views."""
        return (self.face, self.audio)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the observed sites, in their order."""
        moving = (self.face + VELOCITY,) if self.velocity else ()
        return (self.face, *moving, self.audio)

    read = staticmethod(read_views)

    @classmethod
    def settings_for(cls, recordings: xr.Dataset) -> dict[str, Any]:
        """Return no settings: none follow from recordings."""
        return {}

    def prepare(self, recordings: xr.Dataset, trained: PuppetryData | None = None) -> PuppetryData:
        """Make clips into arrays; see `data`."""
        return prepare_clips(recordings, self.face, self.audio, self.velocity, trained)

    def program(self, frames: Frames, trained: Trained | None = None) -> None:
        """Generate the scaled outputs, each (N, D); given a trained chain those of new clips."""
        values = self._sample(frames) if trained is None else trained.values
        states = self.chain(values, frames)
        known = jnp.zeros((len(frames.begins), self.states))
        for name in self.outputs:
            normal = values[f"{name}_mean"], values[f"{name}_precision"]
            own = Outputs(states, known, *normal, frames.rows[name])
            y = jnp.asarray(numpyro.sample(name, own, obs=frames.y[name]))
            known = known + log_emissions(*normal, y, frames.rows[name])

    def chain(self, values: Mapping[str, AnyArray], frames: Frames) -> Chain:
        """Return the chain of site values and clips."""
        return chain(values["initial"], values["transition"], frames.begins)

    def emissions(self, values: Mapping[str, AnyArray], frames: Frames) -> Float[Array, "n k"]:
        """Return the log density of every frame, all outputs together, under every state."""
        return sum(
            (log_emissions(values[f"{name}_mean"], values[f"{name}_precision"],
                           frames.y[name], frames.rows[name]) for name in self.outputs),
            jnp.zeros((len(frames.begins), self.states)),
        )  # fmt: skip

    def _sample(self, frames: Frames) -> dict[str, AnyArray]:
        priors = site_priors(self, frames).items()
        return {site: jnp.asarray(numpyro.sample(site, prior)) for site, prior in priors}

    def em(
        self, data: PuppetryData, *, seed: int, max_steps: int, tolerance: float,
        progress: Progress | None = None, state: SearchState | None = None,
    ) -> PointEstimate:  # fmt: skip
        """Fit by expectation maximisation, which climbs the program's log density."""
        return em.climb(self, data, seed, max_steps, tolerance, progress, state)

    def initial_values(
        self, data: PuppetryData, seed: int, count: int, trained: Trained | None = None
    ) -> list[dict[str, np.ndarray]]:
        """Return what a few steps of EM make of clusters of frames; new clips have no sites."""
        if trained is not None:
            return [{}]
        return [em.begun(self, data, seed + number) for number in range(count)]

    def condition(self, frames: Frames, values: Mapping[str, AnyArray]) -> Trained:
        """Return the chain of one draw: given that, new clips do not depend on the old."""
        return Trained({name: jnp.asarray(value) for name, value in values.items()})

    def predict(
        self, trained: Trained, frames: Frames, values: Mapping[str, AnyArray]
    ) -> dict[str, StateMixture]:
        """Predict all outputs of new clips from the states' probabilities given what is seen."""
        return prediction.predict(self, trained, frames)

    def trajectory(
        self, recordings: xr.Dataset, training: PuppetryData, values: Mapping[str, AnyArray]
    ) -> Float[np.ndarray, "t d"]:
        """Return the most probable trajectory of the face, the mean over draws; see `trajectory`.

        Raises
        ------
        InputError
            If velocities are no output.
        """
        if not self.velocity:
            raise InputError(
                "trajectory", "the model has no states with velocities", "Use `audio_to_face`"
            )
        new = self.prepare(recordings.drop_vars(self.face, errors="ignore"), training)
        sites = {name: np.asarray(value) for name, value in values.items()}
        count = len(next(iter(sites.values())))
        made = [self._trajectory(new, {n: v[i] for n, v in sites.items()}) for i in range(count)]
        units = new.units()[self.face]
        return units.location + units.scale * np.mean(made, axis=0)

    def _trajectory(
        self, new: PuppetryData, values: dict[str, np.ndarray]
    ) -> Float[np.ndarray, "t d"]:
        """Return the trajectory of one draw, scaled as the face is."""
        trained = self.condition(new.frames, values)
        _, found = prediction.state_recursions(self, trained, new.frames)
        face, moving = (values[f"{self.face}{part}_mean"] for part in ("", VELOCITY))
        position = Normals(face, values[f"{self.face}_precision"])
        # Velocities have a mean and a scale of their own: brought to steps of the scaled face.
        units, own = new.units()[self.face], new.units()[self.face + VELOCITY]
        ratio = units.scale / own.scale
        precision = values[f"{self.face}{VELOCITY}_precision"]
        velocity = Normals(
            (moving + own.location / own.scale) / ratio, precision * ratio[:, None] * ratio[None, :]
        )
        occupied = np.exp(np.asarray(found.posterior))
        return trajectory(position, velocity, occupied, np.asarray(new.frames.begins))

    def identified(self, frames: Frames, values: Mapping[str, AnyArray]) -> Values:
        """Return functions of the chain that do not number its states; see `identified`."""
        return identified.quantities(self, frames, values)

    def pointwise(self, frames: Frames, values: Mapping[str, AnyArray]) -> Float[Array, " n"]:
        """Return log p(y_t | y_-t, theta) of every frame, all outputs together."""
        return identified.left_out(self, frames, values)

    def points(self, data: PuppetryData) -> dict[str, tuple[str, np.ndarray]]:
        """Return clip and number of every frame."""
        return {
            "clip": ("point", np.array(data.clip)),
            "frame": ("point", np.arange(len(data.clip))),
        }

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of every site and identified quantity."""
        found: dict[str, tuple[str, ...]] = {
            "initial": ("state",),
            "transition": ("state", "next_state"),
        }
        for name in self.outputs:
            feature = f"{name}_feature"
            found |= {
                name: ("frame", feature),
                f"{name}_mean": ("state", feature),
                f"{name}_precision": ("state", feature, f"{feature}_other"),
            }
        return found | identified.dims(self)

    def coords(self, data: PuppetryData) -> dict[str, list]:
        """Return the labels of every dimension."""
        numbers = list(range(self.states))
        found: dict[str, list] = {
            "frame": list(range(len(data.clip))), "state": numbers, "next_state": numbers,
        }  # fmt: skip
        for name in self.outputs:
            found[f"{name}_feature"] = list(data.labels[name])
            found[f"{name}_feature_other"] = list(data.labels[name])
        return found | identified.coords(self, data.frames)

    def sbc_case(self) -> tuple[SBCCase, Frames]:
        """Return two clips of a few frames and features, of two states; see `sbc`."""
        return sbc.case(self)
