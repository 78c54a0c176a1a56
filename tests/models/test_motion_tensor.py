"""The motion tensor: its density by hand and by brute force, prediction, leaving out, NaN."""

import dataclasses
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro.infer.util import log_density as of_program
from scipy.special import multigammaln
from scipy.stats import invwishart, multivariate_normal, multivariate_t, norm

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.models.motion_tensor import MotionTensor
from bayesmotion.models.motion_tensor.classes import (
    NewSegmentsT,
    class_log_density,
    scale_matrix,
)
from bayesmotion.models.motion_tensor.data import (
    UNKNOWN,
    NewSegments,
    position_mode,
    tensor_data,
)
from bayesmotion.models.motion_tensor.matrix_t import MatrixT, inverse_wishart_root
from bayesmotion.models.motion_tensor.prediction import SegmentPredictive, repetition
from bayesmotion.motion.segments import Segmenting

LEVEL = np.array([(0, 0), (0, 1), (1, 0), (1, 1), (1, 1), (0, 1), (2, 0)])
COUNTS = (3, 2)
SITES = {"log_odds": 0.4, "log_scale": 0.2, "log_dof": np.log(8.0)}
VALUES = {name: np.asarray(value) for name, value in SITES.items()}
MODEL = MotionTensor()


def small(seed: int = 0, q: int = 2, level=LEVEL):
    y = np.random.default_rng(seed).normal(size=(len(level), q))
    return tensor_data(y, level, COUNTS)


def rows_covariance(level, values=VALUES, sd=10.0):
    """K written out, pair by pair of segments."""
    share = 1 / (1 + np.exp(-values["log_odds"]))
    K = np.zeros((len(level), len(level)))
    for i, a in enumerate(level):
        for j, b in enumerate(level):
            K[i, j] = sd**2 * (1 + (a == b).sum()) + share * (a == b).all() + (1 - share) * (i == j)
    return K


def by_hand(y, level, values=VALUES, sd=10.0):
    """The matrix-t density through slogdet and solve."""
    n, q = y.shape
    nu, scale = np.exp(values["log_dof"]) + q - 1, np.exp(values["log_scale"])
    K = rows_covariance(level, values, sd)
    S = scale * np.eye(q) + y.T @ np.linalg.solve(K, y)
    return (
        -0.5 * q * np.linalg.slogdet(K)[1] - 0.5 * q * n * np.log(np.pi)
        + 0.5 * nu * q * np.log(scale) - 0.5 * (nu + n) * np.linalg.slogdet(S)[1]
        + multigammaln(0.5 * (nu + n), q) - multigammaln(0.5 * nu, q)
    )  # fmt: skip


def test_the_program_has_the_density_written_by_hand():
    data = small()
    found = float(of_program(MODEL.program, (data,), {}, VALUES)[0])
    priors = norm.logpdf(0.4) + norm.logpdf(0.2, 0, 3)
    priors += norm.logpdf(np.log(8.0), np.log(10), 1.5)
    assert found == pytest.approx(by_hand(data.y, LEVEL) + priors, abs=1e-6)


def test_the_density_is_the_average_over_sigma_of_gaussians():
    data = small()
    q = data.y.shape[1]
    K = rows_covariance(LEVEL, sd=1.0)
    draws = invwishart.rvs(8.0 + q - 1, np.exp(0.2) * np.eye(q), size=4000, random_state=1)
    flat = data.y.T.reshape(-1)
    logs = np.array([multivariate_normal.logpdf(flat, cov=np.kron(S, K)) for S in draws])
    top = logs.max()
    weight = np.exp(logs - top)
    expected = top + np.log(weight.mean())
    error = weight.std() / weight.mean() / np.sqrt(len(draws))
    found = float(MatrixT(K, np.exp(0.2), 8.0, q).log_prob(data.y))
    assert abs(found - expected) < 4 * error


def test_draws_have_the_moments_of_the_distribution():
    K = rows_covariance(LEVEL[:3], sd=1.0)
    y = np.asarray(MatrixT(K, 2.0, 8.0, 2).sample(jax.random.key(0), (4000,)))
    assert y.shape == (4000, 3, 2)
    # E[Sigma] = scale / (dof - 2).
    products = np.einsum("sij,skl->sijkl", y, y).reshape(4000, -1)
    expected = np.einsum("ik,jl->ijkl", K, np.eye(2) * 2.0 / 6.0).reshape(-1)
    error = products.std(axis=0) / np.sqrt(4000)
    assert np.abs((products.mean(axis=0) - expected) / error).max() < 4.5


