"""What a task says of a motion as a table: mean, sd and quantiles by time and channel.

Channels are the model's features in their own units, and the anatomical angles of the body
(`motion.anatomy`) in degrees, where it has limbs that are known by their names. These are
no linear functions of the features: their distribution is that of poses drawn frame by frame.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ..errors import InputError
from ..inference.predicting import Prediction
from ..model import LengthData
from ..motion.anatomy import anatomical_angles, limbs_of
from ..motion.dataset import clips, skeleton_of
from ..motion.kinematics import poses
from ..motion.skeleton import Skeleton
from ..prediction import BernoulliMixture, Mixture

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
POSES = 100
LENGTHS = {1.0: "m", 0.01: "cm", 0.001: "mm"}
Series = Float[np.ndarray, "n d"]


class OfMixture:
    """What is told by a mixture of normals of every entry (N, D), in the units of recordings."""

    mixture: Mixture

    @property
    def mean(self) -> Float[np.ndarray, "n d"]:
        """Mean of every entry."""
        return self.mixture.means()

    @property
    def sd(self) -> Float[np.ndarray, "n d"]:
        """Standard deviation of every entry, that of the components' means included."""
        return self.mixture.sds()


@dataclass(frozen=True)
class Channels:
    """How features are told of: in which units, and of which motion.

    labels, units
        (D,) of the features.
    to_motion
        Makes a Motion of features (N, D), as the model has them.
    location, scale
        (D,) which bring features to these units.
    """

    labels: Sequence[str]
    units: Sequence[str]
    to_motion: Callable[[Series], xr.Dataset]
    location: Float[np.ndarray, " d"] | float = 0.0
    scale: Float[np.ndarray, " d"] | float = 1.0

    def table(
        self, mixture: Mixture, motion: xr.Dataset, name: str, attrs: Mapping[str, Any],
        *, given: tuple[Series, Bool[np.ndarray, "n d"]] | None = None,
        frames: slice = slice(None),
    ) -> xr.Dataset:  # fmt: skip
        """Return the table of features and anatomical angles.

        Parameters
        ----------
        mixture
            Of all features (N, D), as the model has them.
        motion
            The clip, of which times are those of the frames.
        name
            What the clip is called.
        attrs
            How it was made.
        given
            Features (N, D) and which of them were given.
        frames
            Of which frames.
        """
        location, scale = (np.broadcast_to(a, mixture.mean.shape[2:])
                           for a in (self.location, self.scale))  # fmt: skip
        table = table_of(
            mixture.part(frames, slice(None)).rescaled(location, scale), self.labels, self.units,
            clip=name, times=times_of(motion)[frames], attrs=attrs,
        )  # fmt: skip
        if given is not None:
            values, seen = (a[frames] for a in given)
            table = with_given(table, location + scale * values, seen)
        return with_anatomy(table, anatomy_of(mixture, self.to_motion, frames=frames))


def channels_of(prediction: Prediction, skeleton: Skeleton) -> Channels:
    """Return those of a prediction of motions."""
    ((name, observed),) = prediction.data.observed().data_vars.items()
    labels = [str(label) for label in observed[observed.dims[1]].values]

    def to_motion(features: Series) -> xr.Dataset:
        return prediction.motion({str(name): features})

    data = prediction.data
    scale = data.in_units_of(skeleton) if isinstance(data, LengthData) else 1.0
    return Channels(labels, units_of(labels, skeleton), to_motion, scale=scale)


def table_of(
    mixture: Mixture | BernoulliMixture,
    channels: Sequence[str],
    units: Sequence[str],
    *,
    clip: str,
    times: Float[np.ndarray, " n"],
    attrs: Mapping[str, Any],
) -> xr.Dataset:
    """Return ``mean``, ``sd`` (frame, channel) and ``quantiles`` (quantile, frame, channel)."""
    each = np.stack([mixture.quantile(p) for p in QUANTILES])
    return table_from(mixture.means(), mixture.sds(), each, channels, units, clip, times, attrs)


def with_given(table: xr.Dataset, values: Series, given: Bool[np.ndarray, "n d"]) -> xr.Dataset:
    """Return a table whose given entries are what they are; ``given`` says which."""
    known = xr.DataArray(given, dims=("frame", "channel"))
    seen = xr.DataArray(values, dims=("frame", "channel"))
    out = {
        name: xr.where(known, 0.0 if name == "sd" else seen, table[name]).transpose(*array.dims)
        for name, array in table.data_vars.items()
    }
    return table.assign(out).assign({"given": known})


def anatomy_of(
    mixture: Mixture,
    made: Callable[[Series], xr.Dataset],
    *,
    frames: slice = slice(None),
    count: int = POSES,
    seed: int = 0,
) -> dict[str, Float[np.ndarray, "s n"]]:
    """Return anatomical angles in degrees of poses drawn frame by frame, by name.

    Parameters
    ----------
    mixture
        Of the features.
    made
        Makes a Motion of features (N, D).
    frames
        Of which frames.
    count
        Poses drawn of every frame, S.
    seed
        Of the draws.

    Returns
    -------
    Nothing where the body has no limbs that are known by their names.
    """
    drawn = [made(features) for features in features_drawn(mixture, count, seed)]
    skeleton = skeleton_of(drawn[0])
    if not limbs_of(skeleton):
        return {}
    angles = np.concatenate([_angles(skeleton, one.isel(frame=frames)) for one in drawn])
    where, _ = poses(skeleton, angles, np.zeros((len(angles), 3)))
    found = anatomical_angles(skeleton, np.asarray(where))
    return {name: value.reshape(count, -1) for name, value in found.items()}


