"""The multifactor program against densities and predictions written out by hand."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
from scipy.special import logsumexp
from scipy.stats import chi, gamma, halfnorm, lognorm, multivariate_normal, multivariate_t, norm

from bayesmotion.distributions.circle import circle
from bayesmotion.distributions.styles import entries_of, styles_of
from bayesmotion.errors import InputError
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.models.multifactor import OU, Circle, Factor, GPDynamics, Multifactor, White
from bayesmotion.models.multifactor.data import prepare
from bayesmotion.models.multifactor.frames import frames_of
from bayesmotion.models.multifactor.settings import SUBJECT_AND_GAIT
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

# Frames a second of the tiny problem.
RATE = 12.0

CONTENTS = (Circle(), GPDynamics(), GPDynamics(balanced=True))
NAMES = ("circle", "gp", "balanced")
CASES = {
    "circle": (Circle(), White()),
    "gp": (GPDynamics(2), White()),
    "first order": (GPDynamics(2, order=1, noise_sd=0.05), White()),
    "balanced": (GPDynamics(2, noise_sd=0.05, balanced=True), White()),
    "own residuals": (Circle(), OU()),
    "learned pace": (Circle("learned"), OU()),
    "common": (Circle(), OU(per_clip=False)),
}
CLIPS = {"one": range(5), "two": range(5, 9), "new": range(9, 13)}


@jax.jit
def _log_density(static, values, frames, trained):
    return numpyro.infer.util.log_density(static.value.program, (frames, trained), {}, values)[0]


@jax.tree_util.register_static
class Static:
    """A model, told apart by its settings."""

    def __init__(self, value):
        self.value = value

    def __hash__(self):
        return hash(self.value)

    def __eq__(self, other):
        return self.value == other.value


def log_density(model, values, frames, trained=None) -> float:
    return float(_log_density(Static(model), values, frames, trained))


def styles_by_hand(model, values, new) -> dict[str, np.ndarray]:
    """Style vectors of all levels, from the free entries of their shape."""
    out = {}
    for factor in model.factors:
        if factor.kind == "rbf":
            styles = np.asarray(values[f"style_{factor.name}"])
        else:
            entries = np.asarray(values[f"shape_{factor.name}"])
            styles = np.zeros((2, factor.size))
            styles[0, 0], styles[1, :2] = 1.0, (entries[0], np.exp(entries[1]))
            if new and f"style_{factor.name}" in values:
                styles = np.concatenate([styles, values[f"style_{factor.name}"]])
        out[factor.name] = styles
    return out


def phases_by_hand(values) -> np.ndarray:
    """Phases of all clips; the first one's is zero."""
    points = np.asarray(values["phase_point"])
    return np.concatenate([[0.0], np.arctan2(points[:, 1], points[:, 0])])


def log_t(x, freedom, scale) -> float:
    """Log density of a multivariate t with independent directions."""
    return float(multivariate_t(np.zeros(x.size), scale**2 * np.eye(x.size), freedom).logpdf(x))


def shapes_by_hand(model, values) -> float:
    """Log density of two levels' shapes, and of a new level given them.

    Z_21 and Z_22 over chi variables: s_1 has length a ~ chi_S, Z_21 ~ N(0, 1 / a^2) and
    Z_22 ~ chi_(S-1) / a, integrated over a on a fine grid.
    """
    total = 0.0
    a = np.linspace(1e-6, 12.0, 40001)
    for factor in model.factors:
        entries = np.asarray(values[f"shape_{factor.name}"])
        size, diagonal = factor.size, np.exp(entries[1])
        density = chi(size).pdf(a) * norm(0, 1 / a).pdf(entries[0])
        density = density * chi(size - 1).pdf(diagonal * a) * a * diagonal
        total += np.log(np.trapezoid(density, a))
        later = values.get(f"style_{factor.name}")
        if later is not None:
            square = 1.0 + entries[0] ** 2 + diagonal**2
            freedom = 2 * size
            total += log_t(np.ravel(later), freedom, np.sqrt(square / freedom))
    return total


