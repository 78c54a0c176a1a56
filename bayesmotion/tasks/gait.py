"""Interpolate, reconstruct and filter gait cycles, and walk along the surface.

What is NaN is missing, in every task. All go by eq. 15 (`latent`), with a trained
gait-pose model and what is known of how new people differ from it (`deviation`):

    interpolate   the model's own poses nearest to a whole cycle: its means at x
    reconstruct   joints that are missing, from the others
    denoise       a cycle measured with noise of a known or unknown level
    along         the poses at a path on the surface, measured by nobody
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import AnyArray
from ..models.gait_cycles import CycleEncoding, GaitTraining
from ..models.latent_gp import LatentGP
from ..priors.topology import Surface
from .deviation import WithoutOne, learn_deviation, without_each
from .latent import Candidates, Measured, Represented, candidates_of, measured, represent
from .pose_posterior import Deviation, Pose, pose_at_best_level, pose_given

# Names for the joints that are missing together.
LIMBS: dict[str, tuple[str, ...]] = {
    "larm": ("lhumerus", "lradius", "lwrist"),
    "rarm": ("rhumerus", "rradius", "rwrist"),
    "lleg": ("lfemur", "ltibia", "lfoot"),
    "rleg": ("rfemur", "rtibia", "rfoot"),
}
# Standard deviations of noise that are tried where it is not known, in those of the motion.
LEVELS = (0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3)
GROUP = "deviation"


@dataclass(frozen=True)
class Trained:
    """A trained gait-pose model, ready for new people.

    fit
        The model, its training data and its sites.
    deviation
        What new people have of their own, where all features are seen.
    candidates
        Where searches begin.
    """

    fit: Fit
    deviation: Deviation
    candidates: Candidates
    _without: dict[tuple[int, ...], Deviation] = field(default_factory=dict)

    @property
    def training(self) -> GaitTraining:
        """The training data."""
        return self.fit.training

    @property
    def process(self) -> LatentGP:
        """The process conditioned on them."""
        return self.fit.trained

    @cached_property
    def others(self) -> WithoutOne:
        """The process without each of the training people."""
        return without_each(self.fit.model, self.training, self.fit.values())

    def deviation_without(self, columns: Sequence[int]) -> Deviation:
        """What new people have of their own, of whom these features are missing.

        It is learned when it is first asked for: training people are left out, and looked for
        without them.
        """
        missing = tuple(sorted(set(columns)))
        if not missing:
            return self.deviation
        if missing not in self._without:
            left = self.others.left_over(missing)
            self._without[missing] = learn_deviation(left)
        return self._without[missing]

    def represent(self, given: Measured) -> Represented:
        """Find the latent path of a cycle.

        Paths are found as they were for the people left out, with one variance for all
        features: what is nearest in millimetres.
        """
        poses, d = given.u.shape
        white = np.full(d, np.mean(self.deviation.white(poses)))
        return represent(self.process, given, white, candidates=self.candidates)


def with_deviation(fit: Fit) -> Fit:
    """Give the fit with what new people have of their own, learned and kept in its tree."""
    kept = fit.tree[GROUP].data_vars if GROUP in fit.tree.children else ()
    if set(Deviation._fields) <= set(kept):
        return fit
    left = without_each(fit.model, fit.training, fit.values()).left_over()
    deviation = learn_deviation(left)
    tree = fit.tree.copy()
    tree[GROUP] = xr.DataTree(
        xr.Dataset(
            {
                "power": (("turns", "feature"), np.asarray(deviation.power)),
                "alike": (("kind", "feature", "feature_bis"), np.asarray(deviation.alike)),
                "spread": ("kind", np.asarray(deviation.spread)),
                "usual": float(deviation.usual),
            }
        )
    )
    return Fit(fit.model, fit.motion, tree)


def trained_of(fit: Fit) -> Trained:
    """Make a fit ready for new people; what it does not know of them yet is learned."""
    fit = with_deviation(fit)
    group = fit.tree[GROUP].to_dataset()
    deviation = Deviation(*(group[name].values for name in Deviation._fields))
    return Trained(fit, deviation, candidates_of(fit.trained))


def interpolate(trained: Trained, u: Float[np.ndarray, "t d"]) -> Pose:
    """Represent a whole cycle by the model: its mean at the best latent path.

    Its standard deviation says how far a new person's poses are from that.
    """
    found = trained.represent(measured(u))
    nothing = measured(u, np.zeros(u.shape, bool))
    return pose_given(found, nothing, trained.deviation)


def reconstruct(
    trained: Trained,
    u: Float[np.ndarray, "t d"],
) -> Pose:
    """Fill in features that were not measured.

    Parameters
    ----------
    u
        (T, D) features, NaN where missing: all through the cycle (`hidden`), or in some poses.
    """
    given = measured(u)
    return pose_given(trained.represent(given), given, trained.deviation_without(missing_in(u)))


def hidden(u: Float[np.ndarray, "t d"], columns: Sequence[int]) -> Float[np.ndarray, "t d"]:
    """Return a cycle of which some features are missing (NaN) all through."""
    out = np.array(u, float)
    out[:, list(columns)] = np.nan
    return out


def missing_in(u: Float[np.ndarray, "t d"]) -> list[int]:
    """Return the features that are missing (NaN) all through a cycle."""
    return np.flatnonzero(np.isnan(u).all(axis=0)).tolist()


def without(u: Float[np.ndarray, "t d"], columns: Sequence[int]) -> Measured:
    """What is measured of a cycle without some features."""
    return measured(hidden(u, columns))


def held_out_density(
    trained: Trained, u: Float[np.ndarray, "t d"], columns: Sequence[int]
) -> float:
    """Log density of the features in `columns` given the others, both at the others' path."""
    part, whole = without(u, columns), measured(u)
    found, deviation = trained.represent(part), trained.deviation_without(columns)
    both = pose_given(found, whole, deviation).log_density
    return both - pose_given(found, part, deviation).log_density


