"""What a model of the collection is: its verbs.

A model is a frozen dataclass of settings around a NumPyro program. The verbs of `Model`
are what fitting, saving, prediction and criticism ask for, and all they ask for. A model
that can do more has more verbs, each a small protocol (`Marginalised`, `WarmStarted`, ...; those
that single tasks need are in `verbs`); whoever needs one asks by `isinstance` and says in a
sentence when it is missing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float, Int, PRNGKeyArray
from numpyro import handlers

from .gp.linalg import AnyArray
from .motion.skeleton import Skeleton
from .prediction import Predictive
from .search_state import SearchState

Values = dict[str, Array]
# How a site tells the size of the noise.
NoiseMeaning = Literal["precision", "variance", "log_odds", "sd"]


class Units(NamedTuple):
    """How an observed variable's entries are brought back to the units of recordings.

    Entries are ``location + scale * y``, feature by feature.
    """

    location: Float[np.ndarray, " d"]
    scale: Float[np.ndarray, " d"]

    def natural(self, y: Float[np.ndarray, "*s d"]) -> Float[np.ndarray, "*s d"]:
        """Return scaled entries in the units of recordings."""
        return self.location + self.scale * y

    def scaled(self, entries: Float[np.ndarray, "*s d"]) -> Float[np.ndarray, "*s d"]:
        """Return entries in the units of recordings scaled, as `Data.observed` has them."""
        return (entries - self.location) / self.scale


@runtime_checkable
class ProgramData(Protocol):
    """Recordings as a model's program sees them: what fitting asks for."""

    @property
    def data(self) -> tuple:
        """The argument of the model's program, a pytree of arrays, as a tuple of one."""
        ...

    def observed(self) -> xr.Dataset:
        """Return what the model explains, one variable an observed site, NaN where missing."""
        ...

    def constants(self) -> xr.Dataset:
        """Return what is needed to bring the observed values back to their units."""
        ...


@runtime_checkable
class Data(ProgramData, Protocol):
    """Recordings as a model's program sees them."""

    def units(self) -> dict[str, Units]:
        """Return the units of every observed site."""
        ...


@runtime_checkable
class MotionData(Data, Protocol):
    """Data whose observed values can be made motions again."""

    def to_motion(self, values: Mapping[str, Float[np.ndarray, "..."]]) -> xr.Dataset:
        """Return clips with these values of the observed sites, NaN where they are missing.

        Clips, labels, skeletons and frame rates are those of the recordings; values are in
        the units of `observed`.
        """
        ...


@runtime_checkable
class AngleData(MotionData, Protocol):
    """Motions whose errors can be told in radians."""

    @property
    def angles(self) -> np.ndarray:
        """Columns of the observed values that are joint angles in radians."""
        ...


@runtime_checkable
class LengthData(MotionData, Protocol):
    """Motions whose lengths are told in those of bodies."""

    def in_units_of(self, skeleton: Skeleton) -> Float[np.ndarray, " d"]:
        """Return by what observed values in `units` are multiplied to be in a skeleton's unit."""
        ...


@dataclass(frozen=True)
class About:
    """What a model is, for tables and messages.

    paper
        Who published it, and when.
    recordings
        What it is fitted to, in a few words.
    methods
        Names of the methods that fit it, the default first.
    """

    paper: str
    recordings: str
    methods: tuple[str, ...] = ("map", "nuts", "ensemble")


@runtime_checkable
class HasProgram(Protocol):
    """Anything with a NumPyro program."""

    @property
    def program(self) -> Callable[..., None]:
        """The program, a function of its data."""
        ...