def test_a_root_of_sigma_is_that_of_an_inverse_wishart_matrix():
    keys = jax.random.split(jax.random.key(0), 4000)
    root = jax.vmap(lambda key: inverse_wishart_root(key, jnp.array(2.0), jnp.array(5.0), 2))(keys)
    precision = np.linalg.inv(np.asarray(root @ root.transpose(0, 2, 1)))
    # Wishart with 5 degrees of freedom and scale I / 2.
    errors = precision.std(axis=0) / np.sqrt(len(keys))
    assert np.abs((precision.mean(axis=0) - 2.5 * np.eye(2)) / errors).max() < 3.5
    assert np.var(precision[:, 0, 1]) == pytest.approx(5.0 / 4.0, rel=0.1)


def test_pointwise_is_the_density_with_the_segment_less_the_density_without_it():
    data = small(4, q=3)
    found = np.asarray(MODEL.pointwise(data, VALUES))
    for n in range(len(LEVEL)):
        rest = np.arange(len(LEVEL)) != n
        expected = by_hand(data.y, LEVEL) - by_hand(data.y[rest], LEVEL[rest])
        assert found[n] == pytest.approx(expected, abs=1e-6)


def test_a_density_of_known_levels_is_the_ratio_of_two_marginals():
    data, new = small(3), np.array([[0.4, -0.7]])
    trained = MODEL.condition(data, VALUES)
    segments = NewSegments(new, None, np.full((1, 2), UNKNOWN))
    found = np.asarray(class_log_density(trained, segments))[0]
    grid = np.asarray(data.class_level)
    for cell in ((0, 1), (2, 1), (1, 0)):
        row = int(np.flatnonzero((grid == cell).all(axis=1))[0])
        more = np.concatenate([data.y, new])
        ratio = by_hand(more, np.vstack([LEVEL, cell])) - by_hand(data.y, LEVEL)
        assert found[row] == pytest.approx(ratio, abs=1e-5)
        given = segments._replace(level=np.array([cell]))
        assert float(NewSegmentsT(trained, given).log_prob(new)[0]) == pytest.approx(
            ratio, abs=1e-5
        )


def test_of_a_new_level_the_density_is_a_t_with_the_scatter_of_the_known_ones():
    data = small(7, q=3)
    trained = MODEL.condition(data, VALUES)
    y = np.array([[0.3, -0.2, 0.8]])
    found = np.asarray(class_log_density(trained, NewSegments(y, None, np.full((1, 2), -1))))[0]
    q, dof = 3, float(trained.dof)
    for c, level in enumerate(np.asarray(data.class_level)):
        M = np.asarray(scale_matrix(trained, c))
        gap = y[0] - np.asarray(trained.mean)[c]
        expected = multivariate_t.logpdf(gap, shape=M / dof, df=dof)
        assert found[c] == pytest.approx(expected, abs=1e-6), level
    K = rows_covariance(LEVEL)
    design = np.asarray(data.design)
    effects = 100.0 * design.T @ np.linalg.solve(K, data.y)
    d = effects[1:4] - effects[1:4].mean(axis=0)
    c = int(np.flatnonzero((np.asarray(data.class_level) == (3, 0)).all(axis=1))[0])
    S = np.exp(0.2) * np.eye(q) + data.y.T @ np.linalg.solve(K, data.y)
    extra = (d.T @ d + 2.0 * S / (dof - 2.0)) / (3 + 1)
    found_scale = np.asarray(scale_matrix(trained, c)) / dof
    beside = found_scale - extra
    np.testing.assert_allclose(beside / beside[0, 0], S / S[0, 0], rtol=1e-5)


def test_unknown_labels_are_averaged_over_levels_and_a_new_one():
    data = small(3)
    trained = MODEL.condition(data, VALUES)
    y = np.array([[0.4, -0.7], [0.0, 1.0]])
    each = np.asarray(class_log_density(trained, NewSegments(y, None, np.full((2, 2), UNKNOWN))))
    half = NewSegments(y, None, np.array([(UNKNOWN, 1), (UNKNOWN, UNKNOWN)]))
    found = np.asarray(NewSegmentsT(trained, half).log_prob(y))
    of_task = np.asarray(data.class_level)[:, 1] == 1
    assert found[0] == pytest.approx(np.log(np.exp(each[0, of_task]).mean()))
    assert found[1] == pytest.approx(np.log(np.exp(each[1]).mean()))