def features_drawn(
    mixture: Mixture, count: int = POSES, seed: int = 0
) -> Float[np.ndarray, "s n d"]:
    """Return features drawn entry by entry, those of one draw from one component."""
    random = np.random.default_rng(seed)
    chosen = random.choice(len(mixture.weight), count, p=mixture.weight)
    white = random.normal(size=(count, *mixture.mean.shape[1:]))
    return mixture.mean[chosen] + mixture.sd[chosen] * white


def anatomy_of_motion(motion: xr.Dataset) -> dict[str, Float[np.ndarray, " n"]]:
    """Return the anatomical angles of one clip in degrees; nothing where no limb is known."""
    skeleton = skeleton_of(motion)
    if not limbs_of(skeleton):
        return {}
    angles = _angles(skeleton, motion)
    where, _ = poses(skeleton, angles, np.zeros((len(angles), 3)))
    return anatomical_angles(skeleton, np.asarray(where))


def with_anatomy(table: xr.Dataset, angles: Mapping[str, Float[np.ndarray, "s n"]]) -> xr.Dataset:
    """Return a table with further channels, of angles (S, N) drawn of every frame, in degrees."""
    if not angles:
        return table
    drawn = np.stack(list(angles.values()), axis=-1)
    further = table_from(
        drawn.mean(axis=0), drawn.std(axis=0), np.quantile(drawn, QUANTILES, axis=0),
        list(angles), ["degrees"] * len(angles), str(table["clip"].values[0]),
        table["time"].values, {},
    )  # fmt: skip
    if "given" in table:
        further["given"] = (further["sd"].dims, further["sd"].values < 1e-9)
    both = joined([table, further], "channel")
    return both.transpose("quantile", "frame", "channel", missing_dims="ignore")


def joined(tables: Sequence[xr.Dataset], dim: str = "frame") -> xr.Dataset:
    """Return tables one after the other: of several clips, or of further channels.

    What a table does not have is NaN there; attributes are those that all have.
    """
    return xr.concat(
        list(tables), dim, data_vars="minimal", coords="minimal", compat="override", join="outer",
        combine_attrs="drop_conflicts" if dim == "frame" else "override",
    )  # fmt: skip


def times_of(motion: xr.Dataset) -> Float[np.ndarray, " n"]:
    """Return the seconds of a clip's frames."""
    return np.arange(motion.sizes["frame"]) / float(motion.attrs["frame_rate"])


def units_of(labels: Sequence[str], skeleton: Skeleton) -> list[str]:
    """Return the units of features by their labels: angles, velocities of these, and travel."""
    metres = skeleton.metres
    length = "length unit" if metres is None else LENGTHS.get(metres, f"{metres:.4g} m")
    return [
        f"{length}/frame" if label.startswith("travel/")
        else "rad/frame" if label.endswith("/velocity")
        else "rad"
        for label in labels
    ]  # fmt: skip


def chosen_angles(names: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Return the angles whose names have all the words of one that is wanted.

    Raises
    ------
    InputError
        If there is none.
    """
    out: list[str] = []
    for text in wanted:
        words = text.replace("_", " ").replace("-", " ").casefold().split()
        found = [name for name in names if set(words) <= set(name.split())]
        if not found:
            raise InputError(
                f"joint {text!r}", "there is no such angle",
                f"Use words of these: {', '.join(names)}",
            )  # fmt: skip
        out += [name for name in found if name not in out]
    return out


def chosen_samples(prediction: Prediction, count: int, seed: int) -> list[Series]:
    """Return joint draws of the one site, at most so many, chosen by their weights."""
    ((_, samples),) = prediction.samples.items()
    weight = prediction.sample_weight
    count = min(count, len(weight))
    chosen = np.random.default_rng(seed).choice(len(weight), count, replace=False, p=weight)
    return [samples[one] for one in chosen]


def made_by(prediction: Prediction) -> dict[str, Any]:
    """Return how a prediction was made, as attributes of a table."""
    return {"draws": prediction.draws, "of": prediction.of, "inference": prediction.inference}


def one_clip(motion: xr.Dataset) -> str:
    """Return the name of the clip of a Motion."""
    return clips(motion)[0]


def _angles(skeleton: Skeleton, motion: xr.Dataset) -> np.ndarray:
    return motion["angle"].sel(dof=list(skeleton.dofs)).values


def table_from(
    mean: Series, sd: Series, each: np.ndarray, channels: Sequence[str], units: Sequence[str],
    clip: str, times: np.ndarray, attrs: Mapping[str, Any],
) -> xr.Dataset:  # fmt: skip
    """Return the table of these values; quantiles (quantile, frame, channel) are `QUANTILES`."""
    dims = ("frame", "channel")
    return xr.Dataset(
        {"mean": (dims, mean), "sd": (dims, sd), "quantiles": (("quantile", *dims), each)},
        {
            "quantile": list(QUANTILES),
            "channel": list(channels),
            "unit": ("channel", list(units)),
            "time": ("frame", times),
            "clip": ("frame", np.full(len(times), clip)),
        },
        dict(attrs),
    )