def ring_by_hand(values) -> float:
    """Log density of the phases' points: uniform direction, length near one."""
    length = np.linalg.norm(values["phase_point"], axis=1)
    return float(np.sum(lognorm(0.1).logpdf(length) - np.log(2 * np.pi * length)))


def styles_and_content(model, values, clips) -> list[dict[str, np.ndarray]]:
    """Factors of every frame; levels in the order of the tiny problem."""
    level = {"one": {"subject": 0, "gait": 0}, "two": {"subject": 1, "gait": 1}}
    level["new"] = {"subject": 2, "gait": 1}
    out, first = [], 0
    x = np.zeros(1)
    if "x" in values:
        x = np.asarray(values["x"]) - movement(values["x"], clips)
        x = x + movement(values["x"], clips) / rms(movement(values["x"], clips))
    styles = styles_by_hand(model, values, "new" in clips)
    for place, clip in enumerate(clips):
        n = len(CLIPS[clip])
        for t in range(n):
            point = {f.name: styles[f.name][level[clip][f.name]] for f in model.factors}
            point |= {"clip": place, "time": t}
            if model.on_circle:
                angle = phases_by_hand(values)[place] + values["step"][place] * (t - (n - 1) / 2)
                point["content"] = np.array([np.cos(angle), np.sin(angle)])
            else:
                point["content"] = x[first + t]
            out.append(point)
        first += n
    return out


def covariance(model, values, points) -> np.ndarray:
    """Wang, Fleet and Hertzmann (2007), eq. 15, without the white noise and for w = 1."""
    K = np.empty((len(points), len(points)))
    for i, a in enumerate(points):
        for j, b in enumerate(points):
            K[i, j] = np.exp(
                -0.5 * float(values["gamma"]) * np.sum((a["content"] - b["content"]) ** 2)
            )
            for factor in model.factors:
                K[i, j] *= a[factor.name] @ b[factor.name]
            if model.residual != White() and a["clip"] == b["clip"]:
                which = a["clip"] if model.per_clip else 0
                apart = abs(a["time"] - b["time"]) / float(values["residual_time"][which])
                K[i, j] += float(values["residual_variance"][which]) * np.exp(-apart)
    return K


def by_hand(tiny, clips, scaled=True) -> float:
    """Log density of the program on training clips, term by term.

    Without `scaled` a path's density is that of the path as it is.
    """
    model, values = tiny.model, tiny.sites(*clips)
    y = np.concatenate([tiny.y[clip] for clip in clips])
    points = styles_and_content(model, values, clips)
    K = covariance(model, values, points) + np.eye(len(points)) / float(values["beta"])
    total = 0.0
    for d, scale in enumerate(np.asarray(values["scale"])):
        rows = np.isfinite(y[:, d])
        own = K[np.ix_(rows, rows)] / scale**2
        total += multivariate_normal(np.zeros(rows.sum()), own).logpdf(y[rows, d])
    if model.on_circle:
        total += ring_by_hand(values)
    else:
        total += dynamics_by_hand(model, values, clips, y.shape[1])
        total += scale_by_hand(values["x"], clips) if scaled else 0.0
    if model.priors == "proper":
        total += lognorm(1.0).logpdf(values["gamma"])
        total += lognorm(2.0, scale=100.0).logpdf(values["beta"])
        total += halfnorm.logpdf(values["scale"]).sum()
        if model.residual != White():
            total += lognorm(2.0, scale=0.01).logpdf(values["residual_variance"]).sum()
            total += lognorm(1.0, scale=RATE / 3).logpdf(values["residual_time"]).sum()
        total += shapes_by_hand(model, values)
        if model.on_circle:
            second = 2 * np.pi / RATE
            if model.learns_pace:
                total += learned_pace_by_hand(model, values, len(values["step"]))
            else:
                total += lognorm(0.4, scale=second).logpdf(values["step"]).sum()
        else:
            second = 2 * np.pi / RATE
            medians = {1: [0.1, 1.0, 1.0], 2: [0.01, 0.3, 0.15 / second**2, 1.0, 1.0]}[
                model.path.order
            ]
            spread = (y.shape[1] / model.path.size) ** (-0.5 * model.path.balanced)
            total += lognorm(spread, scale=medians).logpdf(values["alpha"]).sum()
    else:
        total -= np.log(values["gamma"]) + np.log(values["beta"])
        if model.residual != White():
            total -= (
                np.log(values["residual_variance"]).sum() + np.log(values["residual_time"]).sum()
            )
        if not model.on_circle:
            total -= np.log(values["alpha"]).sum()
    return float(total)


