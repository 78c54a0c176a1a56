"""Walking, running and striding as Fourier series of the gait phase, with ways to vary them.

Everything here is linear, which is what makes the synthetic walkers multilinear:

    gait curves (degrees, every tenth of a cycle) -> Fourier coefficients of some
    anatomical quantities -> coefficients of the skeleton's degrees of freedom

The phase runs from one left heel strike (0) to the next (2 pi). The right side does
the same half a cycle later.

The curves follow the published ones: walking, Winter (1991), The Biomechanics and
Motor Control of Human Gait; running, Novacheck (1998), The biomechanics of running,
Gait & Posture 7. Striding is walking with the long exaggerated steps of the CMU
recordings of that name. The curves of the legs were moved by a few degrees so that
three harmonics keep the foot that carries the body nearly still.
"""

import numpy as np
from jaxtyping import Float

HARMONICS = 3
TERMS = ("1", *(f"{name} {k}" for k in range(1, HARMONICS + 1) for name in ("cos", "sin")))
STYLES = ("body", "vigour", "bearing")
MODES = ("walk", "run - walk", "stride - walk")

# Gait vectors in the space of MODES. The last two are mixtures, not tables.
GAITS: dict[str, tuple[float, float, float]] = {
    "walk": (1.0, 0.0, 0.0),
    "run": (1.0, 1.0, 0.0),
    "stride": (1.0, 0.0, 1.0),
    "jog": (1.0, 0.75, 0.0),
    "stroll": (1.0, 0.0, -0.5),
}
BASIC = ("walk", "run", "stride")
CADENCE = {"walk": 0.93, "run": 1.40, "stride": 0.80}  # cycles (two steps) a second
DUTY = {"walk": 0.62, "run": 0.34, "stride": 0.62}  # fraction of the cycle a foot is down

# Degrees at 0, 10, .. 90 % of the cycle, left side, for walk, run, stride. Flexion and
# toes up are positive; `pitch` is the foot against the floor, `arm` the upper arm.
_CURVES: dict[str, tuple[tuple[float, ...], ...]] = {
    "hip": (
        (25, 23, 16, 3, -7, -10, -4, 10, 23, 27),
        (36, 32, 16, -6, -16, -8, 13, 39, 50, 43),
        (35, 34, 24, 6, -9, -16, -11, 9, 29, 35),
    ),
    "knee": (
        (5, 15, 19, 11, 8, 18, 42, 62, 50, 17),
        (21, 38, 41, 26, 23, 49, 86, 98, 66, 26),
        (7, 22, 26, 15, 9, 16, 39, 65, 56, 20),
    ),
    "pitch": (
        (16, 3, 0, -1, -5, -22, -51, -50, -10, 20),
        (6, 0, 0, -13, -47, -75, -77, -53, -16, 8),
        (21, 5, 0, 0, -7, -32, -64, -57, -8, 26),
    ),
    "toe": (
        (0, 0, 1, 0, 6, 25, 26, 8, 1, 2),
        (0, 0, 0, 13, 27, 19, 5, 4, 4, 1),
        (0, 0, 1, 0, 9, 31, 28, 7, 1, 2),
    ),
    "arm": (
        (-20, -17, -9, 2, 12, 16, 13, 5, -6, -15),
        (-40, -31, -14, 6, 19, 20, 9, -7, -24, -37),
        (-30, -25, -13, 5, 20, 27, 22, 10, -7, -22),
    ),
    "elbow": (
        (14, 15, 18, 24, 29, 31, 28, 23, 18, 15),
        (80, 82, 87, 93, 97, 97, 93, 87, 83, 80),
        (18, 20, 25, 34, 42, 45, 41, 33, 25, 20),
    ),
}
# Postures: constants in degrees for walk, run, stride.
_POSTURES: dict[str, tuple[float, float, float]] = {
    "tilt": (2, 7, 3),  # pelvis forwards
    "lean": (3, 7, 4),  # spine forwards, beyond the pelvis
    "hang": (82, 74, 80),  # upper arms down from the side
    "turn": (4, 16, 6),  # upper arms turned inwards
    "narrow": (2.5, 4.0, 2.5),  # legs together
    "toe_out": (0, 0, 0),  # beyond the skeleton's own
    "hunch": (0, 2, 0),  # head carried forwards
    "grip": (25, 55, 30),  # fingers bent
}
# Swings of the trunk: amplitude for walk, run, stride; harmonic; where in the cycle
# the peak is. `twist` > 0 takes the left side back, `drop` > 0 lowers the right side.
_SWINGS: dict[str, tuple[tuple[float, float, float], int, float]] = {
    "tilt": ((0.8, 1.5, 1.5), 2, 0.05),
    "twist": ((5.0, 8.0, 9.0), 1, 0.50),
    "drop": ((4.0, 4.5, 4.0), 1, 0.13),
}
# What a unit of each style does: scale the swing of a quantity, add degrees to its mean.
_SCALE = {
    "vigour": {"hip": 0.10, "knee": 0.08, "arm": 0.35, "elbow": 0.25, "twist": 0.30, "toe": 0.1},
    "bearing": {"drop": 0.50, "arm": -0.25, "twist": 0.25, "knee": -0.05},
}
_SHIFT = {
    "vigour": {"lean": 2.5, "elbow": 7.0, "hang": -2.0, "grip": 8.0, "hunch": -2.0},
    "bearing": {"lean": 3.0, "hang": -7.0, "turn": 7.0, "toe_out": 2.0, "hunch": 6.0, "hip": 2.5},
}
_QUICKER = {"vigour": 0.06, "bearing": -0.03}  # change of cadence a unit of style, relative

