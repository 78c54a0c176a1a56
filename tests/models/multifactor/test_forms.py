"""The forms of the covariance are one model: densities, gradients, fits and predictions."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
from numpyro.infer.util import log_density

import bayesmotion as bm
from bayesmotion.distributions.styles import entries_of
from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.gp.on_circle import CircleCovariance
from bayesmotion.models.multifactor import OU, Circle, Factor, GPDynamics, Multifactor, White
from bayesmotion.models.multifactor.frames import frames_of
from bayesmotion.studies.multifactor import study

pytestmark = pytest.mark.slow

RATE, D = 15.0, 5
SIZES = {"one": 70, "two": 12, "three": 41}
LABELS = {
    "subject": {"one": "ann", "two": "ben", "three": ""},
    "gait": {"one": "walk", "two": "walk", "three": "run"},
}
KNOWN = {"subject": ["ann", "ben"], "gait": ["walk", "run"]}
RESIDUALS = {"own": OU(), "common": OU(per_clip=False), "white": White()}


def clips():
    """Clips of unlike lengths, entries missing in several patterns."""
    random, out = np.random.default_rng(0), {}
    for index, (clip, size) in enumerate(SIZES.items()):
        phase = (0.3 + 0.1 * index) * np.arange(size) + index
        waves = np.stack([np.cos(phase), np.sin(phase), np.cos(2.0 * phase)], axis=1)
        out[clip] = waves @ random.normal(size=(3, D)) + 0.2 * random.normal(size=(size, D))
    out["one"][:9, 1] = np.nan
    out["two"][5, :3] = np.nan
    out["three"][30:, 1] = np.nan
    return out


def training(model):
    """Frames and sites of the model."""
    frames = frames_of(clips(), LABELS, KNOWN, frame_rate=RATE)
    random = np.random.default_rng(1)
    values = {
        "gamma": 0.8, "beta": 30.0, "scale": random.uniform(0.5, 2.0, size=D),
        "shape_subject": entries_of(random.normal(size=(3, 2))),
        "shape_gait": entries_of(random.normal(size=(2, 2))),
        "phase_point": random.normal(size=(2, 2)), "step": np.array([0.31, 0.39, 0.52]),
    }  # fmt: skip
    if model.residual == OU():
        values |= {"residual_variance": np.array([0.3, 0.1, 0.02]),
                   "residual_time": np.array([2.5, 8.0, 1.0])}  # fmt: skip
    if model.one_residual:
        values |= {"residual_variance": np.array([0.3]), "residual_time": np.array([2.5])}
    return frames, {name: jnp.asarray(value) for name, value in values.items()}


def forms(residual):
    factors = (Factor("subject", 2), Factor("gait", 2))
    model = Multifactor(factors=factors, residual=residual, form="dense")
    return model, replace(model, form="fourier")


# The others differ from it by what they leave out.
OWN_FIRST = [
    pytest.param(residual, id=name, marks=() if name == "own" else pytest.mark.thorough)
    for name, residual in RESIDUALS.items()
]


@pytest.mark.parametrize("residual", OWN_FIRST)
@pytest.mark.parametrize("program", ["program", "collapsed"])
def test_density_and_gradient_are_the_same(residual, program):
    def of(model):
        frames, values = training(model)
        if program == "collapsed":
            del values["scale"]
        density = lambda values: log_density(getattr(model, program), (frames,), {}, values)[0]  # noqa: E731
        return jax.jit(jax.value_and_grad(density))(values)

    (dense, by_dense), (fourier, by_fourier) = map(of, forms(residual))
    np.testing.assert_allclose(fourier, dense, rtol=1e-8)
    assert by_fourier.keys() == by_dense.keys()
    for name, slope in by_dense.items():
        largest = np.abs(slope).max()
        np.testing.assert_allclose(by_fourier[name], slope, rtol=1e-6, atol=1e-6 * largest)


@pytest.mark.parametrize("residual", RESIDUALS.values(), ids=RESIDUALS)
def test_predictions_are_the_same(residual):
    made = clips()
    new = {"new": np.where(np.arange(20)[:, None] < 12, made["three"][:20], np.nan)}
    labels = {"subject": {"new": "cat"}, "gait": {"new": "walk"}}
    known = {"subject": [*KNOWN["subject"], "\0unknown"], "gait": KNOWN["gait"]}
    own = {"style_subject": np.array([[0.4, 0.3, 0.7]]), "phase_point": np.array([[0.3, 1.1]]),
           "step": np.array([0.5])}  # fmt: skip
    if residual == OU():
        own |= {"residual_variance": np.array([0.1]), "residual_time": np.array([4.0])}
    own = {name: jnp.asarray(value) for name, value in own.items()}

    def of(model):
        frames, values = training(model)
        trained = model.condition(frames, values)
        later = frames_of(new, labels, known, frames.missing, {"new": 12}, frame_rate=RATE)
        density = log_density(model.program, (later, trained), {}, own)[0]
        said = model.predict(trained, later, own)["y"]
        return density, said.mean, said.covariance, said.variance

    for dense, fourier in zip(*map(of, forms(residual)), strict=True):
        np.testing.assert_allclose(fourier, dense, rtol=1e-8, atol=1e-8)


def test_each_frame_is_told_the_same_by_the_others():
    def of(model):
        return model.pointwise(*training(model))

    dense, fourier = map(of, forms(OU()))
    np.testing.assert_allclose(fourier, dense, rtol=1e-8)


def test_draws_of_scales_are_the_same():
    def of(model):
        frames, values = training(model)
        return model.complete_draw(jax.random.key(0), frames, values)["scale"]

    dense, fourier = map(of, forms(OU()))
    np.testing.assert_allclose(fourier, dense, rtol=1e-8)


def test_prior_draws_of_outputs_have_its_size():
    def of(model):
        frames, values = training(model)
        program = numpyro.handlers.uncondition(model.program)

        def one(key):
            seeded = numpyro.handlers.substitute(numpyro.handlers.seed(program, key), data=values)
            return numpyro.handlers.trace(seeded).get_trace(frames)["y"]["value"]

        keys = jax.random.split(jax.random.key(0), 500)
        return np.asarray(jax.jit(jax.vmap(one))(keys)).std(axis=0)

    dense, fourier = map(of, forms(OU()))
    np.testing.assert_allclose(fourier, dense, rtol=0.25)


@pytest.mark.thorough
def test_fits_are_interchangeable():
    _, motion = Multifactor.example()
    dense, fourier = forms(OU())
    method = bm.MAP(initial=1, keep=1, max_steps=4)
    with pytest.warns(MotionWarning, match="not converged"):
        by_dense, by_fourier = (bm.fit(model, motion, method=method) for model in (dense, fourier))
    assert by_fourier.values().keys() == by_dense.values().keys()
    for name, value in by_dense.values().items():
        np.testing.assert_allclose(by_fourier.values()[name], value, rtol=1e-6, atol=1e-8)


def test_what_is_no_sum_of_harmonics_is_refused():
    for settings in ({"content": GPDynamics()}, {"factors": (Factor("subject", kind="rbf"),)}):
        with pytest.raises(InputError, match="fourier"):
            Multifactor(form="fourier", **settings)
        Multifactor(form="auto", **settings)
    assert Multifactor(content=Circle()).has_harmonics


def test_the_form_is_chosen_by_the_number_of_frames():
    def form(model, count):
        made = {"one": np.zeros((count, 2))}
        labels = {"subject": {"one": "ann"}, "gait": {"one": "walk"}}
        frames = frames_of(made, labels, KNOWN, frame_rate=RATE)
        names = {"gamma": 1.0, "beta": 1.0, "step": [0.1], "phase_point": np.zeros((0, 2))}
        values = {name: jnp.asarray(value) for name, value in names.items()}
        for factor in model.style_factors:
            values[f"shape_{factor.name}"] = entries_of(np.eye(2, factor.size))
        # Traced, not computed: which form it is is all that is asked.
        found = []
        jax.eval_shape(lambda *given: found.append(type(model.process(*given))), frames, values)
        return found == [CircleCovariance]

    model = Multifactor(residual=White())
    assert [form(model, count) for count in (593, 594)] == [False, True]
    assert not form(replace(model, form="dense"), 594)
    assert form(replace(model, form="fourier"), 5)
    smaller = replace(model, factors=(Factor("subject", 2), Factor("gait", 2)))
    assert [form(smaller, count) for count in (263, 264)] == [False, True]


@pytest.mark.thorough
@pytest.mark.real_data
def test_recorded_clips_have_one_density(data_root):
    motion = study.training_motion(data_root)
    model = Multifactor(form="dense")
    training = model.prepare(motion)
    start = {n: jnp.asarray(v) for n, v in model.initial_values(training, 0, 1)[0].items()}

    def of(model):
        density = lambda values: log_density(model.program, training.data, {}, values)[0]  # noqa: E731
        return jax.jit(jax.value_and_grad(density))(start)

    (dense, by_dense), (fourier, by_fourier) = of(model), of(replace(model, form="fourier"))
    np.testing.assert_allclose(fourier, dense, rtol=1e-8)
    for name, slope in by_dense.items():
        np.testing.assert_allclose(
            by_fourier[name], slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max()
        )