def test_what_is_not_seen_is_integrated_out():
    """Along seen directions the density is that of the rotated, cut t variable."""
    data = small(5, q=3)
    trained = MODEL.condition(data, VALUES)
    random = np.random.default_rng(0)
    V = np.linalg.qr(random.normal(size=(3, 2)))[0]
    y = random.normal(size=3)
    level = np.array([[1, 0]])
    part = NewSegments((V @ V.T @ y)[None], (V @ V.T)[None], level)
    found = np.asarray(class_log_density(trained, part))[0]
    dof = float(trained.dof)
    for c in range(len(found)):
        M = V.T @ np.asarray(scale_matrix(trained, c)) @ V
        expected = multivariate_t.logpdf(
            V.T @ (y - np.asarray(trained.mean)[c]), shape=M / dof, df=dof
        )
        assert found[c] == pytest.approx(expected, abs=1e-6)
    nothing = NewSegments(np.zeros((1, 3)), np.zeros((1, 3, 3)), level)
    np.testing.assert_allclose(np.asarray(class_log_density(trained, nothing)), 0.0, atol=1e-6)


def test_a_prediction_is_the_conditional_of_a_joint_gaussian_where_sigma_is_known():
    """With many degrees of freedom the t variables are Gaussian: brute force by blocks."""
    data = small(6, q=3)
    sites = {"log_odds": 0.3, "log_scale": np.log(1e7), "log_dof": np.log(1e7)}
    values = {name: np.asarray(value) for name, value in sites.items()}
    trained = MODEL.condition(data, values)
    random = np.random.default_rng(1)
    y = random.normal(size=3)
    V = np.linalg.qr(random.normal(size=(3, 2)))[0]
    share = 1 / (1 + np.exp(-0.3))
    c = 1
    M, S = (np.asarray(m) / float(trained.dof) for m in (scale_matrix(trained, c), trained.matrix))
    cross = M - (1 - share) * S
    gain = cross @ V @ np.linalg.inv(V.T @ M @ V)
    mean = np.asarray(trained.mean)[c]
    found = repetition(trained, V @ V.T @ y, V @ V.T, c)
    np.testing.assert_allclose(found.mean, mean + gain @ V.T @ (y - mean), atol=1e-5)
    expected = M - gain @ V.T @ cross
    np.testing.assert_allclose(np.asarray(found.matrix) / float(found.dof), expected, rtol=1e-4)


def test_moments_and_marginals_and_draws_agree():
    data = small(8)
    trained = MODEL.condition(data, VALUES)
    new = NewSegments(np.zeros((2, 2)), np.zeros((2, 2, 2)), np.array([(1, 1), (UNKNOWN, 0)]))
    each = MODEL.predict(trained, new, {})["y"]
    assert isinstance(each, SegmentPredictive)
    keys = jax.random.split(jax.random.key(0), 6000)
    drawn = np.asarray(jax.vmap(each.sample)(keys))
    error = drawn.std(axis=0) / np.sqrt(len(drawn))
    assert np.abs((drawn.mean(axis=0) - np.asarray(each.mean)) / error).max() < 4.5
    entries = jax.vmap(each.marginals)(keys)
    means = np.asarray(entries.mean)
    total = np.asarray(entries.variance).mean(axis=0) + means.var(axis=0)
    np.testing.assert_allclose(total, np.asarray(each.variance), rtol=0.15)
    np.testing.assert_allclose(drawn.var(axis=0), np.asarray(each.variance), rtol=0.25)


def test_gradient_is_that_of_finite_differences():
    data = small(5)
    names = list(VALUES)

    @jax.jit
    def f(v):
        return of_program(MODEL.program, (data,), {}, dict(zip(names, v, strict=True)))[0]

    at = np.array([0.2, 0.1, 1.7])
    gradient = np.asarray(jax.grad(f)(jnp.asarray(at)))
    for i in range(3):
        step = np.zeros(3)
        step[i] = 1e-5
        expected = float(f(at + step) - f(at - step)) / 2e-5
        assert gradient[i] == pytest.approx(expected, rel=1e-4)


