"""Faces from sound: the search for a path, its starts, pieces, draws and intervals."""

import importlib.util
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import jax
import numpy as np
import pytest
import xarray as xr
from bayesmotion.models.shared_views import Look
from bayesmotion.priors.back_constraints import BackConstraint
from bayesmotion.tasks.speech_paths import PathDensity, likeliest_path, viterbi_states

from bayesmotion.errors import InputError
from bayesmotion.fit import Fit
from bayesmotion.models.shared_gplvm import SharedGPLVM
from bayesmotion.tasks.speech import Speaker, pieces

spec = importlib.util.spec_from_file_location(
    "talk", Path(__file__).parent.parent / "models" / "test_shared_gplvm.py"
)
assert spec is not None
assert spec.loader is not None
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
TALK = module.talk(7, 40)
PATH = SharedGPLVM(latent_size=2, constraint=BackConstraint("mlp", hidden=8), inducing=30)
WINDOW = SharedGPLVM(
    latent_size=6, constraint=BackConstraint("identity"), relevance=False, dynamics=False,
    look=Look(width=1, components=6), exact=True, inducing=400,
)  # fmt: skip
TRAIN, TEST = TALK.isel(frame=slice(0, 240)), TALK.isel(frame=slice(240, 280))
SOUND, FACE = TEST["audio"].values, TEST["face"].values


def begun(model):
    """A fit at the values a search begins at, which are near enough, and need no search."""
    values = model.initial_values(model.prepare(TRAIN), 0, 1)[0]
    values = {name: np.asarray(value) for name, value in values.items()}
    dims = {
        name: ("chain", "draw", *(f"{name}_{i}" for i in range(v.ndim)))
        for name, v in values.items()
    }
    posterior = xr.Dataset({name: (dims[name], v[None, None]) for name, v in values.items()})
    return Speaker(Fit(model, TRAIN, xr.DataTree.from_dict({"posterior": posterior})))


@pytest.fixture(scope="module")
def speaker():
    return begun(PATH)


@pytest.fixture(scope="module")
def window():
    return begun(WINDOW)


def off(made):
    return np.sqrt(np.mean((made - FACE) ** 2))


def test_both_starts_lead_to_the_face(speaker):
    for start in ("A", "B"):
        assert off(speaker.speak(SOUND, start).mean) < 0.25 * FACE.std()
    with pytest.raises(InputError, match="no such start"):
        speaker.path(SOUND, "C")


def test_the_search_climbs_the_joint(speaker):
    scaled = speaker.training.encoding.scaled("audio", SOUND)
    data = speaker.search_data(scaled, np.zeros((len(SOUND), 0)))

    def height(path):
        filled = np.pad(path, ((0, 128 - len(path)), (0, 0)))
        return float(PathDensity("audio")({"x": filled}, data))

    for start in ("A", "B"):
        begun = speaker.path(SOUND, start, search=False)
        assert height(speaker.path(SOUND, start)) > height(begun)


def test_what_comes_after_a_clip_counts_for_nothing(speaker):
    scaled = speaker.training.encoding.scaled("audio", SOUND)
    data = speaker.search_data(scaled, np.zeros((len(SOUND), 0)))
    x = np.random.default_rng(0).normal(size=(128, 2))
    other = x.copy()
    other[len(SOUND) :] += 5.0
    density = PathDensity("audio")
    assert float(density({"x": x}, data)) == float(density({"x": other}, data))


def test_viterbi_against_all_paths():
    random = np.random.default_rng(0)
    emission, transition = random.normal(size=(5, 3)), random.normal(size=(3, 3))

    def total(path):
        moves = sum(transition[a, b] for a, b in pairwise(path))
        return moves + sum(emission[t, s] for t, s in enumerate(path))

    best = max(product(range(3), repeat=5), key=total)
    assert tuple(likeliest_path(emission, transition)) == best


def test_start_b_is_among_the_training_points(speaker):
    scaled = speaker.training.encoding.scaled("audio", SOUND)
    states = viterbi_states(scaled, speaker.heard, speaker.given)
    begun = speaker.path(SOUND, "B", search=False)
    np.testing.assert_array_equal(begun, np.asarray(speaker.given.values["x"])[states])


def test_intervals_cover(speaker, window):
    for one in (speaker, window):
        face = one.speak(SOUND)
        assert off(face.mean) < 0.25 * FACE.std()
        inside = np.mean(np.abs(face.mean - FACE) < 1.645 * face.spread)
        assert 0.75 < inside <= 1.0


def test_pieces_give_the_whole_where_no_path_is_searched_for(window):
    online = window.online()
    made = [online.feed(piece).mean for piece in pieces(SOUND, 7)]
    made.append(online.finish().mean)
    whole = window.speak(SOUND).mean
    assert sum(map(len, made)) == len(SOUND)
    # A piece that ended saw its last frame go on; frames are told when all they see is there.
    np.testing.assert_allclose(np.concatenate(made), whole, atol=1e-9)


def test_pieces_of_a_searched_path_are_near_the_whole(speaker):
    online = speaker.online()
    made = [online.feed(piece).mean for piece in pieces(SOUND, 20)]
    made.append(online.finish().mean)
    assert off(np.concatenate(made)) < 0.3 * FACE.std()
    with pytest.raises(InputError, match="no sound came"):
        speaker.online().finish()


def test_draws_are_around_the_face(speaker, window):
    for one in (speaker, window):
        draws = one.draw(SOUND, jax.random.key(0), 8, warmup=10)
        assert draws.shape == (8, *FACE.shape)
        face = one.speak(SOUND)
        assert np.mean(np.abs(draws.mean(axis=0) - face.mean) / face.spread) < 1.0
        assert 0.5 < np.mean(draws.std(axis=0) / face.spread) < 2.0


def test_private_coordinates_of_the_face_widen_its_intervals():
    model = replace(PATH, private=(0, 1))
    speaker = begun(model)
    face = speaker.show(speaker.path(SOUND, search=False))
    plain = begun(PATH)
    without = plain.show(plain.path(SOUND, search=False))
    assert face.mean.shape == FACE.shape
    assert face.spread.mean() > without.spread.mean()


def test_what_cannot_speak_is_refused(speaker):
    with pytest.raises(InputError, match="no back-constraint"):
        Speaker(speaker.fit, heard="face")
    with pytest.raises(InputError, match="no such view"):
        Speaker(speaker.fit, shown="brow")
    with pytest.raises(InputError, match="frames of 4 features"):
        speaker.speak(SOUND[:, :3])
