"""The multifactor model: its program with all that fitting, prediction and criticism ask for."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import xarray as xr
from jaxtyping import Array, Float, Key

from ...distributions.styles import entry_names
from ...gp.linalg import AnyArray
from ...model import About, SBCCase
from ...motion.dataset import clips, label_names
from ...motion.io.recordings import read_clips
from ...motion.joining import lengthened, shortened
from ...motion.synthetic.walkers import synthetic_walkers
from ...programs import few_lengths
from . import identified as told
from . import sbc
from . import styles as of_styles
from .data import PoseData, prepare, prepare_new
from .follower import ClipFollower
from .frames import Frames
from .initial_values import preconditioners, training_values
from .new_clips import new_values
from .novelty import novelty
from .prediction import Trained
from .program import ALPHA_PARTS, MultifactorProgram
from .settings import Circle, Factor, White

# A residual's variance that is too small to matter, of the first levels' outputs.
SLIGHT = 0.01


@dataclass(frozen=True)
class Multifactor(MultifactorProgram):
    """The multifactor model; see `program` for its settings and equations.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> model = bm.Multifactor(content=bm.Circle(), factors=("subject", "gait"))
    """

    name: ClassVar[str] = "multifactor"
    about: ClassVar[About] = About(
        "Wang, Fleet and Hertzmann 2007", "motion capture of labelled clips (joint angles)"
    )

    @classmethod
    def example(cls, seed: int = 0) -> tuple["Multifactor", xr.Dataset]:
        """Return a small model and synthetic people who walk and run."""
        walkers = synthetic_walkers(
            ("ann", "ben"), ("walk", "run"), leave_out=[("ben", "run")], seconds=1.2,
            frame_rate=15.0, noise=0.05, seed=seed,
        )  # fmt: skip
        return cls(factors=(Factor("subject", 2), Factor("gait", 2))), walkers

    @staticmethod
    def read(
        files: Sequence[Path],
        *,
        labels: Path | None = None,
        rate: float = 30.0,
        filter: Literal["none", "lowpass"] = "lowpass",
        drop: bool = False,
        frame_rate: float | None = None,
        skeleton: Path | None = None,
    ) -> xr.Dataset:
        """Read motion capture files at one frame rate; see `motion.io.recordings.read_clips`.

        Parameters
        ----------
        labels
            A csv table with one row a clip: clip,subject,gait. An empty cell means unknown;
            every further column is a further factor.
        rate
            Frames a second that the clips are brought to, from any.
        filter
            lowpass first removes what is faster than half the rate; none keeps every n-th frame as
            it is, where that makes the rate.
        drop
            Leave out suspicious frames.
        frame_rate
            Frames a second of the files, where they do not say or are wrong.
        skeleton
            The .asf file of .amc files.
        """
        return read_clips(
            files, labels=labels, rate=rate, filter=filter, drop=drop,
            frame_rate=frame_rate, skeleton=skeleton,
        )  # fmt: skip

    @classmethod
    def settings_for(cls, recordings: xr.Dataset) -> dict[str, Any]:
        """Return the factors: all labels of the recordings that are known of any clip."""
        known = [name for name in label_names(recordings) if np.any(recordings[name] != "")]
        return {"factors": tuple(Factor(name) for name in known)}

    def prepare(self, motion: xr.Dataset, trained: PoseData | None = None) -> PoseData:
        """Make clips into arrays; see `data.prepare` and `data.prepare_new`."""
        names = tuple(factor.name for factor in self.style_factors)
        if trained is not None:
            return prepare_new(motion, trained)
        return prepare(motion, names, align_heading=self.align_heading, lengths=self.lengths)

    def until_last_seen(self, recordings: xr.Dataset) -> xr.Dataset:
        """Return what a new clip's phase, step and styles are told by: frames up to the last seen.

        A latent path has as many unknowns as frames: all of them.
        """
        return shortened(recordings) if self.on_circle else recordings

    def padded(self, recordings: xr.Dataset) -> xr.Dataset:
        """Return a clip followed by frames of NaN up to one of few lengths.

        A latent path has unknowns in these too, and clips that follow each other have no room
        between them: they are returned as they are.
        """
        frames = recordings.sizes["frame"]
        more = few_lengths(frames) - frames
        alone = self.on_circle and len(clips(recordings)) == 1
        return lengthened(recordings, more) if alone and more else recordings

    @property
    def init_from(self) -> "Multifactor | None":
        """The same model on the circle, the plainest path: its mode is where others begin."""
        return None if self.on_circle else replace(self, content=Circle())

    @property
    def rotations(self) -> tuple[str, ...]:
        """A latent path: its kernels see distances and inner products alone."""
        return () if self.on_circle else ("x",)

    def initial_values(
        self, data: PoseData, seed: int, count: int, trained: Trained | None = None
    ) -> list[dict[str, np.ndarray]]:
        """Return values of the sites where the search for the mode begins."""
        if trained is not None:
            return new_values(self, data, count, trained)
        return training_values(self, data.frames, seed, count)

    def initial_values_from(
        self, training: PoseData, seed: int, count: int, simpler: Mapping[str, AnyArray]
    ) -> list[dict[str, np.ndarray]]:
        """Return initial values of which every other one is the mode of the circle."""
        return training_values(self, training.frames, seed, count, simpler)

    def preconditioners(
        self, training: PoseData, start: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Root of the approximate covariance of the latent path near a start."""
        return preconditioners(self, training.frames, start)

    def identified(self, frames: Frames, values: Mapping[str, AnyArray]) -> dict[str, Array]:
        """Return what the data can tell of one draw; see `identified`."""
        return told.identified(self, frames, values)

    def pointwise(self, frames: Frames, values: Mapping[str, AnyArray]) -> Float[Array, " n"]:
        """Return the log density of every frame given all other frames."""
        return told.pointwise(self, frames, values)

    def entries(
        self, frames: Frames, values: Mapping[str, AnyArray]
    ) -> tuple[Float[Array, "n d"], Float[Array, "n d"]]:
        """Return mean and variance of every entry given all others."""
        return told.entries(self, frames, values)

    def points(self, data: PoseData) -> dict[str, tuple[str, np.ndarray]]:
        """Return the frame and the clip of every point left out."""
        clip = np.asarray(data.clips)[np.asarray(data.frames.clip)]
        return {"frame": ("point", np.arange(len(clip))), "clip": ("point", clip)}

    def sbc_case(self) -> tuple[SBCCase, Frames]:
        """Return a small instance for simulation-based calibration; see `sbc`."""
        return sbc.case(self)

    def cautions(self, training: PoseData, values: Mapping[str, AnyArray]) -> list[str]:
        """Tell of residuals slower than their clips: poses that synthesis leaves out."""
        if isinstance(self.residual, White):
            return []
        frames = np.bincount(np.asarray(training.frames.clip))
        own = self.per_clip
        late = np.asarray(values["residual_time"]) > (frames if own else frames.max())
        late &= np.asarray(values["residual_variance"]) > SLIGHT
        whose = ", ".join(np.asarray(training.clips)[late]) if own else "the clips"
        told = (
            f"the residuals of {whose} change more slowly than the clips are long: they hold "
            "poses that the factors do not explain, and synthesis leaves them out"
        )
        return [told] if late.any() else []

    def moved_by(self) -> tuple[Factor, ...]:
        """Return the factors, of a model with content on a circle; see `styles`."""
        return of_styles.moved_by(self)

    def step_map(
        self, frames: Frames, values: Mapping[str, AnyArray]
    ) -> Float[np.ndarray, "s ..."]:
        """Return the map from style vectors to the step of each draw; see `styles`."""
        return of_styles.step_map(self, frames, values)

    def features_of_styles(
        self,
        frames: Frames,
        values: Mapping[str, AnyArray],
        styles: Mapping[str, AnyArray],
        phase: Float[np.ndarray, " n"],
        keys: Key[Array, " s"],
        samples: int,
    ) -> tuple[Float[Array, "s n d"], Float[Array, "s n d"], Float[Array, "s j n d"]]:
        """Return mean, variance and samples of features along a path of styles; see `styles`."""
        return of_styles.features_of_styles(self, frames, values, styles, phase, keys, samples)

    def novelty(
        self, trained: Trained, frames: Frames, values: Mapping[str, AnyArray]
    ) -> list[str]:
        """Return where a new clip's pace and style are unlike those of training; see `novelty`."""
        return novelty(self, trained, frames, values)

    def follower(
        self,
        training: PoseData,
        values: Mapping[str, Array],
        labels: Mapping[str, str],
        window: int,
        horizon: int,
    ) -> ClipFollower:
        """Return a new clip before its first frame, of a model on the circle; see `follower`."""
        return ClipFollower(self, training, values, labels, window, horizon)

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of every site."""
        clips = ("all_clips",) if self.one_residual else ("training_clip",)
        names: dict[str, tuple[str, ...]] = {
            "y": ("frame", "feature"),
            "gamma": (),
            "beta": (),
            "scale": ("feature",),
            "residual_variance": clips,
            "residual_time": clips,
            "phase": ("training_clip",),
            "phase_point": ("moving_clip", "plane"),
            "step": ("training_clip",),
            "alpha": ("alpha_part",),
            "x": ("frame", "latent"),
        }
        styles = {
            f"style_{f.name}": (f"level_{f.name}", f"axis_{f.name}") for f in self.style_factors
        }
        shapes = {f"shape_{f.name}": (f"entry_{f.name}",) for f in self.style_factors}
        return names | styles | shapes | told.dims_of(self.style_factors)

    def coords(self, data: Any) -> dict[str, list]:
        """Give the labels of every dimension for the training clips."""
        frames: Frames = data.frames
        out: dict[str, list] = {
            "feature": list(data.encoding.layout.labels),
            "training_clip": list(data.clips),
            "all_clips": ["all"],
            "moving_clip": list(data.clips[1:]),
            "plane": ["cos", "sin"],
            "frame": list(range(len(frames.clip))),
            **told.coords_of(frames),
        }
        if not self.on_circle:
            out |= {"alpha_part": ALPHA_PARTS[self.path.order]}
            out |= {"latent": list(range(self.path.size))}
        for factor, count in zip(self.style_factors, frames.levels, strict=True):
            known = data.levels[factor.name]
            unknown = [f"unknown {i + 1}" for i in range(count - len(known))]
            out |= {f"{kind}_{factor.name}": [*known, *unknown] for kind in ("level", "other")}
            out |= {f"axis_{factor.name}": list(range(factor.size))}
            out |= {f"entry_{factor.name}": entry_names(count, factor.size)}
        return out