def test_wide_effects_leave_one_segment_a_cell_without_news_of_the_share():
    level = np.array([(i, j) for i in range(3) for j in range(3)])
    y = np.random.default_rng(0).normal(size=(9, 2))

    def gap(sd, level, y):
        values = [{**VALUES, "log_odds": odds} for odds in (-2.0, 2.0)]
        return abs(by_hand(y, level, values[0], sd) - by_hand(y, level, values[1], sd))

    assert gap(1000.0, level, y) < 1e-4 < 0.1 < gap(1000.0, LEVEL, y[:7])


@pytest.fixture(scope="module")
def example():
    return MotionTensor.example(0)


def test_a_clip_of_which_nothing_is_seen_is_dropped(example):
    model, clips = example
    away = clips["clip"].values == "ann-bow-1"
    hidden = clips.copy(deep=True)
    hidden["angle"][np.flatnonzero(away)] = np.nan
    with pytest.warns(MotionWarning, match="left out"):
        found = model.prepare(hidden)
    dropped = model.prepare(clips.isel(frame=~away))
    np.testing.assert_allclose(found.tensor.y, dropped.tensor.y)
    assert found.segments["clip"].values.tolist() == dropped.segments["clip"].values.tolist()


def test_gaps_of_a_clip_change_its_coordinates_little(example):
    model, clips = example
    training = model.prepare(clips)
    rows = np.flatnonzero(clips["clip"].values == "ann-bow-1")
    hidden = clips.copy(deep=True)
    hidden["angle"][rows[10:14]] = np.nan
    right = [d for d in clips["dof"].values.tolist() if d.startswith("rhumerus")]
    hidden["angle"].loc[{"dof": right}] = (
        hidden["angle"].sel(dof=right).where(hidden["clip"] != "ben-wave-0")
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        new = model.prepare(hidden, training)
    whole = np.asarray(training.tensor.y)
    y, seen = np.asarray(new.new.y), np.asarray(new.new.seen)
    clip = training.segments["clip"].values.tolist()
    gap = clip.index("ann-bow-1")
    assert np.abs(y[gap] - whole[gap]).max() < 0.05 * np.abs(whole).max()
    limb = clip.index("ben-wave-0")
    # What is seen of it is told right; of what is not the prediction knows less.
    np.testing.assert_allclose(y[limb], seen[limb] @ whole[limb], atol=0.35)
    assert np.isfinite(y).all()


def test_labels_of_new_clips_are_known_new_or_unknown(example):
    model, clips = example
    training = model.prepare(clips)
    renamed = clips.assign_coords(
        subject=clips["subject"].str.replace("ann", "zoe"),
        task=("frame", np.where(clips["task"].values == "bow", "", clips["task"].values)),
    )
    level = np.asarray(model.prepare(renamed, training).new.level)
    names = training.segments["clip"].values
    assert level[list(names).index("ann-bow-0")].tolist() == [3, UNKNOWN]
    assert level[list(names).index("ben-wave-0")].tolist() == [1, 1]
    no_task = model.prepare(clips.drop_vars("task"), training)
    assert (np.asarray(no_task.new.level)[:, 1] == UNKNOWN).all()


def test_every_setting_changes_the_density(example):
    model, clips = example
    changed = {
        "modes": ("task", "subject", "clip_group"),
        "rank": 3,
        "effect_sd": 3.0,
        "segmenting": Segmenting("rotations", coefficients=2),
    }
    grouped = clips.assign_coords(clip_group=clips["clip"].str.slice(-1))

    def density(one):
        return float(of_program(one.program, one.prepare(grouped).data, {}, VALUES)[0])

    first = density(model)
    for name, value in changed.items():
        assert abs(density(dataclasses.replace(model, **{name: value})) - first) > 1e-3, name


def test_bad_settings_and_labels_are_refused(example):
    model, clips = example
    with pytest.raises(InputError, match="two modes"):
        MotionTensor(("subject",))
    with pytest.raises(InputError, match="effect_sd"):
        MotionTensor(effect_sd=0.0)
    with pytest.raises(InputError, match="unknown for some clip"):
        model.prepare(clips.drop_vars("task"))
    assert position_mode(np.random.default_rng(0).normal(size=(5, 9)), 2).basis.shape == (9, 2)
