"""Online: what follows a clip while it is being recorded, frame by frame.

`forecast` searches for a clip's own unknowns and predicts from all of its frames, which takes
seconds and longer with every frame. `Online.update` takes as long for the thousandth frame as for
the tenth: of frames that are gone it keeps what they say in sums of a fixed size
(`gp.followed`), and the unknowns move from frame to frame (`inference.following`). At the same
values of these it predicts what `forecast` does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..catalogue import lacking
from ..errors import InputError
from ..fit import Fit
from ..inference.draws import stacked
from ..inference.following import Tracker
from ..inference.modes import best_draw
from ..inference.predicting import DRAWS, require_model
from ..model import IntegratesUnknowns
from ..motion.features import check_one_clip
from ..motion.joining import split
from ..prediction import Mixture
from ..programs import one_at_a_time
from ..seeds import require_seed
from ..verbs import FollowsClips
from .forecast import check_labels
from .outcome import OfMixture

# Frames that are rehearsed before the first: until one is gone from the window.
REHEARSED = 2


@dataclass(frozen=True, repr=False)
class OnlineForecast(OfMixture):
    """What follows the frames that have come.

    mixture
        Features (H, D) of the next frames in their own units, `mean` and `sd` those of all.
    samples
        (J, H, D) joint draws, alike in weight.
    unknowns
        The clip's own unknowns (J, ...) that each draw is of; phases are of the middle of the
        window.
    values
        Those at the mode of most mass.
    frames
        How many frames have come.
    """

    mixture: Mixture
    samples: Float[np.ndarray, "j h d"]
    unknowns: dict[str, np.ndarray]
    values: dict[str, np.ndarray]
    frames: int
    _follower: Any

    @property
    def motion(self) -> xr.Dataset:
        """The mean as a Motion, going on from where the root is; until the next update."""
        return self.to_motion(self.mean)

    def draws(self, count: int = 10) -> list[xr.Dataset]:
        """Return at most so many of the draws as Motions."""
        return [self.to_motion(one) for one in self.samples[:count]]

    def to_motion(self, features: Float[np.ndarray, "h d"]) -> xr.Dataset:
        """Return features of the next frames as a Motion; until the next update."""
        return self._follower.motion(features, "forecast")

    def __repr__(self) -> str:
        """Return of how many frames, from how many."""
        ahead, count = len(self.mixture.mean[0]), len(self.samples)
        return f"OnlineForecast of {ahead} frames after {self.frames}, {count} draws"


class Online:
    """A clip that is forecast while it is being recorded; made by `online`."""

    def __init__(self, fit: Fit, tracker: Tracker) -> None:
        self._fit, self._tracker = fit, tracker

    @property
    def frames(self) -> int:
        """How many frames have come."""
        return self._tracker.frames

    @one_at_a_time
    def update(self, frame: xr.Dataset) -> OnlineForecast | None:
        """Return the forecast of what follows one more frame.

        Parameters
        ----------
        frame
            Motion of the next frame of the clip, or of several, at the fit's frame rate, as
            ``clip.isel(frame=[i])``; NaN where joints are missing. The feet may stand anywhere:
            the heading is that of the window.

        Returns
        -------
        The forecast after the last of them; None after the very first, of which no velocity
        is known.

        Raises
        ------
        InputError
            If the frame is at another rate, or has not the joints of training.
        """
        if "frame" not in frame.dims or "angle" not in frame or not frame.sizes["frame"]:
            raise InputError(
                "frame",
                "it is no Motion of frames with angles",
                "Give some of a clip, as clip.isel(frame=[0])",
            )
        said = None
        for index in range(frame.sizes["frame"]):
            one = frame if frame.sizes["frame"] == 1 else frame.isel(frame=[index])
            said = self._tracker.add(one)
        if said is None:
            return None
        mean, sd = np.asarray(said.mean), np.asarray(said.sd)
        weight = np.full(len(mean), 1.0 / len(mean))
        return OnlineForecast(
            Mixture(mean, sd, weight),
            np.asarray(said.sample),
            {name: np.asarray(value) for name, value in said.unknowns.items()},
            {name: np.asarray(value) for name, value in said.mode.items()},
            self.frames,
            self._tracker.follower,
        )


@one_at_a_time
def online(
    fit: Fit,
    *,
    labels: Mapping[str, str] | None = None,
    window: float = 1.5,
    horizon: float = 1.0,
    draws: int = DRAWS,
    seed: int = 0,
) -> Online:
    """Return what forecasts a clip while it is being recorded, frame by frame.

    The first call compiles, which takes long; the programs are kept for later processes. Then
    `Online.update` takes as long for any frame.

    The clip's own unknowns (phase, pace, styles, size and time scale of its residual) are kept
    at their modes given all frames: some hypotheses, which begin where training clips looked most
    like the first frames, and each take a step of Newton's method with every frame
    (`inference.following`). Phase and pace are those of the last frames, the window; older
    frames keep the phases they had when they left it, and what they say of poses and styles
    counts on. Draws are taken about these modes.

    Parameters
    ----------
    fit
        A fit of a model whose clips can be followed: Multifactor with content on a circle.
    labels
        What is known of the clip, for example ``{"subject": "02"}``; others are estimated.
    window, horizon
        Seconds.
    draws
        At most so many draws of the fit.
    seed
        Of random parts.

    Raises
    ------
    InputError
        If the model's clips cannot be followed, or a label is not one of training.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> model, walks = bm.example("multifactor")
    >>> fit = bm.fit(model, walks, method=bm.MAP(max_steps=50), seed=0)
    >>> clip = bm.split(walks)["ann-run"]
    >>> following = bm.online(fit)
    >>> for frame in range(5):
    ...     next_second = following.update(clip.isel(frame=[frame]))
    >>> next_second.mean.shape == next_second.samples[0].shape
    True
    """
    require_seed(seed)
    model = require_model(fit)
    if not isinstance(model, FollowsClips):
        raise lacking(model.name, "its clips are not followed frame by frame", FollowsClips)
    check_labels(fit, dict(labels or {}))
    sizes = {"window": window * fit.frame_rate, "horizon": horizon * fit.frame_rate}
    for name, frames in sizes.items():
        if not 2.0 <= frames < np.inf:
            raise InputError(
                f"{name} {frames / fit.frame_rate:g}",
                f"it is {frames:.1f} frames",
                f"Give at least {2.0 / fit.frame_rate:.2g} seconds",
            )
    values, _ = stacked(fit, draws)
    data = fit.training.data
    best = best_draw(model, data, values)
    about = model.unknown_draws if isinstance(model, IntegratesUnknowns) else 0
    counts = [round(frames) for frames in sizes.values()]

    def begun() -> Tracker:
        follower = model.follower(fit.training, values, dict(labels or {}), *counts)
        return Tracker(follower, data[0], values, best, about, seed)

    _rehearse(begun(), fit, counts[0])
    return Online(fit, begun())


def _rehearse(tracker: Tracker, fit: Fit, window: int) -> None:
    """Compile all programs, with frames of a training clip."""
    clip = next(iter(split(fit.motion).values()))
    check_one_clip(clip)
    for index in range(window + REHEARSED):
        tracker.add(clip.isel(frame=[index % clip.sizes["frame"]]))
