"""What single models can do beyond the verbs of all: what tasks ask for.

Each is a small protocol, implemented in the model's own package. A task asks a model for it by
`isinstance`, and refuses one that lacks it by `catalogue.lacking`. Which task asks for which is
in `catalogue.TASKS`. What a task needs of a model's data it says in a protocol of its own.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray, PyTree

from .gp.linalg import AnyArray
from .model import Units


@runtime_checkable
class ConditionsOnCycles[FramesT, TrainedT](Protocol):
    """A model of gait cycles that can be conditioned on some of them: people can be left out."""

    def condition_on_some(
        self, frames: FramesT, values: Mapping[str, AnyArray], cycles: Float[AnyArray, " c"]
    ) -> TrainedT:
        """Return `Model.condition` of the cycles that have 1, without those that have 0."""
        ...


@runtime_checkable
class StyleFactor(Protocol):
    """A factor of motion whose levels have style vectors, those of the site ``style_<name>``."""

    @property
    def name(self) -> str:
        """The label of clips."""
        ...

    @property
    def size(self) -> int:
        """Dimensions of the vectors of trained levels."""
        ...

    @property
    def novel(self) -> int:
        """Dimensions that those of new levels have beyond these."""
        ...


@runtime_checkable
class MovesByStyle[FramesT](Protocol):
    """A model of motions by a style for each factor, and a phase."""

    def moved_by(self) -> Sequence[StyleFactor]:
        """Return the factors.

        Raises
        ------
        InputError
            If with these settings there are none, or there is no phase.
        """
        ...

    def step_map(
        self, frames: FramesT, values: Mapping[str, AnyArray]
    ) -> Float[np.ndarray, "s ..."]:
        """Return the map from style vectors to the step of each draw, one axis a factor."""
        ...

    def features_of_styles(
        self,
        frames: FramesT,
        values: Mapping[str, AnyArray],
        styles: Mapping[str, AnyArray],
        phase: Float[np.ndarray, " n"],
        keys: Key[Array, " s"],
        samples: int,
    ) -> tuple[Float[Array, "s n d"], Float[Array, "s n d"], Float[Array, "s j n d"]]:
        """Return mean, variance and joint samples of the scaled features along a path.

        Noise is included.

        Parameters
        ----------
        frames, values
            The training frames, and the sites of the draws (S, ...).
        styles
            For each factor a style vector of every draw and frame (S, N, Q).
        phase
            Of every frame, in radians.
        keys, samples
            So many samples of every draw, by its key.
        """
        ...


@runtime_checkable
class RecognizesLevels[DataT](Protocol):
    """A model that tells which levels of its labels new segments are of, known or new ones."""

    def segments(self, recordings: xr.Dataset, training: DataT) -> xr.DataArray:
        """Return recordings as segments (clip, ...), as those of training were made."""
        ...

    def without(self, training: DataT, held: Bool[np.ndarray, " n"]) -> DataT:
        """Return the training data without some of its segments."""
        ...

    def level_log_densities(
        self, training: DataT, segments: xr.DataArray, values: Mapping[str, AnyArray]
    ) -> Float[Array, "s n c"]:
        """Return the log density of segments for every draw (S, ...) and combination of levels.

        Of each mode the last level is a new one.
        """
        ...


@runtime_checkable
class PredictsCells[DataT](Protocol):
    """A model that predicts segments of combinations of levels that nobody recorded."""

    def cell(
        self, training: DataT, levels: Mapping[str, str], values: Mapping[str, AnyArray]
    ) -> xr.DataArray:
        """Return the segment of a combination of known levels, the mean over draws (S, ...).

        Raises
        ------
        InputError
            If a mode has no level, or one that is not known.
        """
        ...


@runtime_checkable
class DecodesPoses[DataT](Protocol):
    """A model of poses by their components."""

    def joint_angles(
        self,
        training: DataT,
        mean: Float[np.ndarray, "f p"],
        variance: Float[np.ndarray, "f p"],
    ) -> tuple[tuple[str, ...], Float[np.ndarray, "f a"], Float[np.ndarray, "f a"]]:
        """Return names of the angles, and their values and standard deviations in radians.

        That of what the components leave out is among the latter.
        """
        ...


@runtime_checkable
class RelatesViews(Protocol):
    """A model of views of the same frames, such as sound and face: one is told from another."""

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the views."""
        ...