# Degrees of freedom as sums of quantities. `foot/rx` makes the foot's pitch come out
# right whatever hip, knee and pelvis do, so that it stays flat on the floor in stance.
_LIMB: dict[str, dict[str, float]] = {
    "femur/rx": {"hip": -1.0},
    "femur/ry": {"toe_out": 1.0, "twist": -1.0},
    "femur/rz": {"narrow": -1.0, "drop": -1.0},
    "tibia/rx": {"knee": 1.0},
    "foot/rx": {"pitch": -1.0, "hip": 1.0, "knee": -1.0, "tilt": -1.0},
    "foot/rz": {"narrow": 1.0},
    "toes/rx": {"toe": -1.0},
    "clavicle/ry": {"arm": -0.10},
    "humerus/rx": {"arm": 1.0},
    "humerus/ry": {"turn": 1.0},
    "humerus/rz": {"hang": -1.0},
    "radius/rx": {"elbow": 1.0},
    "wrist/ry": {"turn": -1.0},
    "hand/rx": {"grip": 0.2},
    "fingers/rx": {"grip": 1.0},
    "thumb/rx": {"grip": 0.4},
}
_MIDLINE: dict[str, dict[str, float]] = {
    "root/rx": {"tilt": 1.0},
    "root/ry": {"twist": 1.0},
    "root/rz": {"drop": 1.0},
    **{f"{part}/rx": {"lean": 1 / 3} for part in ("lowerback", "upperback", "thorax")},
    **{f"{part}/ry": {"twist": -0.55} for part in ("lowerback", "upperback", "thorax")},
    **{f"{part}/rz": {"drop": -1 / 3} for part in ("lowerback", "upperback", "thorax")},
    "lowerneck/rx": {"lean": -0.3, "tilt": -0.3, "hunch": 1.0},
    "upperneck/rx": {"lean": -0.3, "tilt": -0.3},
    "head/rx": {"lean": -0.3, "tilt": -0.3, "hunch": -1.0},
    **{f"{part}/ry": {"twist": 0.2} for part in ("lowerneck", "upperneck", "head")},
}


