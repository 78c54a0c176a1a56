"""What single models can do beyond the verbs of all: what tasks ask for.

Each is a small protocol, implemented in the model's own package. A task asks a model for it by
`isinstance`, and refuses one that lacks it by `catalogue.lacking`. Which task asks for which is
in `catalogue.TASKS`. What a task needs of a model's data it says in a protocol of its own.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float, Key

from .gp.linalg import AnyArray


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
