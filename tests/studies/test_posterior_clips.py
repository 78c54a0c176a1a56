"""A new clip's unknowns by two samplers, and forecasts averaged over them."""

import dataclasses
import warnings
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from numpyro import infer

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.modes import trained_model
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.models.multifactor import OU, GPDynamics, Multifactor
from bayesmotion.motion.synthetic.walkers import synthetic_truth, synthetic_walkers
from bayesmotion.prediction import score
from bayesmotion.studies.multifactor.study import AT_MODES
from bayesmotion.studies.posterior import clips
from bayesmotion.studies.posterior.averaged import forecast_posterior
from bayesmotion.studies.posterior.clips import (
    clip_problem,
    clip_values,
    identified,
    sample_nuts,
    sample_walkers,
)
from bayesmotion.studies.posterior.new_people import seen_so
from bayesmotion.tasks.forecast import angles_of, context_of, forecast

pytestmark = pytest.mark.slow

CONTEXT, HORIZON = 12, 8
# One number for all runs: samplers of another one are compiled anew.
WARMUP = 150
# Unknowns of a clip seen without novel dimensions.
FEWEST = 9


@pytest.fixture(scope="module")
def walkers():
    return synthetic_walkers(
        gaits=("walk", "run"), leave_out=[("ben", "run")], seconds=2.0, frame_rate=20.0
    )


def problem_of(fit, clip):
    seen = context_of(clip, context=CONTEXT, horizon=HORIZON)
    return clip_problem(fit, fit.model.prepare(seen, fit.training))


@pytest.fixture(scope="module")
def circle_fit(walkers):
    """A fit with a residual of one size, so that a clip has few unknowns; forecasts at the mode."""
    model = Multifactor(residual=OU(per_clip=False), student_df=None, **AT_MODES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        return fit_map(model, walkers, starts=2, keep=1, max_steps=120)


@pytest.fixture(scope="module")
def clip():
    return synthetic_truth(gaits=("walk", "run"), frame_rate=20.0).cell("ben", "run")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(0, id="plain"),
        pytest.param(1, id="novel", marks=pytest.mark.thorough),
    ],
)
def problem(request, circle_fit, clip):
    return problem_of(seen_so(circle_fit, request.param, None), clip)


@pytest.fixture(scope="module")
def chains(problem):
    return sample_nuts(problem, chains=2, warmup=WARMUP, draws=200, seed=0)


@pytest.fixture(scope="module")
def drawn(problem, chains):
    return clip_values(problem, chains["z"])


@pytest.fixture(scope="module")
def mode(circle_fit, clip):
    return forecast(circle_fit, clip, context=CONTEXT, horizon=HORIZON)


@pytest.mark.thorough
def test_two_samplers_agree_on_what_is_identified(problem, drawn):
    one = identified(problem, drawn)
    walkers = sample_walkers(problem, warmup=400, steps=600, seed=0)
    other = identified(problem, clip_values(problem, walkers.values[::6]))
    # Three people and two gaits, vectors of three entries or four.
    assert set(one) == {"styles", "log_length", "phase", "log_step"}
    assert one["styles"].shape[2:] == (6,)
    worth = walkers.values.shape[0] * walkers.values.shape[1] / walkers.autocorrelation.max()
    for name, draws in one.items():
        for index in np.ndindex(draws.shape[2:]):
            a, b = draws[(..., *index)], other[name][(..., *index)]
            # Neighbouring draws of NUTS are about independent here.
            error = np.sqrt(a.var() / (0.3 * a.size) + b.var() / worth)
            assert abs(a.mean() - b.mean()) < 4 * error, name


def test_its_density_is_the_programs_in_other_coordinates(problem, drawn):
    data, density = problem.training.data, problem.target.density
    natural = {name: value[0, 0] for name, value in drawn.items() if name != "phase"}
    plain = ProgramDensity(problem.model, jacobian=True)
    there = density.real(natural, data)
    u, unravel = ravel_pytree(there)

    def straight(flat):
        sites = density.natural(unravel(flat), data)
        return ravel_pytree(plain.real({n: sites[n] for n in natural}, data))[0]

    volume = np.linalg.slogdet(np.asarray(jax.jit(jax.jacobian(straight))(u)))[1]
    expected = jax.jit(plain)(plain.real(natural, data), data) + volume
    np.testing.assert_allclose(jax.jit(density)(there, data), expected, rtol=1e-9)
    back = density.natural(there, data)
    for name, value in natural.items():
        np.testing.assert_allclose(back[name], value, rtol=1e-9, atol=1e-12)


