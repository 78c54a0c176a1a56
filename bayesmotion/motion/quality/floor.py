"""Where the root goes when the feet are to stay on the floor.

Over one cycle of the gait phase, the contact points of the feet (heel, ball, toes)
are known relative to the root. The root's height, forward speed and sideways sway
are fitted as short Fourier series so that the points that carry the body lie on
the floor and stand still, as well as smooth curves allow.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..kinematics import poses
from ..skeleton import Joint, Skeleton
from ..synthetic.anthropometry import ANKLE, HEEL, LEG

_POINTS = ("heel", "toes", "toes_end")
_SAMPLES = 240
_SOFTNESS = 0.004  # of stature: points this close to the lowest one share the load


@dataclass(frozen=True)
class RootPath:
    """The root's path as a function of the gait phase, in metres.

    Parameters
    ----------
    advance
        Metres forwards a radian of phase, on average.
    forth, sway, height
        Coefficients (term,) of `_waves`: what is added to the steady advance, the
        sideways position and the height.
    """

    advance: float
    forth: Float[np.ndarray, " term"]
    sway: Float[np.ndarray, " term"]
    height: Float[np.ndarray, " term"]

    def __call__(self, phase: Float[np.ndarray, " frame"]) -> Float[np.ndarray, "frame 3"]:
        """Give the root's position at each phase (radians, not wrapped)."""
        waves = _waves(phase)
        forwards = self.advance * phase + waves @ self.forth
        return np.stack([waves @ self.sway, waves @ self.height, forwards], axis=-1)


def contact_points(
    skeleton: Skeleton,
    angle: Float[np.ndarray, "frame dof"],
    root_position: Float[np.ndarray, "frame 3"],
    stature: float,
) -> Float[np.ndarray, "frame side point 3"]:
    """Give heel, ball and tip of the toes of the left and the right foot, in metres.

    Parameters
    ----------
    skeleton
        A skeleton of `adult_skeleton`.
    angle, root_position
        Angles in radians, in the order of `skeleton.dofs`, and positions in metres.
    stature
        Height of the body in metres.
    """
    legs = _legs(skeleton, stature)
    columns = [skeleton.dofs.index(dof) for dof in legs.dofs]
    position, _ = poses(legs, angle[:, columns], root_position)
    places = [[legs.index(side + point) for point in _POINTS] for side in "lr"]
    return position[:, places]


def root_path(
    skeleton: Skeleton,
    pose: Callable[[Float[np.ndarray, " frame"]], Float[np.ndarray, "frame dof"]],
    duty: float,
    stature: float,
) -> RootPath:
    """Fit the root's path to a cyclic gait.

    Parameters
    ----------
    skeleton
        A skeleton of `adult_skeleton`.
    pose
        Angles (frame, dof) in radians as a function of the gait phase.
    duty
        Fraction of the cycle during which a foot is down, from its heel strike on.
    stature
        Height of the body in metres.
    """
    phase = np.arange(_SAMPLES) * 2 * np.pi / _SAMPLES
    points = contact_points(skeleton, pose(phase), np.zeros((_SAMPLES, 3)), stature)
    load = _load(points[..., 1], phase, duty, _SOFTNESS * stature)
    speed = -_derivative(points)
    weight = load.reshape(_SAMPLES, -1)
    fit = {
        axis: speed[..., column].reshape(_SAMPLES, -1) for axis, column in (("sway", 0), ("z", 2))
    }
    slopes = _wave_slopes(phase)
    even, odd = [3, 4], [1, 2]
    along = _fit(np.column_stack([np.ones(_SAMPLES), slopes[:, even]]), fit["z"], weight)
    across = _fit(slopes[:, odd], fit["sway"], weight)
    # The root is as high as the loaded points are below it.
    below = -points[..., 1].reshape(_SAMPLES, -1)
    rise = _fit(_waves(phase)[:, [0, *even]], below, weight)
    forth, sway, height = np.zeros((3, 5))
    forth[even], sway[odd], height[[0, *even]] = along[1:], across, rise
    return RootPath(float(along[0]), forth, sway, height)


def _legs(skeleton: Skeleton, stature: float) -> Skeleton:
    """Cut a skeleton down to its legs, and add the heels it has no joints for."""
    parts = ("root", *(side + bone[0] for side in "lr" for bone in LEG))
    joints = [skeleton.joints[skeleton.index(part)] for part in parts]
    joints = [
        replace(joint, parent=parts.index(skeleton.names[joint.parent]) if at else -1)
        for at, joint in enumerate(joints)
    ]
    heel = (0.0, -ANKLE * stature, -HEEL * stature)
    heels = [Joint(f"{side}heel", parts.index(f"{side}foot"), heel) for side in "lr"]
    return Skeleton(skeleton.name, (*joints, *heels), skeleton.metres)


def _load(
    height: Float[np.ndarray, "frame side point"],
    phase: Float[np.ndarray, " frame"],
    duty: float,
    softness: float,
) -> Float[np.ndarray, "frame side point"]:
    """Say how much of the body each point carries: the lowest of a foot that is down."""
    share = np.exp(-(height - height.min(-1, keepdims=True)) / softness)
    share /= share.sum(-1, keepdims=True)
    since_strike = np.stack([phase, phase + np.pi], axis=-1) % (2 * np.pi) / (2 * np.pi)
    # Rises and falls smoothly at strike and toe-off, like the force under a foot.
    down = np.where(since_strike < duty, np.sin(np.pi * since_strike / duty) ** 2, 0.0)
    return share * down[..., None]


def _derivative(points: Float[np.ndarray, "frame side point 3"]) -> np.ndarray:
    """Differentiate a function of one cycle with respect to the phase."""
    order = np.fft.rfftfreq(_SAMPLES, 1 / _SAMPLES)
    spectrum = np.fft.rfft(points, axis=0) * (1j * order)[:, None, None, None]
    return np.fft.irfft(spectrum, n=_SAMPLES, axis=0)


def _fit(
    design: Float[np.ndarray, "frame term"],
    target: Float[np.ndarray, "frame point"],
    weight: Float[np.ndarray, "frame point"],
) -> Float[np.ndarray, " term"]:
    """Fit one curve to several weighted targets at once by least squares."""
    total = weight.sum(1)
    normal = design.T @ (total[:, None] * design)
    return np.linalg.solve(normal, design.T @ (weight * target).sum(1))


def _waves(phase: Float[np.ndarray, " frame"]) -> Float[np.ndarray, "frame 5"]:
    """Give 1 and the cosines and sines of the first two harmonics."""
    return np.stack(
        [np.ones_like(phase), *(f(k * phase) for k in (1, 2) for f in (np.cos, np.sin))], axis=-1
    )


def _wave_slopes(phase: Float[np.ndarray, " frame"]) -> Float[np.ndarray, "frame 5"]:
    """Give the derivatives of `_waves`."""
    columns = [np.zeros_like(phase)]
    for k in (1, 2):
        columns += [-k * np.sin(k * phase), k * np.cos(k * phase)]
    return np.stack(columns, axis=-1)