@runtime_checkable
class Fittable[DataT](Protocol):
    """The verbs that fitting asks for."""

    name: ClassVar[str]
    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def prepare(self) -> Callable[..., ProgramData]:
        """Make recordings into `Data`: ``prepare(recordings, trained=None)``.

        With the training `Data` as `trained`, new recordings are described in its units, and
        labels in its levels. NaN is missing.
        """
        ...

    @property
    def program(self) -> Callable[..., None]:
        """The generative program, a function of `Data.data`.

        With the trained model (`condition`) as its last argument it is that of new data: it
        samples what new recordings have of their own, and their observed sites.
        """
        ...

    @property
    def initial_values(self) -> Callable[..., list[dict[str, np.ndarray]]]:
        """Return values of the unobserved sites, where a search for the mode begins.

        ``initial_values(data, seed, count, trained=None)`` returns at most `count` of them; with
        `trained` (`condition`) those of new data: where it has no sites, one empty dictionary.
        """
        ...

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the names of the dimensions of every site, and of identified quantities."""
        ...

    def coords(self, data: DataT) -> dict[str, list]:
        """Return the labels of every dimension."""
        ...


@runtime_checkable
class Model[DataT, FramesT, TrainedT](Fittable[DataT], Protocol):
    """The verbs of a model: those of `Fittable`, prediction, and criticism."""

    about: ClassVar[About]

    @property
    def prepare(self) -> Callable[..., Data]:
        """Make recordings into `Data`, as `Fittable.prepare`."""
        ...

    @classmethod
    def example(cls, seed: int = 0) -> tuple["Model", xr.Dataset]:
        """Return a small model and recordings made for it: fitted by MAP within seconds."""
        ...

    def condition(self, frames: FramesT, values: Mapping[str, AnyArray], /) -> TrainedT:
        """Return the trained model: a pytree, of training arrays and one draw of all sites."""
        ...

    def predict(
        self, trained: TrainedT, frames: FramesT, values: Mapping[str, AnyArray], /
    ) -> Mapping[str, Predictive]:
        """Predict every entry of new data, seen or not, for every observed site.

        `values` are one draw of the unobserved sites of the program given `trained`.
        """
        ...

    def identified(self, frames: FramesT, values: Mapping[str, AnyArray], /) -> Values:
        """Return what the data can tell of one draw: functions free of symmetries.

        R-hat and effective sample sizes are judged on these.
        """
        ...

    def pointwise(self, frames: FramesT, values: Mapping[str, AnyArray], /) -> Float[Array, " n"]:
        """Return ``log p(y_i | y_-i, theta)`` of every point of the training data, for one draw.

        A point is what is left out together: a frame with all its features, a segment, a
        clip. Where points are independent given theta it is their log likelihood. A point of
        which nothing is seen has zero.
        """
        ...

    def points(self, data: DataT) -> dict[str, tuple[str, np.ndarray]]:
        """Return coordinates of those points along the dimension ``point``.

        ``clip`` is among them where points belong to clips.
        """
        ...

    def sbc_case(self) -> tuple["SBCCase", FramesT]:
        """Return a small instance of this very model for simulation-based calibration.

        With it the program's argument: outcomes are not looked at, all else is as simulated.

        Raises
        ------
        InputError
            If the model has no density that can be drawn from.
        """
        ...


# A protocol with attributes can be asked of an instance, not of a class: at run time it is a type.
@runtime_checkable
class ReadsFiles(Protocol):
    """A model whose recordings are read from files by name, as the command line does."""

    @property
    def read(self) -> Callable[..., xr.Dataset]:
        """Read recordings: ``read(files, **options)``, options with defaults and types."""
        ...

    @classmethod
    def settings_for(cls, recordings: xr.Dataset) -> dict[str, Any]:
        """Return the settings that follow from recordings where they are not given."""
        ...


@runtime_checkable
class WarmStarted[DataT](Protocol):
    """A model whose search for the mode begins at that of a simpler one."""

    @property
    def init_from(self) -> Fittable | None:
        """The simpler model; None where this is the simplest."""
        ...

    def initial_values_from(
        self, data: DataT, seed: int, count: int, simpler: Mapping[str, AnyArray]
    ) -> list[dict[str, np.ndarray]]:
        """Return initial values as `Model.initial_values`, from the simpler model's mode."""
        ...

    def preconditioners(self, data: DataT, start: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        """Return for sites (N, Q) a root of their approximate covariance, see `maximise`."""
        ...


@runtime_checkable
class IntegratesUnknowns(Protocol):
    """A model whose predictions average over what a context leaves open of new data's unknowns."""

    @property
    def unknown_draws(self) -> int:
        """How many draws about each mode, over all draws of a fit; none for the modes alone."""
        ...


@runtime_checkable
class RotationInvariant(Protocol):
    """A model with latent points that count up to a rotation and reflection about the origin."""

    @property
    def rotations(self) -> tuple[str, ...]:
        """Names of such sites, each (N, Q), or (K, N, Q) with a rotation for each of K."""
        ...


@runtime_checkable
class ScaleInvariant(Protocol):
    """A model with latent points that count up to their common size."""

    @property
    def free_scales(self) -> tuple[str, ...]:
        """Names of such sites: multiplied by any positive number they say the same."""
        ...


@runtime_checkable
class PermutationInvariant(Protocol):
    """A model with components that may change places without changing what it says."""

    @property
    def permutations(self) -> tuple[Mapping[str, tuple[int, ...]], ...]:
        """Sites whose components change places together, one mapping for each kind of component.

        Of each such site the axes that count the components: ``(0,)`` for means (K, D),
        ``(0, 1)`` for a matrix of transitions (K, K).
        """
        ...


@runtime_checkable
class PhaseInvariant(Protocol):
    """A model whose phases count up to a common shift and the direction of time."""

    @property
    def phases(self) -> tuple[tuple[str, str], ...]:
        """Pairs of sites (C,): phases of clips in radians, and what they grow by in a frame."""
        ...


@runtime_checkable
class Marginalised[FramesT](Protocol):
    """A model some of whose sites can be integrated out, and drawn again."""

    @property
    def collapsed(self) -> Callable[..., None]:
        """The program without those sites."""
        ...

    def complete_draw(
        self, key: PRNGKeyArray, frames: FramesT, values: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Draw those sites given the values of the others; return all of them."""
        ...


@runtime_checkable
class LeavesEntriesOut[FramesT](Protocol):
    """A model that tells every entry of its observed site from all others."""

    def entries(
        self, frames: FramesT, values: Mapping[str, AnyArray]
    ) -> tuple[Float[Array, "n d"], Float[Array, "n d"]]:
        """Return mean and variance (N, D) of every entry given all others, for one draw."""
        ...


@runtime_checkable
class Cautious[DataT](Protocol):
    """A model that says, once it is fitted, what not to trust of it."""

    def cautions(self, training: DataT, values: Mapping[str, AnyArray]) -> list[str]:
        """Return a sentence for each part that its trained values leave in doubt."""
        ...


@runtime_checkable
class TellsNovelty[TrainedT, FramesT](Protocol):
    """A model that says where new recordings are unlike all it was trained on."""

    def novelty(
        self, trained: TrainedT, frames: FramesT, values: Mapping[str, AnyArray]
    ) -> list[str]:
        """Return a sentence for each way in which recordings are novel.

        `trained` is of one draw (`condition`), `values` are the recordings' own unknowns.
        """
        ...


@runtime_checkable
class InfersFromContext(Protocol):
    """A model whose recordings' own unknowns are as many, however long the recordings are.

    They are searched for in the frames that are seen, whatever the number of frames to predict.
    """

    def until_last_seen(self, recordings: xr.Dataset) -> xr.Dataset:
        """Return recordings without the frames that end them and of which nothing is seen.

        All of them where what is to be predicted has unknowns of its own.
        """
        ...

    def padded(self, recordings: xr.Dataset) -> xr.Dataset:
        """Return recordings followed by frames of NaN, so that they have one of few lengths.

        What is compiled for one recording then serves others; nothing is said of these frames.
        """
        ...


class PointEstimate(NamedTuple):
    """What a search of a model's own found.

    values
        Of every unobserved site of the program, and what they determine.
    log_density
        Of what was maximised, at its end.
    steps
        How many were taken.
    converged
        Whether the search ended by itself.
    """

    values: Mapping[str, AnyArray]
    log_density: float
    steps: int
    converged: bool


Progress = Callable[[int, float], None]


@runtime_checkable
class FittedByEM[DataT](Protocol):
    """A model with expectation maximisation of its own (method ``em``)."""

    def em(
        self, data: DataT, *, seed: int, max_steps: int, tolerance: float,
        progress: Progress | None = None, state: SearchState | None = None,
    ) -> PointEstimate:  # fmt: skip
        """Fit by EM; where priors are flat in the limit it finds the program's optimum."""
        ...


@runtime_checkable
class FittedByFastMarginal[DataT](Protocol):
    """A model whose marginal likelihood is maximised one unknown at a time (``fast``)."""

    def fast_marginal(
        self, data: DataT, *, seed: int, max_steps: int, tolerance: float,
        progress: Progress | None = None, state: SearchState | None = None,
    ) -> PointEstimate:  # fmt: skip
        """Fit by fast marginal likelihood (Tipping and Faul 2003)."""
        ...


@runtime_checkable
class FittedLocally[DataT](Protocol):
    """A model learned patch by patch (method ``local``)."""

    def local_learning(
        self, data: DataT, *, seed: int, sweeps: int, progress: Progress | None = None,
        state: SearchState | None = None,
    ) -> PointEstimate:  # fmt: skip
        """Fit by local learning, covering the latent surface so many times."""
        ...


@dataclass(frozen=True)
class SBCCase[ModelT, FramesT]:
    """A small model and all that simulation-based calibration asks of it.

    Functions are a module's own, not made anew, so that equal cases share a compilation.

    model
        With its settings.
    draw
        Of (model, key, data): an exact draw of the joint distribution, all sites, and data
        with the outcomes in their place; for data of any size.
    shuffle
        Of (key, data): outcomes in a wrong order, as far as the model cares.
    quantities
        Of (model, data, values): what the data can tell of a draw.
    prior
        Name of a site with a normal or log-normal prior, for the control of a wrong prior.
    noise
        Sites that tell the size of the noise, and how, for the control of wrong noise.
    shift
        Of data: outcomes one row late within every clip, see `lagged`. Where None all that
        `draw` puts in the place of outcomes is moved by a row, the last to the front.
    """

    model: ModelT
    draw: Callable[[ModelT, PRNGKeyArray, FramesT], tuple[Values, FramesT]]
    shuffle: Callable[[PRNGKeyArray, FramesT], FramesT]
    quantities: Callable[[ModelT, FramesT, Mapping[str, AnyArray]], Values]
    prior: str
    noise: tuple[tuple[str, NoiseMeaning], ...]
    shift: Callable[[FramesT], FramesT] | None = None

    @property
    def program(self) -> str:
        """Name of the program that is fitted: with sites integrated out, if there is one."""
        return "collapsed" if isinstance(self.model, Marginalised) else "program"


def draw_sites(
    model: HasProgram, key: PRNGKeyArray, data: object, known: Mapping[str, AnyArray] | None = None
) -> Values:
    """Draw every site of a program, observed ones too, with what they determine.

    Parameters
    ----------
    model
        With a program of `data`.
    key
        Random key.
    data
        The program's argument.
    known
        Values of sites that have been drawn already.
    """
    fixed = {name: jnp.asarray(value) for name, value in (known or {}).items()}
    program = handlers.substitute(handlers.uncondition(model.program), data=fixed)
    sites = handlers.trace(handlers.seed(program, key)).get_trace(data)
    kept = ("sample", "deterministic")
    return {name: site["value"] for name, site in sites.items() if site["type"] in kept}


def shuffled(
    key: PRNGKeyArray, y: Float[AnyArray, "n d"], group: Int[AnyArray, " n"]
) -> Float[Array, "n d"]:
    """Put the rows of every group, such as the frames of a clip, in a random order."""
    chance = jax.random.uniform(key, group.shape)
    return jnp.asarray(y)[jnp.lexsort((chance, jnp.asarray(group)))]


def lagged(y: Float[AnyArray, "n d"], group: Int[AnyArray, " n"]) -> Float[Array, "n d"]:
    """Move the rows of every group, such as the frames of a clip, by one; the last to the front.

    Rows of a group stand together.
    """
    group = jnp.asarray(group)
    rows = jnp.arange(len(group))
    begins = jnp.concatenate([jnp.ones(1, bool), group[1:] != group[:-1]])
    ends = jnp.concatenate([begins[1:], jnp.ones(1, bool)])
    # The last row of every group, for its first.
    last = jax.lax.cummin(jnp.where(ends, rows, len(group)), reverse=True)
    return jnp.asarray(y)[jnp.where(begins, last, rows - 1)]


def logs(values: Mapping[str, AnyArray], names: tuple[str, ...]) -> Values:
    """Return the logarithms of positive sites, those of the names that there are."""
    return {f"log_{name}": jnp.log(values[name]) for name in names if name in values}