def fourier_basis(phase: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch term"]:
    """Give the terms of the Fourier series at each phase in radians, ordered as `TERMS`."""
    columns = [np.ones_like(phase)]
    for k in range(1, HARMONICS + 1):
        columns += [np.cos(k * phase), np.sin(k * phase)]
    return np.stack(columns, axis=-1)


def core(dofs: tuple[str, ...]) -> Float[np.ndarray, "style mode dof term"]:
    """Give the core tensor W: angles are sum_ij s_i g_j W[i, j] . fourier_basis(phase).

    Parameters
    ----------
    dofs
        Labels of the degrees of freedom; those the gaits say nothing of stay at zero.

    Returns
    -------
    Coefficients in radians, for the styles `STYLES`, the modes `MODES`, the given
    degrees of freedom and the terms `TERMS`.
    """
    quantities = _quantities()
    half = np.array([1.0, *((-1.0) ** k for k in range(1, HARMONICS + 1) for _ in range(2))])
    tables = {dof: _sum(quantities, parts) for dof, parts in _MIDLINE.items()}
    for dof, parts in _LIMB.items():
        left = _sum(quantities, parts)
        tables[f"l{dof}"] = left
        # The mirror image keeps rx and turns ry and rz round.
        tables[f"r{dof}"] = left * half * (1.0 if dof.endswith("rx") else -1.0)
    silent = np.zeros((len(STYLES), len(MODES), len(TERMS)))
    by_gait = np.stack([tables.get(dof, silent) for dof in dofs], axis=2)
    return np.deg2rad(_to_modes(by_gait))


def cadence_core() -> Float[np.ndarray, "style mode"]:
    """Give the bilinear form of the cadence, in cycles a second."""
    walk_run_stride = np.array([CADENCE[gait] for gait in BASIC])
    rows = [walk_run_stride * (1.0 if style == "body" else _QUICKER[style]) for style in STYLES]
    return _to_modes(np.stack(rows))


def duty(gait: str) -> float:
    """Give the fraction of the cycle during which a foot is on the floor."""
    mixed = _to_modes(np.array([[DUTY[name] for name in BASIC]]))[0]
    return float(mixed @ GAITS[gait])


def _quantities() -> dict[str, Float[np.ndarray, "style gait term"]]:
    """Give the coefficients of every anatomical quantity in degrees, for walk, run, stride."""
    body = {name: np.zeros((len(BASIC), len(TERMS))) for name in (*_CURVES, *_POSTURES, *_SWINGS)}
    # Ten samples determine three harmonics; least squares leaves out the higher ones.
    samples = np.linalg.pinv(fourier_basis(np.arange(10) * 2 * np.pi / 10))
    for name, curves in _CURVES.items():
        body[name] += np.array(curves, dtype=float) @ samples.T
    for name, means in _POSTURES.items():
        body[name][:, 0] += means
    for name, (amplitudes, k, peak) in _SWINGS.items():
        angle = 2 * np.pi * k * peak
        body[name][:, 2 * k - 1] += np.array(amplitudes) * np.cos(angle)
        body[name][:, 2 * k] += np.array(amplitudes) * np.sin(angle)
    return {name: np.stack([table, *_styled(name, table)]) for name, table in body.items()}


def _styled(
    name: str, body: Float[np.ndarray, "gait term"]
) -> list[Float[np.ndarray, "gait term"]]:
    """Give what one unit of each style adds to a quantity's coefficients."""
    added = []
    for style in STYLES[1:]:
        change = body * _SCALE[style].get(name, 0.0)
        change[:, 0] = _SHIFT[style].get(name, 0.0)
        added.append(change)
    return added


def _sum(
    quantities: dict[str, Float[np.ndarray, "style gait term"]], parts: dict[str, float]
) -> Float[np.ndarray, "style gait term"]:
    """Add up quantities with their factors."""
    return np.sum([factor * quantities[name] for name, factor in parts.items()], axis=0)


def _to_modes(
    by_gait: Float[np.ndarray, "style gait *rest"],
) -> Float[np.ndarray, "style mode *rest"]:
    """Turn tables of walk, run and stride into those of walk and the two differences."""
    walk = by_gait[:, :1]
    return np.concatenate([walk, by_gait[:, 1:] - walk], axis=1)
