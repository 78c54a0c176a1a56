"""Synthetic walkers move like people: joints, feet, root and body."""

from pathlib import Path

import numpy as np
import pytest

from bayesmotion.motion import read_asf, skeleton_of, split
from bayesmotion.motion.quality.floor import contact_points
from bayesmotion.motion.synthetic.anthropometry import adult_skeleton
from bayesmotion.motion.synthetic.gaits import duty, fourier_basis
from bayesmotion.motion.synthetic.walkers import Truth, synthetic_truth

FOUR = ("ann", "ben", "cas", "dee")
EVERY = ("walk", "run", "stride", "jog", "stroll")


@pytest.fixture(scope="module")
def wide() -> Truth:
    """Make people as different as they come, with frames close enough for speeds."""
    return synthetic_truth(FOUR, EVERY, styles=2, seconds=1.6, frame_rate=120.0)


def phase_of(truth: Truth, clip: str) -> np.ndarray:
    return truth.phase.values[truth.phase["clip"].values == clip]


RANGES = {  # degrees, all people: least and greatest of the lowest and of the highest value
    ("walk", "lfemur/rx"): ((-40, -20), (2, 20)),
    ("walk", "ltibia/rx"): ((0, 12), (55, 75)),
    ("walk", "lfoot/rx"): ((-30, -8), (0, 25)),
    ("walk", "lradius/rx"): ((5, 30), (20, 50)),
    ("run", "lfemur/rx"): ((-65, -40), (5, 25)),
    ("run", "ltibia/rx"): ((10, 25), (85, 110)),
    ("run", "lradius/rx"): ((65, 95), (85, 115)),
    ("stride", "lfemur/rx"): ((-50, -28), (8, 25)),
    ("stride", "ltibia/rx"): ((0, 14), (55, 80)),
}


@pytest.mark.parametrize(("gait", "dof"), RANGES)
def test_joints_stay_within_human_ranges(wide: Truth, gait: str, dof: str) -> None:
    one = wide.motion.isel(frame=wide.motion["gait"].values == gait)
    angles = np.rad2deg(one["angle"].sel(dof=dof)).groupby(one["subject"])
    for values, (least, greatest) in zip(
        (angles.min(), angles.max()), RANGES[gait, dof], strict=True
    ):
        assert (values > least).all(), values
        assert (values < greatest).all(), values


def test_the_knee_bends_twice_in_a_walking_cycle(wide: Truth) -> None:
    phase = np.arange(200) * 2 * np.pi / 200
    walk = wide.coefficient.sel(subject="ben", gait="walk", dof="ltibia/rx").values
    knee = np.rad2deg(fourier_basis(phase) @ walk)
    peaks = np.flatnonzero((knee > np.roll(knee, 1)) & (knee > np.roll(knee, -1)))
    big = [p for p in peaks if knee[p] > 12]
    assert len(big) == 2
    assert 10 < big[0] / 2 < 25  # per cent of the cycle: loading
    assert 65 < big[1] / 2 < 80  # and swing


def test_right_is_left_half_a_cycle_later(wide: Truth) -> None:
    phase = np.linspace(0, 2 * np.pi, 50)
    table = wide.coefficient.sel(subject="cas", gait="run")
    for dof, sign in (("tibia/rx", 1), ("femur/rz", -1), ("humerus/rx", 1), ("clavicle/ry", -1)):
        right = fourier_basis(phase) @ table.sel(dof=f"r{dof}").values
        left = fourier_basis(phase + np.pi) @ table.sel(dof=f"l{dof}").values
        np.testing.assert_allclose(right, sign * left, atol=1e-12)


def test_arms_swing_against_the_legs(wide: Truth) -> None:
    for part in split(wide.motion).values():
        hip, arm = (part["angle"].sel(dof=d).values for d in ("lfemur/rx", "lhumerus/rx"))
        assert np.corrcoef(-hip, arm)[0, 1] < -0.7


