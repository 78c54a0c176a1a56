"""The synthetic talker: her sound follows from her face, and her landmarks are where they are."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.sensing.audio.cepstra import mfcc
from bayesmotion.sensing.face.talker import PHONES, RATE, SEEN, articulate, synthetic_talker
from bayesmotion.sensing.face.talker_face import INNER_LIPS, LANDMARKS, OUTER_LIPS


def test_sound_and_pictures_are_as_long(talk):
    for one in talk:
        assert one.frames.shape == (50, 96, 96, 3)
        assert one.landmarks.shape == (50, LANDMARKS, 2)
        assert mfcc(one.wave, RATE).shape == (50, 13)
    assert not np.array_equal(talk[0].wave, talk[1].wave)


def test_the_same_seed_says_the_same():
    one, same, other = (
        synthetic_talker(seed, utterances=1, seconds=1.0, size=48)[0] for seed in (3, 3, 4)
    )
    assert np.array_equal(one.wave, same.wave)
    assert np.array_equal(one.frames, same.frames)
    assert not np.array_equal(one.landmarks, other.landmarks)


def test_a_phones_mouth_depends_on_its_neighbours():
    time = np.array([0.2])
    between = {
        name: articulate(((name, 0.1), ("s", 0.2), (name, 0.3)), time)[0] for name in ("u", "i")
    }
    rounding = 1
    alone = PHONES["s"][rounding]
    assert between["u"][rounding] > alone + 0.1
    assert between["i"][rounding] < alone
    closed = articulate((("a", 0.1), ("m", 0.2), ("a", 0.3)), time)[0]
    assert closed[2] > 0.9  # closed lips stay closed


def test_the_lips_are_red_and_the_open_mouth_is_dark(talk):
    """Landmarks lie where they are drawn."""
    one = talk[0]
    opened = int(one.articulators[:, 0].argmax())
    closed = int(one.articulators[:, 2].argmax())

    def colour(frame, point):
        x, y = np.round(point).astype(int)
        return one.frames[frame, y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3).mean(axis=0)

    lower = (one.landmarks[opened, OUTER_LIPS][6] + one.landmarks[opened, INNER_LIPS][6]) / 2
    lip = colour(opened, lower)
    assert lip[0] > 1.5 * lip[1]
    inside = one.landmarks[opened, INNER_LIPS][6] * 0.6 + one.landmarks[opened, INNER_LIPS][2] * 0.4
    assert colour(opened, inside)[0] < 110
    assert colour(closed, one.landmarks[closed, INNER_LIPS].mean(axis=0))[0] > 130


def test_the_sound_tells_the_face():
    """Ridge regression on three frames of cepstra; shuffled sentences tell nothing."""
    said = synthetic_talker(1, utterances=10, seconds=2.4, size=48, sway=0.0)
    sound = [mfcc(one.wave, RATE) for one in said]
    near = [np.hstack([np.roll(one, shift, axis=0) for shift in (-1, 0, 1)]) for one in sound]
    seen = [one.articulators[:, :SEEN] for one in said]

    def explained(inputs):
        x = np.vstack(inputs[:8])
        middle, spread = x.mean(axis=0), x.std(axis=0)
        y = np.vstack(seen[:8])
        x, test = (x - middle) / spread, (np.vstack(inputs[8:]) - middle) / spread
        weights = np.linalg.solve(x.T @ x + np.eye(x.shape[1]), x.T @ (y - y.mean(axis=0)))
        rest = test @ weights + y.mean(axis=0) - np.vstack(seen[8:])
        return 1 - (rest**2).mean() / np.vstack(seen[8:]).var(axis=0).mean()

    assert explained(near) > 0.6
    assert explained(near[1:] + near[:1]) < 0.2


@pytest.mark.parametrize(
    "changed",
    [{"utterances": 0}, {"seconds": 0.1}, {"frame_rate": 500.0}, {"size": 10}, {"noise": -1.0}],
)
def test_numbers_out_of_range_are_told(changed):
    with pytest.raises(InputError, match="synthetic talker"):
        synthetic_talker(0, **changed)