@pytest.fixture(scope="module")
def leapfrogs_on_a_normal() -> float:
    """Return the mean number of leapfrogs on a standard normal, adapted as long.

    With more unknowns they are more.
    """
    kernel = infer.NUTS(potential_fn=lambda z: 0.5 * jnp.vdot(z, z), dense_mass=True)
    mcmc = infer.MCMC(kernel, num_warmup=WARMUP, num_samples=200, num_chains=1, progress_bar=False)
    mcmc.run(jax.random.key(0), init_params=jnp.zeros(FEWEST), extra_fields=("num_steps",))
    return float(mcmc.get_extra_fields()["num_steps"].mean())


def test_its_own_coordinates_leave_little_bent(problem, chains, leapfrogs_on_a_normal):
    """Trajectories are about as short as on a normal density, and hardly any diverges."""
    assert chains["diverging"].mean() <= 0.01
    assert problem.unknowns >= FEWEST
    # A novel dimension that nothing calls for goes towards zero: its logarithm has a long tail.
    most = 4 if problem.model.factors[0].novel else 2
    assert chains["n_steps"].mean() < most * leapfrogs_on_a_normal


@pytest.mark.thorough
def test_the_programs_coordinates_are_bent(circle_fit, clip, leapfrogs_on_a_normal, monkeypatch):
    """The control, as `chains` otherwise: what is asked of the plain problem does not hold."""
    monkeypatch.setattr(clips, "ClipDensity", partial(ProgramDensity, jacobian=True))
    bent = problem_of(circle_fit, clip)
    found = sample_nuts(bent, chains=2, warmup=WARMUP, draws=200, seed=0)
    short = found["n_steps"].mean() < 2 * leapfrogs_on_a_normal
    assert not (short and found["diverging"].mean() <= 0.01)


def test_opposite_styles_are_one_and_the_same(problem, drawn):
    turned = {n: -v if n.startswith("style_") else v for n, v in drawn.items()}
    for name, value in identified(problem, drawn).items():
        np.testing.assert_allclose(identified(problem, turned)[name], value, rtol=1e-12)


def test_residuals_by_a_t_process_are_each_of_its_own_size(circle_fit, clip, mode):
    loose_fit = seen_so(circle_fit, 1, 4.0)
    assert seen_so(circle_fit, 1, None).model == circle_fit.model
    loose = forecast(loose_fit, clip, context=CONTEXT, horizon=HORIZON)
    np.testing.assert_allclose(loose.mean, mode.mean, atol=1e-9)
    ratio = (loose.sd / mode.sd)[CONTEXT:]
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[:1], ratio.shape), rtol=1e-6)
    assert np.ptp(ratio[0]) > 0.05
    # With very many degrees of freedom it is a Gaussian process.
    stiff = seen_so(circle_fit, 1, 1e6)
    (frames,) = mode.prediction.data.data
    trained = trained_model(stiff.model, *stiff.training.data, stiff.values())
    exact = jax.jit(stiff.model.predict)(trained, frames, mode.values)["y"].variance
    best = np.argmax(mode.mixture.weight)
    own = mode.mixture.sd[best] / circle_fit.training.encoding.sd
    np.testing.assert_allclose(np.sqrt(exact), own, rtol=0.02)


def test_the_average_is_about_the_mode_and_less_sure(circle_fit, clip, mode):
    settings = {"context": CONTEXT, "horizon": HORIZON, "warmup": WARMUP, "draws": 40}
    over = forecast_posterior(circle_fit, clip, **settings, seed=0, components=16)
    assert over.mixture.mean.shape == (16, CONTEXT + HORIZON, mode.mean.shape[1])
    n = circle_fit.training.encoding.n_angles
    ahead = np.s_[CONTEXT:, :n]
    assert np.mean(over.sd[ahead]) > np.mean(mode.sd[ahead])
    assert np.median(np.abs(over.mean[ahead] - mode.mean[ahead]) / over.sd[ahead]) < 1.0
    true, columns = angles_of(circle_fit, clip.isel(frame=slice(CONTEXT + HORIZON)), CONTEXT)
    scores = score(over.mixture.part(slice(CONTEXT, None), columns), true[CONTEXT:])
    assert 0.5 < scores.coverage90 <= 1.0
    again = forecast_posterior(circle_fit, clip, **settings, seed=0, components=16)
    np.testing.assert_array_equal(over.mean, again.mean)


def test_a_path_is_refused(circle_fit, clip):
    path = dataclasses.replace(circle_fit, model=Multifactor(GPDynamics()))
    with pytest.raises(InputError, match="content on a circle only"):
        problem_of(path, clip)