Feet = dict[tuple[str, str], tuple[np.ndarray, np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def feet(wide: Truth) -> Feet:
    """Give heel, ball and toes (frame, side, point, 3), each side's cycle, the root's path."""
    found = {}
    for clip, part in split(wide.motion).items():
        subject, gait = clip.split("-")
        stature = float(wide.stature.sel(subject=subject))
        root = part["root_position"].values
        points = contact_points(skeleton_of(part), part["angle"].values, root, stature)
        phase = phase_of(wide, clip)
        cycle = np.stack([phase, phase + np.pi], 1) % (2 * np.pi) / (2 * np.pi)
        found[subject, gait] = points, cycle, root
    return found


@pytest.mark.parametrize("gait", EVERY)
def test_feet_stay_on_the_floor(feet: Feet, gait: str) -> None:
    for subject in FOUR:
        points, cycle, root = feet[subject, gait]
        speed = np.diff(root[:, 2]).mean() * 120.0
        lowest = points[..., 1].min(-1)
        assert lowest.min() > -0.02
        loaded = (cycle > 0.1) & (cycle < duty(gait) - 0.12)
        assert loaded.sum() > 40
        assert abs(lowest[loaded]).max() < 0.015
        touching = points[..., 1].argmin(-1)[..., None, None]
        moving = np.gradient(points, 1 / 120.0, axis=0)[..., [0, 2]]
        slip = np.linalg.norm(np.take_along_axis(moving, touching, 2)[:, :, 0], axis=-1)
        assert np.median(slip[loaded]) < 0.06 * speed
        assert slip[loaded].max() < 0.12 * speed


def test_only_runners_leave_the_floor(feet: Feet) -> None:
    for gait, flies in {"walk": False, "stride": False, "stroll": False, "run": True}.items():
        for subject in FOUR:
            lowest = feet[subject, gait][0][..., 1].min((1, 2))
            assert (lowest.max() > 0.009) == flies, (subject, gait, lowest.max())


def test_the_root_moves_like_a_body(wide: Truth, feet: Feet) -> None:
    speeds: dict[str, list[float]] = {}
    for (subject, gait), (_, _, root) in feet.items():
        cadence = float(wide.step.sel(subject=subject, gait=gait)) * 120 / (2 * np.pi)
        speed = np.gradient(root[:, 2], 1 / 120.0)
        speeds.setdefault(gait, []).append(speed.mean())
        assert abs(speed / speed.mean() - 1).max() < 0.35
        # Up and down twice a cycle: the second harmonic explains the height.
        angle = 2 * np.pi * 2 * cadence * np.arange(len(root)) / 120
        waves = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], 1)
        rest = root[:, 1] - waves @ np.linalg.lstsq(waves, root[:, 1], rcond=None)[0]
        assert rest.std() < 0.05 * root[:, 1].std()
        assert 0.003 < np.ptp(root[:, 1]) < 0.12
    between = {"walk": (1.0, 1.7), "run": (2.2, 3.7), "stride": (1.1, 2.0), "stroll": (0.8, 1.5)}
    for gait, (slow, fast) in between.items():
        assert slow < min(speeds[gait]) <= max(speeds[gait]) < fast


def test_the_body_is_as_tall_as_it_should_be() -> None:
    skeleton = adult_skeleton("ann", 1.7)
    place: dict[str, np.ndarray] = {}
    for joint in skeleton:
        start = place[skeleton.names[joint.parent]] if joint.parent >= 0 else 0.0
        place[joint.name] = start + np.array(joint.offset)
    assert place["head_end"][1] - place["ltoes"][1] == pytest.approx(1.7)
    assert place["lfemur"][1] - place["ltoes"][1] == pytest.approx(0.53 * 1.7)
    assert place["lhumerus"][1] - place["ltoes"][1] == pytest.approx(0.818 * 1.7)
    for name, (x, y, z) in place.items():
        if name[0] == "l" and "r" + name[1:] in place:
            np.testing.assert_allclose(place["r" + name[1:]], (-x, y, z), atol=1e-12)
            assert x >= 0


@pytest.mark.real_data
def test_the_joints_are_those_of_cmu(data_root: Path) -> None:
    real, made = read_asf(data_root / "cmu/35/35.asf"), adult_skeleton("made", 1.75)
    assert sorted(real.names) == sorted(made.names)
    for joint in real:
        twin = made.joints[made.index(joint.name)]
        assert twin.channels == joint.channels, joint.name
        if joint.parent >= 0:
            assert made.names[twin.parent] == real.names[joint.parent]
