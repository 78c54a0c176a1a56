"""Keyposes of a motion at the beats of its music, and how sure they are.

`keyposes_of` follows the paper's rule from positions to keyposes. `posterior` learns the
generative program from minima whose answers are known, by NUTS or by emcee's ensemble, and
`probabilities` averages its answer for new minima over the draws.
"""

import warnings
from dataclasses import replace
from typing import Literal

import arviz as az
import emcee
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float
from numpyro import infer

from ..errors import InputError, MotionWarning
from ..inference.density import ProgramDensity
from ..models.energy import Minima, Thresholds, body_centred, energy, minima_near
from ..models.keypose_program import SITES, KeyposeProgram, Minimums, probability
from ..models.keyposes import Keyposes, select
from ..motion.dataset import skeleton_of
from ..motion.kinematics import positions
from ..motion.skeleton import Skeleton

# Hips and a point of the spine, by the names skeletons give them.
HIPS = (("lfemur", "rfemur"), ("LeftUpLeg", "RightUpLeg"), ("LHip", "RHip"))
WAISTS = ("lowerback", "upperback", "Spine1", "Spine", "thorax")
PLENTY = 50.0  # autocorrelation times an ensemble must run


def flows(
    position: Float[np.ndarray, "n j 3"],
    frame_rate: float,
    frame: tuple[int, int, int],
    *,
    weight: Float[np.ndarray, " j"] | None = None,
    smoothing: float = 0.08,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Give the energy flow in the global and in the body's frame.

    Parameters
    ----------
    position
        Markers or joints in the global frame.
    frame_rate
        Frames a second.
    frame
        Columns of the left hip, the right hip and the waist.
    weight, smoothing
        As for `bayesmotion.models.keyposes.energy`.
    """
    seen = (position, body_centred(position, *frame))
    flow = [energy(part, frame_rate, weight=weight, smoothing=smoothing) for part in seen]
    return flow[0], flow[1]


def flows_of(
    motion: xr.Dataset, weight: Float[np.ndarray, " j"] | None = None
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Give the energy flow of one clip in the global and in the body's frame."""
    rate = float(motion.attrs["frame_rate"])
    return flows(positions(motion).values, rate, body_frame(motion), weight=weight)


def body_frame(motion: xr.Dataset) -> tuple[int, int, int]:
    """Find the left hip, the right hip and the waist among a skeleton's joints.

    Raises
    ------
    InputError
        If the skeleton names them otherwise.
    """
    skeleton = skeleton_of(motion)
    for left, right in HIPS:
        for waist in WAISTS:
            if {left, right, waist} <= set(skeleton.names):
                above = _above(skeleton, waist)
                return skeleton.index(left), skeleton.index(right), skeleton.index(above)
    raise InputError(
        f"skeleton {skeleton.name!r}",
        "its hips and spine have other names than are known",
        f"Name joints {HIPS[0][0]}, {HIPS[0][1]} and {WAISTS[0]}, or use the functions of "
        "bayesmotion.models.keyposes",
    )


def keyposes_of(
    motion: xr.Dataset,
    beats: Float[np.ndarray, " b"],
    thresholds: tuple[Thresholds, Thresholds] | None = None,
    *,
    low: float | None = None,
    deep: float | None = None,
    window: float | None = None,
    weight: Float[np.ndarray, " j"] | None = None,
) -> tuple[Keyposes, Minima, Minima]:
    """Find the keyposes of one clip by the paper's rule.

    Parameters
    ----------
    motion
        One clip with a skeleton.
    beats
        Times of the beats in seconds from the clip's first frame.
    thresholds
        For the global and the body's frame; by default `plain_thresholds` of each.
    low, deep
        T_1 and T_2 in both frames of reference instead, each by itself.
    window
        Seconds around a beat in which minima are looked for; by default half the median
        time between beats.
    weight
        Of every joint, equal by default; `bayesmotion.motion.masses.joint_masses` for masses.

    Returns
    -------
    The keyposes, and the minima near the beats in the global and in the body's frame.

    Raises
    ------
    InputError
        If no beat lies within the clip.
    """
    rate = float(motion.attrs["frame_rate"])
    inside = beats[(beats >= 0) & (beats * rate <= motion.sizes["frame"] - 1)]
    if not len(inside):
        raise InputError("beats", "none lies within the clip", "Give seconds from its first frame")
    if window is None:
        window = 0.5 * float(np.median(np.diff(inside))) if len(inside) > 1 else 0.25
    minima = [minima_near(part, inside * rate, window * rate) for part in flows_of(motion, weight)]
    if thresholds is None:
        thresholds = (plain_thresholds(minima[0]), plain_thresholds(minima[1]))
    given = {name: value for name, value in (("low", low), ("deep", deep)) if value is not None}
    thresholds = (replace(thresholds[0], **given), replace(thresholds[1], **given))
    return select(minima[0], minima[1], thresholds), minima[0], minima[1]


def plain_thresholds(minima: Minima) -> Thresholds:
    """Give thresholds where no examples are: the lower quartile of energies, the median depth."""
    there = minima.frame >= 0
    if not there.any():
        return Thresholds(0.0, np.inf)
    return Thresholds(
        float(np.quantile(minima.energy[there], 0.25)), float(np.median(minima.depth[there]))
    )


def posterior(
    minima: Minimums,
    keypose: Float[np.ndarray, " b"],
    *,
    method: Literal["nuts", "emcee"] = "nuts",
    seed: int,
    draws: int = 1000,
    warmup: int = 500,
    chains: int = 4,
    walkers: int = 32,
) -> xr.DataTree:
    """Learn the generative program from minima whose answers are known.

    Parameters
    ----------
    minima, keypose
        The program's arrays; 1 for a keypose.
    method
        ``nuts``, or ``emcee`` for the affine-invariant ensemble.
    seed
        Of the draws.
    draws, warmup
        Of every chain, or of every walker.
    chains
        Of NUTS, run together.
    walkers
        Of emcee. They are not independent: R-hat across them says nothing, so the
        autocorrelation time is stored and a warning given where the run is too short.

    Returns
    -------
    ArviZ groups ``posterior`` and ``sample_stats``.
    """
    data = (minima, jnp.asarray(keypose))
    if method == "nuts":
        kernel = infer.NUTS(KeyposeProgram().program, target_accept_prob=0.9)
        mcmc = infer.MCMC(
            kernel, num_warmup=warmup, num_samples=draws, num_chains=chains,
            chain_method="vectorized", progress_bar=False,
        )  # fmt: skip
        mcmc.run(jax.random.key(seed), *data)
        return az.from_numpyro(mcmc, log_likelihood=False)
    return _ensemble(data, seed, draws, warmup, walkers)


def probabilities(fit: xr.DataTree, minima: Minimums) -> Float[np.ndarray, " b"]:
    """Give the posterior probability of each minimum to be a keypose."""
    sites = fit["posterior"].ds
    values = {name: jnp.asarray(sites[name].values.reshape(-1)) for name in SITES}

    return np.asarray(jax.vmap(lambda draw: probability(minima, **draw))(values).mean(axis=0))


def _ensemble(data: tuple, seed: int, draws: int, warmup: int, walkers: int) -> xr.DataTree:
    """Sample by emcee's stretch move; all sites live on the real line."""
    density = ProgramDensity(KeyposeProgram())

    @jax.jit
    def many(rows: jnp.ndarray) -> jnp.ndarray:
        return jax.vmap(lambda row: density(dict(zip(SITES, row, strict=True)), data))(rows)

    def log_density(rows: np.ndarray) -> np.ndarray:
        return np.asarray(many(rows))

    random = np.random.default_rng(seed)
    centre = np.array([0.0, 0.0, np.log(3.0), 0.0, np.log(0.1)])
    scale = np.array([0.5, 0.5, 0.3, 0.03, 0.2])
    sampler = emcee.EnsembleSampler(walkers, len(SITES), log_density, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    state = sampler.run_mcmc(centre + scale * random.normal(size=(walkers, len(SITES))), warmup)
    sampler.reset()
    sampler.run_mcmc(state, draws)
    time = sampler.get_autocorr_time(quiet=True, tol=0)
    if draws < PLENTY * time.max():
        warnings.warn(
            f"the ensemble ran {draws} steps, {draws / time.max():.0f} autocorrelation times: "
            f"give it {int(PLENTY * time.max()) + 1} draws",
            MotionWarning,
            stacklevel=3,
        )
    chain = sampler.get_chain()
    assert chain is not None
    sites = {name: (("chain", "draw"), chain[..., i].T) for i, name in enumerate(SITES)}
    log_p = sampler.get_log_prob()
    assert log_p is not None
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(sites),
            "sample_stats": xr.Dataset(
                {"lp": (("chain", "draw"), log_p.T), "autocorrelation_time": ("site", time)},
                {"site": list(SITES)},
            ),
        }
    )
    tree.attrs["inference"] = "emcee"
    return tree


def _above(skeleton: Skeleton, waist: str) -> str:
    """Give the first joint up the spine that does not sit between the hips."""
    index = skeleton.index(waist)
    for joint in skeleton.joints[index:]:
        spine = joint.parent == index or joint.name == waist
        if spine and any(joint.offset):
            return joint.name
    return waist
