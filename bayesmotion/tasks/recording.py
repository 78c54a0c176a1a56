"""A recording without its noise, by Gaussian processes in time.

Rotations of joints become vectors (`motion.charts`), which are smoothed (`gp.gaps`) and given back
as angles on the turn they were recorded on; so nothing depends on the order of a file's angles. All
that follows from the recording itself is learned from it: no fit is needed, and any skeleton
will do. Angles that never move are taken for what they are, and left alone; those that were
recorded nowhere stay missing.
"""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ..errors import InputError
from ..gp.gaps import smooth_series
from ..motion.charts import Charts
from ..motion.dataset import add_history, require_angles, skeleton_of
from ..motion.features import check_one_clip
from ..motion.filters import unwrapped
from ..prediction import Mixture
from .cautions import warn
from .outcome import Channels, OfMixture, one_clip

SHORTEST = 8
# Angles that move less (radians) are at rest; the sd of what is known, which is not quite zero
# because mixtures divide by it.
REST, KNOWN_SD = 1e-9, 1e-12


@dataclass(frozen=True, repr=False)
class Denoised(OfMixture):
    """A recording without its noise.

    motion
        The recording with the mean of its rotations in the place of its angles; frames, rate,
        skeleton, labels and the names of clips are the recording's.
    given
        The recording.
    mixture
        Angles (N, D) without noise, in radians, of the degrees of freedom `dofs`; unwrapped.
    dofs
        Those of which something was recorded.
    noise_degrees
        Standard deviation of the noise: of the rotation of a joint about each axis.
    estimated
        Whether it was estimated.
    filled
        (N, D) which angles were missing, and are filled in.
    root_sd
        (N, 3) standard deviations of the path of the root, in its length unit.
    messages
        What is not to be believed of it, in sentences.
    """

    motion: xr.Dataset
    given: xr.Dataset
    mixture: Mixture
    dofs: tuple[str, ...]
    noise_degrees: float
    estimated: bool
    filled: Bool[np.ndarray, "n d"]
    root_sd: Float[np.ndarray, "n 3"]
    messages: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return what was done, and what is not to be believed of it."""
        how = "estimated" if self.estimated else "given"
        told = (
            f"Denoised {one_clip(self.motion)!r}: {self.motion.sizes['frame']} frames, noise of "
            f"{self.noise_degrees:.3g} degrees ({how}), {int(self.filled.sum())} values filled in"
        )
        return "\n".join([told, *(f"  warning: {text}" for text in self.messages)])

    def interval(
        self, probability: float = 0.9
    ) -> tuple[Float[np.ndarray, "n d"], Float[np.ndarray, "n d"]]:
        """Return the ends of the central intervals of the angles without noise, in radians."""
        tail = 0.5 * (1.0 - probability)
        return self.mixture.quantile(tail), self.mixture.quantile(1.0 - tail)

    @property
    def width90_degrees(self) -> float:
        """Median width of the 90 % intervals of the angles that were seen, in degrees."""
        low, high = self.interval(0.9)
        seen = ~self.filled
        return float(np.rad2deg(np.median((high - low)[seen])))

    def to_dataset(self) -> xr.Dataset:
        """Return every frame with its uncertainty.

        Returns
        -------
        ``mean`` and ``sd`` (frame, channel) and ``quantiles`` (quantile, frame, channel) of the
        angles in radians and of anatomical angles in degrees (`tasks.outcome`); `bm.write`
        writes them as .nc or .csv.
        """
        channels = Channels(self.dofs, ["rad"] * len(self.dofs), self._with)
        attrs = {"noise_degrees": self.noise_degrees}
        return channels.table(self.mixture, self.motion, one_clip(self.motion), attrs)

    def _with(self, angle: Float[np.ndarray, "n d"]) -> xr.Dataset:
        return _with_angles(self.motion, self.dofs, angle)


def denoise_recording(
    recording: xr.Dataset, noise_degrees: float | None = None, root_noise: float | None = 0.0
) -> Denoised:
    """Return a recording without its noise; see `tasks.denoise.denoise`."""
    _check(recording, noise_degrees, root_noise)
    rate = float(recording.attrs["frame_rate"])
    recorded = recording["angle"].values
    known = np.isfinite(recorded).any(axis=0)
    dofs = tuple(str(dof) for dof in recording["dof"].values[known])
    angle = unwrapped(recorded[:, known])
    given = None if noise_degrees is None else float(np.deg2rad(noise_degrees))
    charts = Charts.of(skeleton_of(recording), dofs, angle, rate)
    vectors, noise = _smoothed(charts.vectors(angle), rate, given)
    # The mean of rotations, as that of angles depends on their order.
    mean = _kept(charts.angles(vectors.means(), vectors.sds())[0], angle, given)
    mixture = _of_angles(charts, vectors, angle, given)
    path, path_noise = _smoothed(recording["root_position"].values, rate, root_noise)
    messages = _messages(recording, known)
    warn("the denoised recording", messages, stacklevel=4)
    # On the turn that each angle was recorded on.
    seen = np.isfinite(angle)
    turns = np.where(seen, recorded[:, known] - angle, 0.0)
    motion = _with_angles(recording, dofs, mean + turns)
    motion = motion.assign(root_position=(recording["root_position"].dims, path.means()))
    told = "estimated" if given is None else "given"
    line = (
        f"denoise: noise of {np.rad2deg(noise):.3g} degrees ({told}) taken out of the angles, "
        f"{path_noise:.3g} out of the path; {int((~seen).sum())} angles filled in"
    )
    return Denoised(
        add_history(motion, line), recording, mixture, dofs, float(np.rad2deg(noise)),
        given is None, ~seen, path.sds(), messages,
    )  # fmt: skip


def _smoothed(
    y: Float[np.ndarray, "n d"], rate: float, noise: float | None
) -> tuple[Mixture, float]:
    """Return columns without their noise, and what its sd was; with 0 gaps alone are filled."""
    seen = np.isfinite(y)
    least, most = np.nanmin(y, axis=0), np.nanmax(y, axis=0)
    moves = most - least > REST
    resting = np.where(seen, y, 0.5 * (least + most))
    if not moves.any() or (noise == 0.0 and seen.all()):
        sd = np.full(y.shape, KNOWN_SD)
        return Mixture(resting[None], sd[None], np.ones(1)), noise or 0.0
    found = smooth_series(y[:, moves], rate, noise or None)
    sets = len(found.mean)
    mean = np.repeat(resting[None], sets, axis=0)
    sd = np.full(mean.shape, KNOWN_SD)
    mean[:, :, moves] = found.mean
    sd[:, :, moves] = np.maximum(found.sd, KNOWN_SD)
    if noise == 0.0:
        mean, sd = np.where(seen, resting, mean), np.where(seen, KNOWN_SD, sd)
    used = found.noise_sd if noise is None else noise
    return Mixture(mean, sd, np.full(sets, 1.0 / sets)), used


def _of_angles(
    charts: Charts, mixture: Mixture, angle: Float[np.ndarray, "n d"], noise: float | None
) -> Mixture:
    """Return a mixture of angles; with noise of 0 those that were seen are what they were."""
    each = [charts.angles(mean, sd) for mean, sd in zip(mixture.mean, mixture.sd, strict=True)]
    mean, sd = (np.stack(parts) for parts in zip(*each, strict=True))
    return Mixture(_kept(mean, angle, noise), np.maximum(sd, KNOWN_SD), mixture.weight)


def _kept(
    mean: Float[np.ndarray, "*s n d"], angle: Float[np.ndarray, "n d"], noise: float | None
) -> Float[np.ndarray, "*s n d"]:
    """Return means; with noise of 0 angles that were seen are what they were."""
    return np.where(np.isfinite(angle), angle, mean) if noise == 0.0 else mean


def _with_angles(
    recording: xr.Dataset, dofs: tuple[str, ...], angle: Float[np.ndarray, "n d"]
) -> xr.Dataset:
    values = recording["angle"].copy(deep=True)
    values.loc[{"dof": list(dofs)}] = angle
    return recording.assign(angle=values)


def _messages(recording: xr.Dataset, known: Bool[np.ndarray, " d"]) -> tuple[str, ...]:
    lost = [str(dof).split("/")[0] for dof in recording["dof"].values[~known]]
    if not lost:
        return ()
    names = ", ".join(dict.fromkeys(lost))
    return (
        f"nothing is recorded of {names}, which stays missing; a fit of other recordings can "
        "fill it in (reconstruct)",
    )


def _check(recording: xr.Dataset, noise: float | None, root_noise: float | None) -> None:
    name = check_one_clip(recording)
    require_angles(recording)
    frames = recording.sizes["frame"]
    if frames < SHORTEST:
        raise InputError(
            f"clip {name!r}", f"it has {frames} frames, which tell no noise from motion",
            f"Give at least {SHORTEST}",
        )  # fmt: skip
    for what, value in (("noise_degrees", noise), ("root_noise", root_noise)):
        if value is not None and not (np.isfinite(value) and value >= 0.0):
            raise InputError(f"{what} {value}", "it is no standard deviation", "Give 0 or more")
    if not np.isfinite(recording["root_position"].values).any(axis=0).all():
        raise InputError(
            f"clip {name!r}", "nothing is recorded of the path of the root", "Put it at zero"
        )
    if not np.isfinite(recording["angle"].values).any():
        raise InputError(f"clip {name!r}", "no angle of it is recorded", "Give another clip")