@runtime_checkable
class StartsPaths[DataT, TrainedT](Protocol):
    """A model with published starts of the search for the latent path of new clips."""

    def path_start(self, new: DataT, trained: TrainedT, start: str) -> dict[str, np.ndarray]:
        """Return the sites of new clips at start ``A`` or ``B``.

        Raises
        ------
        InputError
            If with these settings there is no such start.
        """
        ...


@runtime_checkable
class PredictsTrajectory[DataT](Protocol):
    """A model of views with an answer of its own: the most probable trajectory of one of them."""

    def trajectory(
        self, recordings: xr.Dataset, training: DataT, values: Mapping[str, AnyArray]
    ) -> Float[np.ndarray, "t d"]:
        """Return the trajectory, the mean over draws (S, ...), in the units of recordings.

        Raises
        ------
        InputError
            If with these settings there is none.
        """
        ...


class Arrival(NamedTuple):
    """What changes with a frame of a clip that is followed.

    window
        The last frames.
    left
        Where a frame has left the window: of which groups the past's new groups are parts, which
        of them (H,) had been seen in it, and the group (D,) of every column.
    shift
        By how many frames the middle of the window has moved.
    """

    window: PyTree
    left: tuple[Int[np.ndarray, " h"], Float[np.ndarray, " h"], Int[np.ndarray, " d"]] | None
    shift: float


@runtime_checkable
class FollowedProgram[WindowT, PastT, TrainedT](Protocol):
    """The density of a clip that is followed, by its unknowns; equal ones share compilations.

    Its cost is the same however many frames are gone.
    """

    def program(self, window: WindowT, past: PastT, trained: TrainedT, /) -> None:
        """Sample the clip's unknowns; what its frames say is a factor."""
        ...

    def condition(self, frames: object, values: Mapping[str, AnyArray], /) -> TrainedT:
        """Return the trained model of one draw, as `Model.condition`."""
        ...

    def nothing(self, trained: TrainedT, /) -> PastT:
        """Return the past of a clip that begins."""
        ...

    def invariant(self, real: Mapping[str, Array], /) -> list[dict[str, Array]]:
        """Return directions of the unknowns on the real line in which the factor is the same."""
        ...

    def moved(self, own: Mapping[str, Array], frames: Array, /) -> dict[str, Array]:
        """Return the unknowns as they are so many frames later."""
        ...

    def gone(
        self, window: WindowT, past: PastT, trained: TrainedT, own: Mapping[str, AnyArray],
        seen: Array, group: Array, /,
    ) -> PastT:  # fmt: skip
        """Return the past with the first frame of the window."""
        ...

    def noise(self, window: WindowT, key: PRNGKeyArray, /) -> PyTree:
        """Return the random numbers that a joint draw is made of."""
        ...

    def predict(
        self, window: WindowT, past: PastT, trained: TrainedT, own: Mapping[str, AnyArray],
        noise: PyTree, /,
    ) -> tuple[Float[AnyArray, "n d"], Float[AnyArray, "n d"], Float[Array, "n d"]]:  # fmt: skip
        """Predict the frames that follow: mean and variance of every entry, and a joint draw."""
        ...


@runtime_checkable
class Follower[TrainedT](Protocol):
    """A clip as it comes, frame by frame."""

    @property
    def process(self) -> FollowedProgram:
        """What its frames say."""
        ...

    @property
    def units(self) -> Units:
        """Units of what is predicted."""
        ...

    def add(self, frame: xr.Dataset) -> Arrival:
        """Put a frame behind the others: recordings of one frame, NaN where missing.

        Raises
        ------
        InputError
            If it is not such as the model was trained on.
        """
        ...

    def candidates(self, trained: TrainedT, count: int) -> list[dict[str, np.ndarray]]:
        """Return values of the unknowns where a search may begin, the likeliest first."""
        ...

    def motion(self, features: Float[np.ndarray, "n d"], clip: str) -> xr.Dataset:
        """Return what is predicted, in its own units, as a Motion behind the last frame."""
        ...


@runtime_checkable
class FollowsClips[DataT](Protocol):
    """A model whose new clips can be followed frame by frame."""

    def follower(
        self,
        training: DataT,
        values: Mapping[str, Array],
        labels: Mapping[str, str],
        window: int,
        horizon: int,
    ) -> Follower:
        """Return a new clip before its first frame.

        Parameters
        ----------
        training, values
            The training clips, and draws (S, ...) of all sites.
        labels
            What is known of the clip.
        window, horizon
            Frames that the unknowns are told by, and that are forecast.

        Raises
        ------
        InputError
            If with these settings clips cannot be followed.
        """
        ...
