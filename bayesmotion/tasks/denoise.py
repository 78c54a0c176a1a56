"""Take noise out of motions: of a recording as it is, or of a gait cycle by a fit of one."""

from collections.abc import Sequence
from typing import overload

import xarray as xr

from ..errors import InputError
from ..fit import Fit
from ..inference.predicting import DRAWS
from .reconstruct import Reconstruction, denoise_cycle
from .recording import Denoised, denoise_recording


@overload
def denoise(
    recording: xr.Dataset, *, noise_degrees: float | None = None, root_noise: float | None = 0.0
) -> Denoised: ...


@overload
def denoise(
    recording: Fit,
    clip: xr.Dataset,
    missing: Sequence[str] = (),
    *,
    noise: float | None = None,
    cycle: int = 1,
    draws: int = DRAWS,
) -> Reconstruction: ...


def denoise(
    recording: xr.Dataset | Fit,
    clip: xr.Dataset | None = None,
    missing: Sequence[str] = (),
    *,
    noise_degrees: float | None = None,
    root_noise: float | None = 0.0,
    noise: float | None = None,
    cycle: int = 1,
    draws: int = DRAWS,
) -> Denoised | Reconstruction:
    """Return a recording without its noise; what is missing (NaN) of it is filled in.

    ``bm.denoise(recording)`` needs no fit and gives the recording back: its frames, rate and
    skeleton, by Gaussian processes in time (`gp.series`). ``bm.denoise(fit, clip)`` with a fit of
    a gait-pose model gives a gait cycle on the body that all cycles are put on.

    Parameters
    ----------
    recording
        Motion of one clip with joint angles, NaN where they are missing; or a fit, and then
        a clip.
    clip
        Of which a gait cycle is taken, by a fit.
    missing
        By a fit: limbs or joints that are missing beside, as of `reconstruct`.
    noise_degrees
        Standard deviation of the noise of the recording's angles, in degrees; None where it is
        not known, and estimated. With 0 nothing but gaps is filled in.
    root_noise
        That of the path of the root, in the skeleton's length unit; None to have it estimated.
        By default its path stays as it was recorded, and its gaps are filled in.
    noise
        By a fit: standard deviation of the noise in that of each feature along the cycle; None
        where it is not known, and estimated.
    cycle, draws
        By a fit: as of `reconstruct`.

    Returns
    -------
    `Denoised` of a recording, `Reconstruction` of a gait cycle; both have the ``motion``, and
    uncertainty (``to_dataset``).

    Raises
    ------
    InputError
        If there are several clips, or too few frames, a noise is below zero, or an option says
        nothing there; by a fit, as `reconstruct`.

    Warns
    -----
    MotionWarning
        Of what is not to be believed of the result.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> walk = bm.split(bm.synthetic_walkers(("ann",), ("walk",), seconds=1.0))["ann-walk"]
    >>> clean = bm.denoise(walk, noise_degrees=1.0)
    >>> clean.motion.sizes["frame"] == walk.sizes["frame"]
    True
    """
    if isinstance(recording, Fit):
        if clip is None:
            raise InputError("denoise", "there is a fit and no clip", "Give denoise(fit, clip)")
        _say_nothing("by a fit", noise_degrees=noise_degrees, root_noise=root_noise or None)
        return denoise_cycle(recording, clip, missing, noise=noise, cycle=cycle, draws=draws)
    _say_nothing("without a fit", clip=clip, missing=missing or None, noise=noise)
    return denoise_recording(recording, noise_degrees, root_noise)


def _say_nothing(where: str, **options: object) -> None:
    for name, value in options.items():
        if value is not None:
            raise InputError(f"denoise, {name}", f"it says nothing {where}", "Leave it out")
