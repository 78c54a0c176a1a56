"""The shared model's density written out, what is missing, and what is no density."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest
from numpyro import handlers
from scipy.stats import lognorm, multivariate_normal, norm

from bayesmotion.distributions.dynamics import GPDynamics
from bayesmotion.errors import InputError
from bayesmotion.inference.densities import require_densities
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.model import draw_sites
from bayesmotion.models.shared_gplvm import (
    MLP,
    BackConstraint,
    ContextWindow,
    Dynamics,
    Identity,
    Inducing,
    Linear,
    SharedGPLVM,
)
from bayesmotion.models.shared_gplvm.published import PUBLISHED, published
from bayesmotion.motion.synthetic.talk import synthetic_talk
from bayesmotion.registry import build_model, describe_model

FREE = SharedGPLVM(latent_size=2)
MAPPED = replace(FREE, back=BackConstraint(map=MLP(hidden=4)))


def talk(seed=0, **sizes):
    return synthetic_talk(seed, **{"frames": 10, **sizes})


@partial(jax.jit, static_argnums=0)
def density_at(model, data, values):
    density = ProgramDensity(model)
    return density(density.real(values, data), data)


def height(model, data, values):
    return float(density_at(model, data.data, values))


drawn_sites = jax.jit(draw_sites, static_argnums=0)


def somewhere(model, data, seed=1):
    """Values of the unobserved sites, drawn from their priors."""
    drawn = drawn_sites(model, jax.random.key(seed), data.frames)
    values = model.initial_values(data, 0, 1)[0]
    return {name: np.asarray(drawn[name]) for name in values}


def covariance(x, values, name):
    scaled = x * np.sqrt(values[f"{name}_gamma"])
    squares = ((scaled[:, None] - scaled) ** 2).sum(axis=2)
    K = values[f"{name}_variance"] * np.exp(-0.5 * squares)
    K = K + values[f"{name}_linear"] * scaled @ scaled.T
    return K + np.eye(len(x)) / values[f"{name}_beta"]


def by_hand(data, values, size):
    """Log density of the free model, with numpy and scipy, one entry pattern at a time."""
    x, alpha, steps = values["x"], values["alpha"], data.frames.steps
    total = norm.logpdf(x[steps.first]).sum()
    before, after = x[steps.before], x[steps.after]
    squares = ((before[:, None] - before) ** 2).sum(axis=2)
    K = alpha[0] * np.exp(-0.5 * alpha[1] * squares) + alpha[2] * before @ before.T
    K = K + 0.3**2 * np.eye(len(K))
    total += sum(multivariate_normal(np.zeros(len(K)), K).logpdf(q) for q in after.T)
    total += lognorm.logpdf(alpha, 1.0, scale=[0.1, 1.0, 0.1]).sum()
    for name in ("audio", "face"):
        K = covariance(x, values, name)
        for column in np.asarray(data.frames.y[name]).T:
            seen = np.flatnonzero(~np.isnan(column))
            part = multivariate_normal(np.zeros(len(seen)), K[np.ix_(seen, seen)])
            total += part.logpdf(column[seen])
        medians = {"variance": 1.0, "linear": 0.1, "gamma": 1.0 / size, "beta": 5.0}
        for part, median in medians.items():
            total += np.sum(lognorm.logpdf(values[f"{name}_{part}"], 1.0, scale=median))
    return total


def test_the_default_is_the_density_written_out_and_marginalises_what_is_missing():
    whole = talk()
    holes = whole.copy(deep=True)
    holes["face"][3, 1] = holes["face"][12:15] = np.nan
    holes["audio"][5, :2] = np.nan
    for recordings in (whole, holes):
        data = FREE.prepare(recordings)
        values = somewhere(FREE, data)
        # Coordinates are relevant in their own ways: one gamma each.
        assert values["face_gamma"].shape == (2,)
        assert height(FREE, data, values) == pytest.approx(by_hand(data, values, 2), rel=1e-6)


def test_dynamics_of_a_map_are_those_of_its_path_at_unit_scale():
    data = MAPPED.prepare(talk())
    values = MAPPED.initial_values(data, 0, 1)[0]
    without = {name: value for name, value in values.items() if name != "alpha"}
    plain = replace(MAPPED, dynamics=None)
    mapped = jax.jit(lambda values: MAPPED.mapped(data.frames.inputs, data.frames.centres, values))
    x = np.asarray(mapped(values)[0])
    x = x - x.mean(axis=0)
    x = x / np.sqrt(np.mean(x**2))
    alpha = np.append(values["alpha"], 0.3**-2)
    path = jax.jit(lambda x: GPDynamics(alpha, data.frames.steps, x.shape).log_prob(x))(x)
    prior = lognorm(1.0, scale=[0.1, 1.0, 0.1]).logpdf(values["alpha"])
    found = height(MAPPED, data, values) - height(plain, data, without)
    assert found == pytest.approx(float(path + prior.sum()), rel=1e-6)


def test_inducing_points_at_all_frames_are_exact_and_fewer_bound_it():
    # Of one clip without dynamics: of dynamics all steps hold inducing points as well.
    holes = talk()
    holes["face"][3:6, 1] = np.nan
    for model in (FREE, MAPPED):
        data = model.prepare(holes)
        values = somewhere(model, data) if model is FREE else model.initial_values(data, 0, 1)[0]
        found = []
        for points in (4, 100):
            sparse = replace(model, inducing=Inducing(points, above=0))
            found.append(height(sparse, sparse.prepare(holes), values))
        exact = height(replace(model, inducing=None), data, values)
        assert found[0] < exact
        assert found[1] == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize(
    ("model", "what"),
    [(MAPPED, "of the very data"),
     (replace(FREE, inducing=Inducing(5, above=10)), "bound|improper"),
     (replace(MAPPED, inducing=Inducing(5, above=10)), "bound|of the very data")],
)  # fmt: skip
def test_what_is_no_density_is_refused_and_the_default_is_not(model, what):
    data, free = model.prepare(talk()), FREE.prepare(talk())
    require_densities(handlers.seed(FREE.program, 0), free.data)
    values = model.initial_values(data, 0, 1)[0]
    started = {name: value for name, value in values.items() if name == "x"}
    program = handlers.seed(handlers.substitute(model.program, data=started), 0)
    with pytest.raises(InputError, match=what):
        require_densities(program, data.data)
    # Of few frames processes are exact whatever the inducing points.
    assert model.prepare(talk(frames=5)).frames.exact


def test_prior_draws_are_finite():
    data = SharedGPLVM(private=(1, 2)).prepare(talk())
    drawn = drawn_sites(SharedGPLVM(private=(1, 2)), jax.random.key(3), data.frames)
    assert drawn["audio_private"].shape == (20, 1)
    assert drawn["face_private"].shape == (20, 2)
    assert all(np.isfinite(value).all() for value in drawn.values())


def test_three_views_share_one_path():
    data = talk()
    data["brow"] = (("frame", "brow_feature"), data["face"].values[:, :2] ** 2)
    data = data.assign_coords(brow_feature=["l", "r"])
    model = replace(FREE, views=("audio", "face", "brow"))
    prepared = model.prepare(data)
    values = model.initial_values(prepared, 0, 1)[0]
    trained = jax.eval_shape(model.condition, prepared.frames, values)
    assert set(trained.views) == {"audio", "face", "brow"}
    assert np.isfinite(height(model, prepared, values))


def test_every_other_frame_is_explained_with_windows_of_all():
    every = replace(MAPPED, back=replace(MAPPED.back, window=ContextWindow(2)))
    whole, some = every.prepare(talk()), replace(every, every=3).prepare(talk())
    kept = np.r_[0:10:3, 10:20:3]
    np.testing.assert_array_equal(some.frames.kept, kept)
    np.testing.assert_array_equal(some.frames.inputs, whole.frames.inputs)
    assert some.observed()["face"].shape == (8, 3)
    assert list(some.frames.steps.first) == [0, 4]
    with pytest.raises(InputError, match="every: it is 10"):
        replace(every, every=10).prepare(talk())
    # New clips are told frame by frame, and the trained model rests on all frames.
    model = replace(every, every=3)
    values = model.initial_values(some, 0, 1)[0]
    trained = jax.eval_shape(model.condition, some.frames, values)
    assert trained.values["x"].shape == (20, 2)
    assert len(model.prepare(talk(1), some).frames.kept) == 20


OTHER = {
    "views": ("face", "audio"), "latent_size": 3, "private": (1, 0),
    "back": BackConstraint(map=Linear()), "relevance": False, "dynamics": Dynamics(0.5),
    "inducing": Inducing(5, above=3), "every": 2,
}  # fmt: skip


@pytest.mark.parametrize("name", OTHER)
def test_every_setting_changes_something(name):
    model = replace(FREE, **{name: OTHER[name]})
    tried = []
    for one in (FREE, model):
        data = one.prepare(talk())
        tried.append((one, data, one.initial_values(data, 0, 1)[0]))
    sites = [[*values] for _, _, values in tried]
    if sites[0] == sites[1]:
        heights = [height(*one) for one in tried]
        assert heights[0] != pytest.approx(heights[1], rel=1e-9)


def test_settings_come_back_from_plain_values():
    for model in (*PUBLISHED.values(), FREE, SharedGPLVM(dynamics=None, inducing=None)):
        assert build_model(describe_model(model), "here") == model
    window = published("sgplvm_window", 4)
    assert window.latent_size == 68
    assert window.back is not None
    assert isinstance(window.back.map, Identity)


def test_data_that_are_no_views_are_refused():
    data = talk()
    with pytest.raises(InputError, match="no such view"):
        FREE.prepare(data.drop_vars("face"))
    with pytest.raises(InputError, match="in pieces"):
        FREE.prepare(data.isel(frame=np.r_[0:5, 10:15, 5:10]))
    never = data.copy(deep=True)
    never["face"][:, 1] = np.nan
    with pytest.raises(InputError, match="never seen"):
        FREE.prepare(never)
    with pytest.raises(InputError, match="as in training"):
        FREE.prepare(data.isel(coordinate=[0, 1]), FREE.prepare(data))
    with pytest.raises(InputError, match="it is no view"):
        SharedGPLVM(back=BackConstraint("sound"))
    with pytest.raises(InputError, match="one number a view"):
        SharedGPLVM(private=(1,))