def denoise(
    trained: Trained, u: Float[np.ndarray, "t d"], level: float | None = None
) -> tuple[Pose, float]:
    """Take the noise out of a cycle.

    Parameters
    ----------
    u
        Features measured with noise, NaN where missing; these are filled in.
    level
        Standard deviation of the noise, in that of each feature within the cycle; where None,
        that of `LEVELS` under which the measured values are likeliest.

    Returns
    -------
    The poses, and the level.
    """
    tried = LEVELS if level is None else (level,)
    guess = float(np.median(tried))
    # One path serves all levels: beside a person's own deviation such noise is small.
    given = measured(u, noise=_share(guess) * _sd_along(u))
    found = trained.represent(given)
    ratios = [1.0] if level is not None else [_share(one) / _share(guess) for one in tried]
    deviation = trained.deviation_without(missing_in(u))
    pose, best = pose_at_best_level(found, given, deviation, ratios)
    return pose, tried[best]


def _sd_along(u: Float[np.ndarray, "t d"]) -> Float[np.ndarray, " d"]:
    """Standard deviation of each feature along a cycle, zero where all of it is missing."""
    seen = np.isfinite(u)
    count = np.maximum(seen.sum(axis=0), 1)
    off = np.where(seen, u, 0.0)
    off = np.where(seen, off - off.sum(axis=0) / count, 0.0)
    return np.sqrt(np.sum(off**2, axis=0) / count)


def _share(level: float) -> float:
    """Standard deviation of noise in that of motion and noise together."""
    return level / float(np.sqrt(1.0 + level**2))


def along(
    trained: Trained,
    pose: AnyArray,
    gait: AnyArray,
    radius: AnyArray,
) -> tuple[Float[np.ndarray, "n d"], Float[np.ndarray, " n"]]:
    """Poses at a path on the ideal surface, moved as the training points about it were.

    Learned points are not where the ideal ones are; what the nearest of them moved by, weighted by
    their nearness, the path is moved by too.

    Parameters
    ----------
    pose, gait, radius
        (N,) places on the surface, which need not be whole numbers.

    Returns
    -------
    Mean features (N, D), and the variance of the process (N,).

    Raises
    ------
    InputError
        If the model's gaits have no places on a surface.
    """
    surface = _ordered_surface(trained)
    at, ideal = surface.at(pose, gait, radius), surface.points()
    square = np.sum((at[:, None] - ideal[None]) ** 2, axis=-1)
    near = np.exp(-0.5 * square / (0.5 * surface.spacing) ** 2 + 0.5 * square.min(axis=1)[:, None])
    near /= near.sum(axis=1, keepdims=True)
    x = at + near @ (np.asarray(trained.process.x) - ideal)
    mean, variance = trained.process.predict(x)
    return np.asarray(mean), np.asarray(variance[:, 0])


def paths(
    trained: Trained, poses: int = 30, turns: float = 2.0
) -> dict[str, dict[str, np.ndarray]]:
    """The three paths of Figure 14: a straight line outwards, an inner and an outer spiral.

    Parameters
    ----------
    poses
        Of a cycle.
    turns
        Cycles a spiral takes from the first gait to the last; the line takes as long.

    Raises
    ------
    InputError
        If the model's gaits have no places on a surface.
    """
    surface = _ordered_surface(trained)
    inner, outer = 0.9 * surface.radii[0], 1.05 * surface.radii[-1]
    n = max(round(turns * poses), 2)
    phase = np.arange(n) * surface.poses / poses
    gait = np.linspace(0.0, surface.gaits - 1.0, n)
    still = np.zeros(n)
    return {
        "line": {"pose": still, "gait": still, "radius": np.linspace(inner, outer, n)},
        "inner spiral": {"pose": phase, "gait": gait, "radius": np.full(n, inner)},
        "outer spiral": {"pose": phase, "gait": gait, "radius": np.full(n, outer)},
    }


def _ordered_surface(trained: Trained) -> Surface:
    """Give the surface of a model whose gaits have places on it."""
    surface = trained.training.surface
    if surface is None or surface.kind == "circle":
        raise InputError(
            "path", "the model's gaits have no places on a surface", "Use a torus or a cylinder"
        )
    return surface


def joints_named(encoding: CycleEncoding, names: Sequence[str]) -> list[str]:
    """Return the joints of limbs (`LIMBS`) or joints by name.

    Raises
    ------
    InputError
        If a name is neither.
    """
    joints = [joint for name in names for joint in LIMBS.get(name, (name,))]
    encoding.columns(joints)  # refuses those that do not turn
    return joints


def limb_columns(trained: Trained, names: Sequence[str]) -> list[int]:
    """Give the features of limbs (`LIMBS`) or joints by name.

    Raises
    ------
    InputError
        If a name is neither.
    """
    encoding = trained.training.encoding
    return encoding.columns(joints_named(encoding, names))


def moved_joints(columns: Sequence[int]) -> list[int]:
    """Which of `CycleEncoding.positions`' 17 joints move when these features change.

    A joint's rotation moves what hangs on it, not the joint itself.
    """
    from ..motion.gait_skeleton import gait_skeleton, turning_joints

    skeleton = gait_skeleton()
    turning = turning_joints(skeleton)
    missing = {skeleton.index(turning[column // 3]) for column in columns}
    moved = []
    for number, name in enumerate(turning[1:]):
        above = skeleton.joints[skeleton.index(name)].parent
        while above not in missing and above != -1:
            above = skeleton.joints[above].parent
        if above in missing:
            moved.append(number)
    return moved
