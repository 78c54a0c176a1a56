"""Faces from sound by both models: starts, averages over draws, intervals, refusals."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.fit import Fit
from bayesmotion.inference.methods import EM, fit
from bayesmotion.inference.results import Record, make_fit
from bayesmotion.models.shared_gplvm import MLP, BackConstraint, Inducing, SharedGPLVM
from bayesmotion.models.shared_gplvm.published import published
from bayesmotion.models.voice_puppetry import VoicePuppetry
from bayesmotion.motion.synthetic.talk import synthetic_talk
from bayesmotion.tasks.speech import audio_to_face, puppet_trajectory, sound_clip

TALK = synthetic_talk(0, clips=7, frames=40)
TRAIN, TEST = TALK.isel(frame=slice(0, 240)), TALK.isel(frame=slice(240, 280))
FACE = TEST["face"].values
PATH = SharedGPLVM(
    latent_size=2, back=BackConstraint(map=MLP(hidden=8)), inducing=Inducing(30, above=0)
)


def begun(model, draws=1):
    """A fit at the values a search begins at, which are near enough, and need no search."""
    data = model.prepare(TRAIN)
    starts = model.initial_values(data, 0, draws)
    values = {name: np.stack([s[name] for s in starts])[None] for name in starts[0]}
    stats = {"lp": np.zeros((1, draws))}
    return make_fit(model, TRAIN, data, values, stats, Record("map", {}, 0, 0.0))


@pytest.fixture(scope="module")
def path():
    return begun(PATH, draws=2)


@pytest.fixture(scope="module")
def puppet():
    return fit(VoicePuppetry(12), TRAIN, method=EM(max_steps=30), seed=0)


def off(made):
    return np.sqrt(np.mean((made - FACE) ** 2)) / FACE.std()


def test_both_starts_lead_to_the_face(path):
    for start in ("A", "B"):
        face = audio_to_face(path, TEST, start=start)
        assert off(face.means()) < 0.3
        inside = np.abs(face.means() - FACE) < 1.645 * face.sds()
        assert 0.7 < inside.mean() <= 1.0


def test_every_draw_counts_and_their_order_does_not(path):
    whole = audio_to_face(path, TEST, start="A")
    assert whole.mean.shape[0] == 2
    turned = path.tree.copy()
    posterior = path.tree["posterior"].to_dataset().isel(draw=[1, 0])
    turned["posterior"] = xr.DataTree(posterior)
    again = audio_to_face(Fit(path.model, path.motion, turned), TEST, start="A")
    np.testing.assert_allclose(again.means(), whole.means(), atol=1e-9)
    np.testing.assert_allclose(again.sds(), whole.sds(), atol=1e-9)
    np.testing.assert_allclose(whole.means(), whole.mean.mean(axis=0))
    assert np.abs(whole.mean[0] - whole.mean[1]).max() > 1e-6


def test_the_window_needs_no_search_and_looks_at_no_face():
    window = begun(replace(published("sgplvm_window", 4), every=4))
    face = audio_to_face(window, TEST)
    assert off(face.means()) < 0.3
    lying = TEST.copy(deep=True)
    lying["face"][:] = 0.0
    np.testing.assert_array_equal(audio_to_face(window, lying).means(), face.means())
    same = audio_to_face(window, TEST, start="A")
    np.testing.assert_allclose(same.means(), face.means(), atol=1e-9)


def test_a_puppet_follows_its_sound(puppet):
    face = audio_to_face(puppet, TEST)
    assert off(face.means()) < 0.4
    assert 0.75 < np.mean(np.abs(face.means() - FACE) < 1.645 * face.sds()) <= 1.0
    smooth = puppet_trajectory(puppet, TEST)
    assert off(smooth) < 0.35
    # Smoother than the states' means are.
    assert np.std(np.diff(smooth, n=2, axis=0)) < np.std(np.diff(face.means(), n=2, axis=0))
    clip = sound_clip(puppet, TEST["audio"].values)
    np.testing.assert_allclose(puppet_trajectory(puppet, clip), smooth, atol=1e-9)


def test_what_cannot_be_made_is_refused(path, puppet):
    with pytest.raises(InputError, match="no such view"):
        audio_to_face(path, TEST, face="brow")
    with pytest.raises(InputError, match="no such start"):
        audio_to_face(puppet, TEST, start="A")
    free = begun(SharedGPLVM(latent_size=2, inducing=Inducing(30, above=0)))
    with pytest.raises(InputError, match="no back-constraint"):
        audio_to_face(free, TEST, start="B")
    with pytest.raises(InputError, match="as in training"):
        audio_to_face(path, sound_clip(path, TEST["audio"].values[:, :3]))
    with pytest.raises(InputError, match=r"no trajectory of its own\. Fit voice_puppetry\."):
        puppet_trajectory(path, TEST)