def learned_pace_by_hand(model, values, clips) -> float:
    """Log density of steps whose mean, map from the styles and spread are integrated over."""
    styles, levels = styles_by_hand(model, values, True), {"subject": [0, 1, 2], "gait": [0, 1, 1]}
    alike = np.ones((clips, clips))
    for factor in model.factors:
        style = styles[factor.name][levels[factor.name][:clips]]
        alike = alike * (style @ style.T)
    log_step, parts = np.log(values["step"]), []
    grid = np.linspace(-2.4, 2.4, 9)
    for own in grid:
        for of_styles in grid:
            sds = 0.05 * np.exp(0.7 * own), 0.2 * np.exp(1.2 * of_styles)
            K = 0.4**2 + sds[1] ** 2 * alike + sds[0] ** 2 * np.eye(clips)
            log_density = multivariate_normal(np.full(clips, np.log(2 * np.pi / RATE)), K)
            parts.append(log_density.logpdf(log_step) - 0.5 * (own**2 + of_styles**2))
    each = -0.5 * grid**2
    weight = 2 * logsumexp(each)
    return logsumexp(parts) - weight - log_step.sum()


def dynamics_by_hand(model, values, clips, d) -> float:
    """Eq. 16, or its second order, for a path of unit scale."""
    moving, alpha = movement(values["x"], clips), np.asarray(values["alpha"])
    x = np.asarray(values["x"]) - moving + moving / rms(moving)
    sizes, order = [len(CLIPS[clip]) for clip in clips], model.path.order
    total, states, after, first = 0.0, [], [], 0
    for n in sizes:
        clip = x[first : first + n]
        total += norm.logpdf(clip[:order]).sum()
        velocity = np.diff(clip, axis=0, prepend=np.nan)
        states += list(zip(clip[order - 1 : -1], velocity[order - 1 : -1], strict=True))
        after += list(clip[order:])
        first += n
    at, v = (np.array(part) for part in zip(*states, strict=True))
    square = np.sum((at[:, None] - at[None]) ** 2, axis=-1)
    if order == 1:
        K = alpha[0] * np.exp(-0.5 * alpha[1] * square) + alpha[2] * at @ at.T
    else:
        faster = np.sum((v[:, None] - v[None]) ** 2, axis=-1)
        K = alpha[0] * np.exp(-0.5 * alpha[1] * square - 0.5 * alpha[2] * faster)
        K = K + alpha[3] * at @ at.T + alpha[4] * v @ v.T
    K = K + model.path.noise_sd**2 * np.eye(len(K))
    steps = sum(multivariate_normal(np.zeros(len(K)), K).logpdf(c) for c in np.array(after).T)
    weight = d / model.path.size if model.path.balanced else 1.0
    return total + weight * steps


def movement(x, clips) -> np.ndarray:
    """A path less the mean of each clip."""
    rows = np.split(np.asarray(x), np.cumsum([len(CLIPS[clip]) for clip in clips])[:-1])
    return np.concatenate([row - row.mean(axis=0) for row in rows])


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


def scale_by_hand(x, clips) -> float:
    """log r ~ N(1, 1 / n), and the area of the sphere that r = 1 is, times r^n."""
    moving = movement(x, clips)
    n, log_r = moving.size - len(clips) * moving.shape[1], np.log(rms(moving))
    return norm(1.0, n**-0.5).logpdf(log_r) - n * log_r - 0.5 * np.log(n)


