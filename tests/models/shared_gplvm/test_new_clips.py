"""New clips of the shared model: predictions, frames left out, starts and symmetries."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from bayesmotion.errors import InputError
from bayesmotion.fit import load
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.methods import MAP, fit
from bayesmotion.inference.predicting import predict
from bayesmotion.models.shared_gplvm import MLP, BackConstraint, Inducing, SharedGPLVM
from bayesmotion.models.shared_gplvm.initial_values import likeliest_path
from bayesmotion.models.shared_gplvm.processes import StepwisePath, view_kernel, view_points
from bayesmotion.motion.synthetic.talk import synthetic_talk

FREE = SharedGPLVM(latent_size=2)
MAPPED = replace(FREE, back=BackConstraint(map=MLP(hidden=4)))
SPARSE = replace(MAPPED, inducing=Inducing(12, above=0))


def talk(seed=0, clips=2, frames=10):
    data = synthetic_talk(seed, clips=clips, frames=frames)
    if seed == 0:
        data["face"][4:6, 1] = np.nan
    return data


def trained_of(model):
    data = model.prepare(talk())
    values = model.initial_values(data, 0, 1)[0]
    return data, values, model.condition(data.frames, values)


def joint(values, name, x, both):
    """Covariance of all frames, old and new, of a view."""
    points = view_points(name, values, np.concatenate([x, both]), {})
    return np.asarray(view_kernel(name, values).matrix(points, points))


def test_predictions_are_the_conditional_of_one_joint_normal():
    data, values, trained = trained_of(FREE)
    new = talk(1, clips=1, frames=5)
    new["face"][1:, :] = np.nan
    new["face"][3, 2] = 4.0
    prepared = FREE.prepare(new, data)
    own = FREE.initial_values(prepared, 0, 1, trained)[0]
    found = FREE.predict(trained, prepared.frames, own)
    y_old, y_new = data.frames.y["face"], prepared.frames.y["face"]
    K, beta = joint(values, "face", values["x"], own["x"]), values["face_beta"]
    for d in range(3):
        y = np.concatenate([y_old[:, d], y_new[:, d]])
        seen = np.flatnonzero(~np.isnan(y))
        gain = K[20:][:, seen] @ np.linalg.inv(K[np.ix_(seen, seen)] + np.eye(len(seen)) / beta)
        np.testing.assert_allclose(found["face"].mean[:, d], gain @ y[seen], atol=1e-6)
        variance = np.diag(K[20:, 20:] - gain @ K[seen][:, 20:]) + 1.0 / beta
        np.testing.assert_allclose(found["face"].variance[:, d], variance, atol=1e-6)


def test_the_program_of_new_clips_is_the_conditional_density():
    data, values, trained = trained_of(FREE)
    new = talk(1, clips=1, frames=4).drop_vars("face")
    prepared = FREE.prepare(new, data)
    own = FREE.initial_values(prepared, 0, 1, trained)[0]
    density = ProgramDensity(FREE)
    arguments = (*prepared.data, trained)
    found = float(density(density.real(own, arguments), arguments))
    x, z = values["x"], own["x"]

    def steps(path, firsts):
        after = np.setdiff1d(np.arange(len(path)), firsts)
        before = path[after - 1]
        squares = ((before[:, None] - before) ** 2).sum(axis=2)
        alpha = values["alpha"]
        K = alpha[0] * np.exp(-0.5 * alpha[1] * squares) + alpha[2] * before @ before.T
        K = K + 0.3**2 * np.eye(len(K))
        return sum(multivariate_normal(np.zeros(len(K)), K).logpdf(q) for q in path[after].T)

    expected = norm.logpdf(z[0]).sum()
    expected += steps(np.concatenate([x, z]), [0, 10, 20]) - steps(x, [0, 10])
    K = joint(values, "audio", x, z) + np.eye(24) / values["audio_beta"]
    y = np.concatenate([data.frames.y["audio"], prepared.frames.y["audio"]])
    for d in range(4):
        expected += multivariate_normal(np.zeros(24), K).logpdf(y[:, d])
        expected -= multivariate_normal(np.zeros(20), K[:20, :20]).logpdf(y[:20, d])
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.thorough
def test_densities_made_through_inducing_points_are_of_every_entry_by_itself():
    data, _, trained = trained_of(SPARSE)
    new = talk(1, clips=1, frames=4)
    new["face"][2, 1] = np.nan
    prepared = SPARSE.prepare(new, data)
    own = SPARSE.initial_values(prepared, 0, 1, trained)[0]
    density, arguments = ProgramDensity(SPARSE), (*prepared.data, trained)
    slope = jax.grad(density)(density.real(own, arguments), arguments)
    assert np.isfinite(slope["x"]).all()
    path = StepwisePath(trained.steps, prepared.frames.steps, (4, 2))
    unit = (own["x"] - trained.mean) / trained.scale
    expected = float(path.log_prob(unit)) - 8.0 * np.log(float(trained.scale))
    for name in ("audio", "face"):
        points = view_points(name, trained.values, own["x"], {})
        mean, variance = trained.views[name](points)
        # In training the second column of the face misses rows, the others do not.
        columns = np.argmax(data.frames.missing[name].columns, axis=0)
        sd = np.sqrt(np.asarray(variance)[columns].T + 1.0 / trained.values[f"{name}_beta"])
        expected += np.nansum(norm.logpdf(np.asarray(prepared.frames.y[name]), mean, sd))
    assert float(density(density.real(own, arguments), arguments)) == pytest.approx(expected)


def test_frames_left_out_are_the_quotient_of_two_densities():
    data, values, _ = trained_of(FREE)
    found = FREE.pointwise(data.frames, values)
    total = np.zeros(20)
    for name in ("audio", "face"):
        K = joint(values, name, values["x"], values["x"][:0])
        K = K + np.eye(20) / values[f"{name}_beta"]
        for column in np.asarray(data.frames.y[name]).T:
            seen = np.flatnonzero(~np.isnan(column))
            whole = multivariate_normal(np.zeros(len(seen)), K[np.ix_(seen, seen)])
            for i in seen:
                rest = seen[seen != i]
                without = multivariate_normal(np.zeros(len(rest)), K[np.ix_(rest, rest)])
                total[i] += whole.logpdf(column[seen]) - without.logpdf(column[rest])
    np.testing.assert_allclose(found, total, rtol=1e-6)
    sparse, values, _ = trained_of(SPARSE)
    with pytest.raises(InputError, match="leaves no frame out"):
        SPARSE.pointwise(sparse.frames, values)


def test_identified_quantities_are_the_same_however_latent_points_are_turned():
    equal = replace(FREE, relevance=False)
    data, values, _ = trained_of(equal)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    other = {**values, "x": values["x"] @ turn}
    assert equal.rotations == ("x",)
    assert FREE.rotations == ()
    first, second = (equal.identified(data.frames, v) for v in (values, other))
    coords = equal.coords(data)
    for name, value in first.items():
        np.testing.assert_allclose(second[name], value, rtol=1e-9)
        assert tuple(len(coords[dim]) for dim in equal.dims()[name]) == np.shape(value)
    density = ProgramDensity(equal)
    heights = [float(density(density.real(v, data.data), data.data)) for v in (values, other)]
    assert heights[0] == pytest.approx(heights[1], rel=1e-9)


def test_new_paths_start_at_the_map_and_at_the_likeliest_training_points():
    for model in (MAPPED, SPARSE):
        data, _, trained = trained_of(model)
        new = model.prepare(talk(1).drop_vars("face"), data)
        first, second = model.initial_values(new, 0, 2, trained)
        made = model.mapped(new.frames.inputs, trained.centres, trained.values)[0]
        np.testing.assert_array_equal(first["x"], made)
        among = (second["x"][:, None] == np.asarray(trained.values["x"])).all(axis=2).any(axis=1)
        assert among.all()


def test_viterbi_against_all_paths():
    random = np.random.default_rng(0)
    emission, transition = random.normal(size=(5, 3)), random.normal(size=(3, 3))
    best, height = None, -np.inf
    for path in np.ndindex(*[3] * 5):
        here = sum(emission[t, s] for t, s in enumerate(path))
        here += sum(transition[path[t], path[t + 1]] for t in range(4))
        if here > height:
            best, height = path, here
    assert tuple(likeliest_path(emission, transition)) == best


def test_stepwise_paths_are_drawn_as_their_density_says():
    data, _, trained = trained_of(SPARSE)
    path = StepwisePath(trained.steps, data.frames.steps, (20, 2))
    draws = np.asarray(path.sample(jax.random.key(0), (4000,)))
    assert np.abs(draws[:, [0, 10]].mean(axis=0)).max() < 4.0 / np.sqrt(4000)
    mean, variance = trained.steps({"x": jnp.asarray(draws[:, 3])})
    white = (draws[:, 4] - mean) / np.sqrt(variance[0] + 0.09)[:, None]
    assert np.abs(white.mean(axis=0)).max() < 4.0 / np.sqrt(4000)
    assert np.abs((white**2).mean(axis=0) - 1.0).max() < 4.0 * np.sqrt(2.0 / 4000)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the fit stopped")
def test_a_fit_predicts_a_face_from_sound_and_is_loaded_to_the_last_bit(tmp_path):
    recordings = synthetic_talk(0, clips=3, frames=16)
    training, test = recordings.isel(frame=slice(0, 32)), recordings.isel(frame=slice(32, 48))
    trained = fit(replace(FREE, relevance=False), training, method=MAP(1, 1, 150), seed=0)
    trained.save(tmp_path / "fit.nc")
    heard = test.drop_vars("face")
    made = predict(trained, heard).site("face")
    off = made.means() - test["face"].values
    assert np.sqrt(np.mean(off**2)) < 0.4 * test["face"].values.std()
    again = predict(load(tmp_path / "fit.nc"), heard).site("face")
    np.testing.assert_array_equal(again.means(), made.means())
