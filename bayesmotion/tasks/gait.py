"""Interpolate, reconstruct and filter gait cycles, and walk along the surface.

What is NaN is missing, in every task. All go by eq. 15 (`latent`), with a trained
gait-pose model and what is known of how new people differ from it (`subject_residual`):

    interpolate   the model's own poses nearest to a whole cycle: its means at x
    reconstruct   joints that are missing, from the others
    denoise       a cycle measured with noise of a known or unknown level
    along         the poses at a path on the surface, measured by nobody

Each is done for every draw of the fit (a hundred of them at most), and returns the mixture
of what they say, which count alike. A point estimate is one draw.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float
from scipy.special import logsumexp

from ..catalogue import lacking
from ..distributions.topology import Surface
from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import AnyArray
from ..inference.draws import stacked
from ..inference.predicting import require_model
from ..model import Model
from ..models.gait_pose.data import Cycles
from ..models.gait_pose.encoding import CycleEncoding
from ..models.gait_pose.prediction import LatentGP
from ..motion.gait_skeleton import gait_skeleton, turning_joints
from ..prediction import Mixture
from ..verbs import ConditionsOnCycles
from .latent import (
    KnownPaths,
    LatentPath,
    Measured,
    TrainingCycles,
    infer_path,
    known_paths,
    measured,
)
from .pose_posterior import Pose, SubjectResidual, level_log_densities, pose_given
from .subject_residual import LeaveOneOut, learn_subject_residual, leave_one_out

DRAWS = 100
# Draws for which people are left out: how far new ones are off hardly differs between draws.
RESIDUAL_DRAWS = 10
# Names for the joints that are missing together.
LIMBS: dict[str, tuple[str, ...]] = {
    "larm": ("lhumerus", "lradius", "lwrist"),
    "rarm": ("rhumerus", "rradius", "rwrist"),
    "lleg": ("lfemur", "ltibia", "lfoot"),
    "rleg": ("rfemur", "rtibia", "rfoot"),
}
# Standard deviations of noise that are tried where it is not known, in those of the motion.
LEVELS = (0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3)
GROUP = "subject_residual"


@dataclass(frozen=True)
class TrainedDraw:
    """One draw of a trained gait-pose model.

    process
        Conditioned on the training cycles.
    known
        Where searches for latent paths begin.
    """

    process: LatentGP
    known: KnownPaths


@dataclass(frozen=True)
class Trained:
    """A trained gait-pose model, ready for new people.

    fit
        The model, its training data and its sites.
    training
        The training data.
    draws
        Its draws, or some of them.
    residual
        What new people have of their own, where all features are seen.
    """

    fit: Fit
    training: TrainingCycles
    draws: tuple[TrainedDraw, ...]
    residual: SubjectResidual
    _without: dict[tuple[int, ...], SubjectResidual] = field(default_factory=dict)

    @cached_property
    def others(self) -> LeaveOneOut:
        """The process without each of the training people."""
        return _leave_one_out(self.fit)

    def residual_without(self, columns: Sequence[int]) -> SubjectResidual:
        """Return what new people have of their own, of whom these features are missing.

        It is learned when it is first asked for: training people are left out, and looked for
        without them.
        """
        missing = tuple(sorted(set(columns)))
        if not missing:
            return self.residual
        if missing not in self._without:
            self._without[missing] = learn_subject_residual(self.others.residuals(missing))
        return self._without[missing]

    def infer_paths(self, given: Measured) -> list[LatentPath]:
        """Find the latent path of a cycle for every draw.

        Paths are found as they were for the people left out, with one variance for all
        features: what is nearest in millimetres.
        """
        poses, d = given.u.shape
        white = np.full(d, np.mean(self.residual.white(poses)))
        return [infer_path(one.process, given, white, known=one.known) for one in self.draws]


def cycles_of(fit: Fit) -> TrainingCycles:
    """Return the training cycles of a fit.

    Raises
    ------
    InputError
        If the model is none of cycles of people.
    """
    return _of_people(fit)[1]


def _of_people(fit: Fit) -> tuple[ConditionsOnCycles, TrainingCycles]:
    model = fit.model
    if not isinstance(model, ConditionsOnCycles):
        raise lacking(model.name, "it knows no gait cycles of people", ConditionsOnCycles)
    training = fit.training
    assert isinstance(training, TrainingCycles), "cycles are those of training"
    return model, training


def with_subject_residual(fit: Fit) -> Fit:
    """Return the fit with what new people have of their own, learned and kept in its tree."""
    kept = fit.tree[GROUP].data_vars if GROUP in fit.tree.children else ()
    if set(SubjectResidual._fields) <= set(kept):
        return fit
    residual = learn_subject_residual(_leave_one_out(fit).residuals())
    tree = fit.tree.copy()
    both = ("band", "feature", "feature_bis")
    tree[GROUP] = xr.DataTree(
        xr.Dataset(
            {
                "power": (("harmonic", "feature"), np.asarray(residual.power)),
                "correlation": (both, np.asarray(residual.correlation)),
                "log_scale_sd": ("band", np.asarray(residual.log_scale_sd)),
                "process_variance": float(residual.process_variance),
            }
        )
    )
    return Fit(fit.model, fit.motion, tree)


def trained_of(fit: Fit, draws: int = DRAWS) -> Trained:
    """Make a fit ready for new people; what it does not know of them yet is learned.

    Parameters
    ----------
    fit
        Of a gait-pose model, by any method.
    draws
        At most so many of its draws, evenly spread.
    """
    fit = with_subject_residual(fit)
    group = fit.tree[GROUP].to_dataset()
    residual = SubjectResidual(*(group[name].values for name in SubjectResidual._fields))
    model, training = require_model(fit), cycles_of(fit)
    processes = [_condition(model, training.frames, one) for one in _draws(fit, draws)]
    ready = tuple(TrainedDraw(process, known_paths(process)) for process in processes)
    return Trained(fit, training, ready, residual)


@partial(jax.jit, static_argnames="model")
def _condition(model: Model, frames: Cycles, values: Mapping[str, AnyArray]) -> LatentGP:
    return model.condition(frames, values)


def _draws(fit: Fit, most: int) -> list[dict[str, Array]]:
    """Return the site values of the draws of a fit, at most so many."""
    values, (chains, draws) = stacked(fit, most)
    return [{name: value[i] for name, value in values.items()} for i in range(chains * draws)]


def _leave_one_out(fit: Fit) -> LeaveOneOut:
    return leave_one_out(*_of_people(fit), _draws(fit, RESIDUAL_DRAWS))


def mixture_of_poses(poses: Sequence[Pose]) -> Mixture:
    """Return the mixture of what every draw says, which count alike."""
    mean, sd = (np.stack([getattr(pose, name) for pose in poses]) for name in ("mean", "sd"))
    return Mixture(mean, sd, np.full(len(poses), 1.0 / len(poses)))


def _each(trained: Trained, given: Measured, said: Callable[[LatentPath], Pose]) -> Mixture:
    return mixture_of_poses([said(path) for path in trained.infer_paths(given)])


def interpolate(trained: Trained, u: Float[np.ndarray, "t d"]) -> Mixture:
    """Represent a whole cycle by the model: its mean at the best latent path.

    Its standard deviation says how far a new person's poses are from that.
    """
    nothing = measured(u, np.zeros(u.shape, bool))
    return _each(trained, measured(u), lambda path: pose_given(path, nothing, trained.residual))


def reconstruct(trained: Trained, u: Float[np.ndarray, "t d"]) -> Mixture:
    """Fill in features that were not measured.

    Parameters
    ----------
    u
        (T, D) features, NaN where missing: all through the cycle (`hidden`), or in some poses.

    Returns
    -------
    Every entry, those measured as they are.
    """
    given, residual = measured(u), trained.residual_without(missing_in(u))
    return _each(trained, given, lambda path: pose_given(path, given, residual))


def hidden(u: Float[np.ndarray, "t d"], columns: Sequence[int]) -> Float[np.ndarray, "t d"]:
    """Return a cycle of which some features are missing (NaN) all through."""
    out = np.array(u, float)
    out[:, list(columns)] = np.nan
    return out


def missing_in(u: Float[np.ndarray, "t d"]) -> list[int]:
    """Return the features that are missing (NaN) all through a cycle."""
    return np.flatnonzero(np.isnan(u).all(axis=0)).tolist()


def without(u: Float[np.ndarray, "t d"], columns: Sequence[int]) -> Measured:
    """Return what is measured of a cycle without some features."""
    return measured(hidden(u, columns))


def held_out_density(
    trained: Trained, u: Float[np.ndarray, "t d"], columns: Sequence[int]
) -> float:
    """Compute the log density of the features in `columns` given the others.

    Both at the latent paths of the others; densities are averaged over draws.
    """
    part, whole = without(u, columns), measured(u)
    residual = trained.residual_without(columns)
    each = []
    for path in trained.infer_paths(part):
        both = pose_given(path, whole, residual).log_density
        each.append(both - pose_given(path, part, residual).log_density)
    return float(logsumexp(each) - np.log(len(each)))


def denoise(
    trained: Trained, u: Float[np.ndarray, "t d"], level: float | None = None
) -> tuple[Mixture, float]:
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
    # One path serves all levels: beside a person's own residual such noise is small.
    given = measured(u, noise=_share(guess) * _sd_along(u))
    paths = trained.infer_paths(given)
    ratios = [1.0] if level is not None else [_share(one) / _share(guess) for one in tried]
    residual = trained.residual_without(missing_in(u))
    best = 0
    if len(ratios) > 1:
        found = [level_log_densities(path, given, residual, ratios) for path in paths]
        best = int(np.argmax(np.asarray(logsumexp(np.stack(found), axis=0))))
    poses = [pose_given(path, given, residual, ratios[best]) for path in paths]
    return mixture_of_poses(poses), tried[best]


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


def along(trained: Trained, pose: AnyArray, gait: AnyArray, radius: AnyArray) -> Mixture:
    """Return the poses at a path on the ideal surface, moved as the training points about it were.

    Learned points are not where the ideal ones are; what the nearest of them moved by, weighted by
    their nearness, the path is moved by too.

    Parameters
    ----------
    pose, gait, radius
        (N,) places on the surface, which need not be whole numbers.

    Returns
    -------
    Features (N, D), with the noise that new people's have.

    Raises
    ------
    InputError
        If the model's gaits have no places on a surface.
    """
    surface = _ordered_surface(trained)
    at, ideal = np.asarray(surface.at(pose, gait, radius)), surface.points()
    square = np.sum((at[:, None] - ideal[None]) ** 2, axis=-1)
    near = np.exp(-0.5 * square / (0.5 * surface.spacing) ** 2 + 0.5 * square.min(axis=1)[:, None])
    near /= near.sum(axis=1, keepdims=True)
    made = []
    for process in (one.process for one in trained.draws):
        x = at + near @ (np.asarray(process.x) - ideal)
        mean, variance = process.at(jnp.asarray(x))
        sd = np.sqrt(np.asarray(variance + process.noise))
        made.append(Pose(np.asarray(mean), sd, 0.0))
    return mixture_of_poses(made)


def paths(
    trained: Trained, poses: int = 30, turns: float = 2.0
) -> dict[str, dict[str, np.ndarray]]:
    """Return the three paths of Figure 14: a straight line outwards, an inner and an outer spiral.

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
    """Return the surface of a model whose gaits have places on it."""
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
    """Return the columns of limbs (`LIMBS`) or joints by name.

    Raises
    ------
    InputError
        If a name is neither.
    """
    encoding = trained.training.encoding
    return encoding.columns(joints_named(encoding, names))


def moved_joints(columns: Sequence[int]) -> list[int]:
    """Return which of `CycleEncoding.positions`' 17 joints move when these features change.

    A joint's rotation moves what hangs on it, not the joint itself.
    """
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