@pytest.mark.parametrize(
    ("content", "priors", "factors", "residual"),
    [
        (Circle(), "proper", 2, White()),
        (Circle("learned"), "proper", 2, White()),
        (Circle("learned"), "proper", 0, White()),
        (Circle(), "paper", 0, OU()),
        (Circle(), "proper", 1, OU()),
        (GPDynamics(2, 1, 0.2), "proper", 0, White()),
        (GPDynamics(2, 2, 0.2), "paper", 1, White()),
        (GPDynamics(2, 2, 0.2, balanced=True), "proper", 2, White()),
        (GPDynamics(2, 1, 0.2, balanced=True), "paper", 0, White()),
    ],
)
def test_the_density_is_that_written_out_by_hand(tiny, content, priors, factors, residual):
    two = (Factor("subject", size=2, novel_dims=0), Factor("gait", size=3, novel_dims=0))
    one = tiny(content, priors, two[:factors], residual)
    if not one.model.on_circle:
        one.values["training"]["x"] *= 1.7
    values = one.sites("one", "two")
    expected = by_hand(one, ("one", "two"))
    frames = one.frames("one", "two")
    # Evaluated as the search does, by logarithms of the positive sites, without a Jacobian.
    density = ProgramDensity(one.model)
    real = density.real(values, (frames,))
    np.testing.assert_allclose(jax.jit(density)(real, (frames,)), expected, rtol=1e-8)
    positive = {"gamma", "beta", "scale", "alpha", "step", "residual_variance", "residual_time"}
    for name, value in values.items():
        by_logarithm = np.log(value) if name in positive else value
        np.testing.assert_allclose(real[name], by_logarithm, rtol=1e-12)
        np.testing.assert_allclose(density.natural(real, (frames,))[name], value, rtol=1e-12)


@pytest.fixture(scope="module", params=CASES)
def conditioned(tiny, request):
    """Make a model conditioned on the training clips, and the new clip."""
    content, residual = CASES[request.param]
    one = tiny(content, residual=residual)
    training = one.frames("one", "two")
    trained = jax.jit(one.model.condition)(training, one.sites("one", "two"))
    return one, trained, one.frames("new", trained=training.missing)


def test_new_clips_have_the_joint_density_over_that_of_training(conditioned):
    """log p(new | training) = log p(training and new) - log p(training), sites included."""
    one, trained, new = conditioned
    clips = ("one", "two", "new")
    expected = by_hand(one, clips, scaled=False) - by_hand(one, clips[:2], scaled=False)
    whole = replace(one.model, context_weight=1.0)
    found = log_density(whole, one.sites("new"), new, trained)
    np.testing.assert_allclose(found, expected, rtol=1e-7)


def test_the_program_of_all_clips_is_that_written_out_by_hand(tiny):
    """The same joint density by one big call of the program."""
    one, clips = tiny(GPDynamics(2, noise_sd=0.2, balanced=True)), ("one", "two", "new")
    values = one.sites(*clips)
    expected = by_hand(one, clips)
    styles = jnp.concatenate([styles_of(values["shape_subject"], 2, 2), values["style_subject"]])
    values = {**values, "shape_subject": entries_of(styles)}
    del values["style_subject"]
    found = log_density(one.model, values, one.frames(*clips))
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_predictions_are_the_conditional_of_all_frames_at_once(conditioned):
    one, trained, new = conditioned
    found = jax.jit(one.model.predict)(trained, new, one.sites("new"))["y"]

    values = one.sites("one", "two", "new")
    points = styles_and_content(one.model, values, ("one", "two", "new"))
    K = covariance(one.model, values, [*points, *points[9:]])
    noise = 1.0 / float(values["beta"])
    K[:13, :13] += noise * np.eye(13)
    y = np.concatenate([one.y[clip] for clip in ("one", "two", "new")])
    for d in range(y.shape[1]):
        seen = np.flatnonzero(np.isfinite(y[:, d]))
        gain = np.linalg.solve(K[np.ix_(seen, seen)], K[seen, 13:]).T
        np.testing.assert_allclose(found.mean[:, d], gain @ y[seen, d], rtol=1e-6, atol=1e-8)
        V = K[13:, 13:] - gain @ K[seen, 13:]
        pattern = int(np.argmax(found.columns[:, d]))
        np.testing.assert_allclose(found.covariance[pattern], V, rtol=1e-6, atol=1e-8)
        variance = (np.diag(V) + noise) / float(values["scale"][d]) ** 2
        np.testing.assert_allclose(found.variance[:, d], variance, rtol=1e-6)


def test_one_level_a_factor_leaves_the_plain_model(tiny):
    """The style of an only level is (1, 0, ...), which changes nothing."""
    plain = tiny(GPDynamics(2), factors=())
    labels = {name: dict.fromkeys(("one", "two"), "only") for name in ("subject", "gait")}
    y = {clip: plain.y[clip] for clip in ("one", "two")}
    frames = frames_of(y, labels, {"subject": ["only"], "gait": ["only"]}, frame_rate=RATE)
    styled = Multifactor(GPDynamics(2), SUBJECT_AND_GAIT, residual=White())
    values = plain.sites("one", "two")
    empty = {"shape_subject": jnp.zeros(0), "shape_gait": jnp.zeros(0)}
    expected = log_density(plain.model, values, plain.frames("one", "two"))
    np.testing.assert_allclose(
        log_density(styled, {**values, **empty}, frames), expected, rtol=1e-9
    )


def test_what_the_data_cannot_tell_is_not_there(tiny):
    """The covariance from any styles and phases is that from their shape, but for its size."""
    one = tiny()
    frames, values = one.frames("one", "two"), one.sites("one", "two")
    random = np.random.default_rng(3)
    s, g, phase = random.normal(size=(2, 2)), random.normal(size=(2, 3)), np.array([0.4, 2.1])
    shaped = {
        **values,
        "shape_subject": entries_of(s),
        "shape_gait": entries_of(g),
        "phase_point": 1.2 * circle(phase[1:] - phase[0]),
    }
    points = one.model.latent_points(frames, shaped)
    found = one.model.kernel(values).matrix(points, points)
    clip = np.asarray(frames.clip)
    raw = {
        "subject": s[np.asarray(frames.level["subject"])][clip],
        "gait": g[np.asarray(frames.level["gait"])][clip],
        "content": circle(phase[clip] + values["step"][clip] * frames.time),
    }
    expected = one.model.kernel(values).matrix(raw, raw)
    np.testing.assert_allclose(found, expected / expected[0, 0], rtol=1e-9)


def test_collapsing_the_scales_is_integrating_over_them(tiny):
    """log p(y) = log p(y, w) - log p(w | y) at any w, for the seen entries alone."""
    one = tiny(residual=OU())
    frames, values = one.frames("one", "two"), one.sites("one", "two")
    points = one.model.latent_points(frames, values)
    K = one.model.kernel(values).matrix(points, points) + one.model._noise(values, values, frames)
    conditional = 0.0
    y = np.concatenate([one.y["one"], one.y["two"]])
    for d, w in enumerate(np.asarray(values["scale"])):
        seen = np.isfinite(y[:, d])
        q = y[seen, d] @ np.linalg.solve(np.asarray(K)[np.ix_(seen, seen)], y[seen, d])
        squared = gamma((seen.sum() + 1) / 2, scale=2 / (1 + q))
        conditional += squared.logpdf(w**2) + np.log(2 * w)
    rest = {name: value for name, value in values.items() if name != "scale"}
    found = float(ProgramDensity(one.model, "collapsed")(rest_real(one, rest, frames), (frames,)))
    joint = log_density(one.model, values, frames)
    np.testing.assert_allclose(found, joint - conditional, rtol=1e-9)


def rest_real(one, values, frames):
    return ProgramDensity(one.model, "collapsed").real(values, (frames,))


def test_scales_are_drawn_from_their_conditional(tiny):
    one = tiny()
    frames, values = one.frames("one", "two"), one.sites("one", "two")
    keys = jax.random.split(jax.random.key(0), 2000)
    draws = jax.vmap(lambda key: one.model.complete_draw(key, frames, values)["scale"])(keys)
    points = one.model.latent_points(frames, values)
    K = np.asarray(one.model.kernel(values).matrix(points, points)) + np.eye(9) / 20.0
    y = np.concatenate([one.y["one"], one.y["two"]])
    for d in range(4):
        seen = np.isfinite(y[:, d])
        q = y[seen, d] @ np.linalg.solve(K[np.ix_(seen, seen)], y[seen, d])
        squared = gamma((seen.sum() + 1) / 2, scale=2 / (1 + q))
        error = squared.std() / np.sqrt(len(keys))
        assert abs(np.mean(draws[:, d] ** 2) - squared.mean()) < 4 * error


def test_an_rbf_factor_is_an_rbf_on_the_style(tiny):
    factors = (Factor("subject", size=2, kind="rbf", novel_dims=0),)
    one = tiny(factors=factors)
    values = one.sites("one", "two")
    frames = one.frames("one", "two")
    points = one.model.latent_points(frames, values)
    found = one.model.kernel(values).matrix(points, points)
    s, x = np.asarray(points["subject"]), np.asarray(points["content"])
    square = np.sum((s[:, None] - s[None]) ** 2, axis=-1)
    expected = np.exp(-0.5 * square) * np.exp(
        -0.5 * 0.7 * np.sum((x[:, None] - x[None]) ** 2, axis=-1)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_every_unknown_label_is_a_style_of_its_own():
    y = np.random.default_rng(0).normal(size=(3, 4))
    labels = {"subject": {"a": "ann", "b": "", "c": "", "d": "ann"}}
    frames = frames_of(dict.fromkeys("abcd", y), labels, {"subject": ["ann"]}, frame_rate=30.0)
    assert frames.levels == (3,)
    np.testing.assert_array_equal(frames.level["subject"], [0, 1, 2, 0])
    model = Multifactor(factors=(Factor("subject", size=2, novel_dims=0),))
    styles = jnp.asarray(np.random.default_rng(1).normal(size=(3, 2)))
    values = {"phase_point": jnp.ones((3, 2)), "step": jnp.full(4, 0.2)}
    values |= {"shape_subject": entries_of(styles), "gamma": jnp.asarray(1.0)}
    points = model.latent_points(frames, values)
    expected = styles_of(values["shape_subject"], 3, 2)[jnp.array([0, 1, 2, 0])]
    np.testing.assert_array_equal(points["subject"][::3], expected)
    np.testing.assert_array_equal(points["subject"], np.repeat(expected, 3, axis=0))


@pytest.fixture(scope="module")
def training():
    motion = synthetic_walkers(["ann", "ben"], ["walk", "run"], seconds=0.2)
    return prepare(motion, ("subject", "gait"))


@pytest.mark.parametrize("content", CONTENTS, ids=NAMES)
@pytest.mark.parametrize("priors", ["proper", "paper"])
def test_every_site_has_the_dimensions_the_model_tells(training, content, priors):
    residual = OU() if content == Circle() else White()
    model = Multifactor(content, SUBJECT_AND_GAIT, priors=priors, residual=residual)
    shapes = {
        "gamma": (),
        "beta": (),
        "scale": (training.frames.y.shape[1],),
        "shape_subject": (2,),
        "shape_gait": (2,),
    }
    if model.on_circle:
        shapes |= {"phase_point": (3, 2), "step": (4,)}
        shapes |= {"residual_variance": (4,), "residual_time": (4,)}
    else:
        shapes |= {"alpha": (5,), "x": (24, 3)}
    dims, coords = model.dims(), model.coords(training)
    for name, shape in shapes.items():
        assert tuple(len(coords[dim]) for dim in dims[name]) == shape, name
    values = {name: jnp.ones(shape) for name, shape in shapes.items()}
    if not model.on_circle:
        values["x"] = jnp.asarray(np.random.default_rng(0).normal(size=(24, 3)))

    def trace(values):
        substituted = numpyro.handlers.substitute(model.program, data=values)
        sites = numpyro.handlers.trace(substituted).get_trace(training.frames)
        latent = [n for n, s in sites.items() if s["type"] == "sample" and not s["is_observed"]]
        assert sorted(latent) == sorted(shapes)
        determined = {n: s["value"] for n, s in sites.items() if s["type"] == "deterministic"}
        assert len(determined) == (3 if model.on_circle else 2)
        for name, value in determined.items():
            assert tuple(len(coords[dim]) for dim in dims[name]) == value.shape, name
        return sites["y"]["fn"].log_prob(sites["y"]["value"])

    assert jax.eval_shape(trace, values).shape == ()


def test_what_only_new_people_have_adds_to_their_own_covariance_alone(tiny):
    tiny = tiny(factors=(Factor("subject", 2, novel_dims=1), Factor("gait", 3, novel_dims=0)))
    model = tiny.model
    trained = model.condition(tiny.frames("one", "two"), tiny.sites("one"))
    frames = tiny.frames("new")
    plain = tiny.sites("new")

    def covariances(novel):
        style = np.append(plain["style_subject"], [[novel]], axis=1)
        points = model.latent_points(frames, {**plain, "style_subject": style}, trained)
        kernel = model.kernel(trained.hyper)
        return points, kernel.matrix(points, trained.points), kernel.matrix(points, points)

    points, cross, own = covariances(0.8)
    _, cross_without, own_without = covariances(0.0)
    np.testing.assert_allclose(cross, cross_without, rtol=1e-12)
    gait, content = np.asarray(points["gait"]), np.asarray(points["content"])
    away = np.sum((content[:, None] - content[None]) ** 2, axis=-1)
    more = 0.8**2 * (gait @ gait.T) * np.exp(-0.5 * trained.hyper["gamma"] * away)
    np.testing.assert_allclose(own - own_without, more, rtol=1e-10)


def test_novel_dimensions_of_other_factors_are_refused():
    with pytest.raises(InputError, match="only a linear factor"):
        Factor("subject", kind="rbf", novel_dims=1)


def test_a_context_counts_by_its_weight(tiny):
    """Of the new clip's density that of what is seen is taken to a power, and nothing else."""
    one = tiny(residual=OU())
    training = one.frames("one", "two")
    trained = one.model.condition(training, one.sites("one", "two"))
    new, values = one.frames("new", trained=training.missing), one.sites("new")
    found = [log_density(replace(one.model, context_weight=w), values, new, trained)
             for w in (1.0, 0.5, 0.25)]  # fmt: skip
    assert found[1] - found[2] == pytest.approx(0.5 * (found[0] - found[1]))
    assert abs(found[0] - found[1]) > 0.1
    whole = [log_density(replace(one.model, context_weight=w), one.sites("one", "two"), training)
             for w in (1.0, 0.5)]  # fmt: skip
    assert whole[0] == whole[1]
    for weight in (0.0, 1.5):
        with pytest.raises(InputError, match="context_weight"):
            replace(one.model, context_weight=weight)


def test_a_population_is_only_of_a_linear_factor():
    with pytest.raises(InputError, match="only of a linear factor"):
        Factor("subject", kind="rbf", new_levels="population")


@pytest.mark.parametrize("rate", [30.0, 120.0])
@pytest.mark.parametrize("content", CONTENTS[:2], ids=NAMES[:2])
def test_priors_of_time_are_in_seconds_whatever_the_frame_rate(content, rate):
    """A step, a residual's time and speeds of the path are per frame of the data's own rate."""
    walk = synthetic_walkers(("ann", "ben"), ("walk",), seconds=0.6, frame_rate=rate)
    model = Multifactor(content, (Factor("subject"),))
    training = prepare(walk, ("subject",))
    start = model.initial_values(training, 0, 1)[0]
    program = numpyro.handlers.substitute(model.program, data=start)
    sites = numpyro.handlers.trace(program).get_trace(*training.data)

    def median(name, spread):
        return sites[name]["fn"].mean * np.exp(-0.5 * spread**2)

    np.testing.assert_allclose(median("residual_time", 1.0), rate / 3.0, rtol=1e-6)
    if model.on_circle:
        np.testing.assert_allclose(median("step", 0.4), 2.0 * np.pi / rate, rtol=1e-6)
    else:
        per_frame = 0.15 * (rate / (2.0 * np.pi)) ** 2
        np.testing.assert_allclose(median("alpha", 1.0)[2], per_frame, rtol=1e-6)


BY_NAME = (("subject", "gait"), ["subject", "gait"], ["subject", Factor("gait")])


@pytest.mark.parametrize("names", BY_NAME)
def test_factors_may_be_given_by_their_names(names):
    model = Multifactor(factors=names)
    assert model == Multifactor(factors=(Factor("subject"), Factor("gait")))
    assert [factor.name for factor in model.style_factors] == ["subject", "gait"]
