"""Clips forecast while they are recorded: as by all of their frames at once."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import bayesmotion as bm
from bayesmotion.errors import InputError
from bayesmotion.inference.density import ProgramDensity, real_values
from bayesmotion.inference.modes import trained_model
from bayesmotion.motion.joining import lengthened
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.tasks.forecast import context_of

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::bayesmotion.MotionWarning")]
# Frames of the window and of the forecast, at 15 a second.
WINDOW, HORIZON = 12, 6


@pytest.fixture(scope="module")
def fit():
    model, walkers = bm.example("multifactor")
    return bm.fit(model, walkers, method=bm.MAP(max_steps=60), seed=0)


@pytest.fixture(scope="module")
def unseen():
    clips = synthetic_walkers(("ben",), ("run",), seconds=3.0, frame_rate=15.0, noise=0.05, seed=3)
    return bm.split(clips)["ben-run"]


def begun(fit, **options):
    seconds = {"window": WINDOW / 15.0, "horizon": HORIZON / 15.0}
    return bm.online(fit, **seconds, **options)


@pytest.fixture(scope="module")
def followed(fit, unseen):
    """Forecasts after 2, 8 and 12 frames, 13, and 30."""
    following, out = begun(fit), {}
    for frame in range(30):
        out[frame + 1] = following.update(unseen.isel(frame=[frame]))
    return out


def frames_of(fit, unseen, count):
    context = context_of(unseen, context=count, horizon=HORIZON)
    return fit.model.prepare(lengthened(context, HORIZON), fit.training).frames


@pytest.mark.parametrize("count", [2, 8, WINDOW])
def test_it_is_the_forecast_of_the_context_at_the_same_unknowns(fit, unseen, followed, count):
    trained = trained_model(fit.model, fit.training.frames, fit.values())
    units, said = fit.training.units()["y"], followed[count]
    for draw in (0, 5):
        own = {name: jnp.asarray(value[draw]) for name, value in said.unknowns.items()}
        true = fit.model.predict(trained, frames_of(fit, unseen, count), own)["y"]
        mean = units.natural(np.asarray(true.mean))[count:]
        sd = np.sqrt(np.asarray(true._normal()))[count:] * units.scale
        np.testing.assert_allclose(said.mixture.mean[draw], mean, atol=1e-6)
        # The sd is times that of a draw of lambda, the same for all frames.
        ratio = said.mixture.sd[draw] / sd
        np.testing.assert_allclose(ratio, np.broadcast_to(ratio[0], ratio.shape), rtol=1e-5)


@pytest.mark.thorough
def test_the_unknowns_are_as_likely_as_those_that_a_search_finds(fit, unseen, followed):
    density = ProgramDensity(fit.model, jacobian=True)
    trained = trained_model(fit.model, fit.training.frames, fit.values())
    context = context_of(unseen, context=WINDOW, horizon=1)
    data = (fit.model.prepare(context, fit.training).frames, trained)
    found = bm.forecast(fit, unseen, context=WINDOW, horizon=1).values
    values = [
        float(density(real_values(density, one, data), data))
        for one in (followed[WINDOW].values, found)
    ]
    assert values[0] > values[1] - 3.0


def test_it_knows_better_than_the_last_pose_and_how_sure_it_is(fit, unseen, followed):
    encoding = fit.training.encoding
    true = encoding.features(unseen, encoding.heading(unseen))[:, : encoding.n_angles]
    errors, held, inside = [], [], []
    for count in range(10, 31):
        said = followed[count].mixture.part(slice(None), slice(encoding.n_angles))
        ahead = true[count : count + HORIZON]
        errors.append(np.linalg.norm(said.means() - ahead))
        held.append(np.linalg.norm(true[count - 1] - ahead))
        inside.append(np.abs(said.probability(ahead) - 0.5) < 0.45)
    assert np.mean(errors) < 0.5 * np.mean(held)
    assert 0.6 < np.mean(inside) <= 1.0


def test_draws_have_the_moments_of_the_mixture_and_go_on_from_the_root(followed, unseen, fit):
    said = followed[30]
    assert said.samples.shape == said.mixture.mean.shape
    z = (said.samples - said.mixture.mean) / said.mixture.sd
    assert abs(np.std(z) - 1.0) < 0.1
    again = begun(fit)
    found = again.update(unseen.isel(frame=slice(30)))
    np.testing.assert_allclose(found.mean, said.mean, rtol=1e-10)
    motion, path = found.motion, unseen["root_position"].values
    assert motion.sizes["frame"] == HORIZON
    step = np.linalg.norm(np.diff(path[:30], axis=0), axis=1).max()
    assert np.linalg.norm(motion["root_position"].values[0] - path[29]) < 2.0 * step
    assert len(found.draws(3)) == 3


def test_frames_that_are_missing_make_it_less_sure(fit, unseen, followed):
    holes = unseen.copy(deep=True)
    holes["angle"][12:16], holes["root_position"][12:16] = np.nan, np.nan
    told = begun(fit).update(holes.isel(frame=slice(16)))
    assert np.isfinite(told.mean).all()
    assert np.mean(told.sd) > np.mean(followed[16].sd)


@pytest.mark.thorough
def test_a_long_past_with_missing_joints_is_that_of_the_context_at_the_same_unknowns(fit, unseen):
    # Unknowns are held: what has left the window says all that it said.
    count = WINDOW + 6
    holes = unseen.copy(deep=True)
    holes["angle"][4:9, 8:14], holes["angle"][14:16, 20:24] = np.nan, np.nan
    values = {name: jnp.asarray(value)[None] for name, value in fit.values().items()}
    follower = fit.model.follower(fit.training, values, {}, WINDOW, HORIZON)
    process = follower.process
    given = process.condition(fit.training.frames, fit.values())
    past, own, window = process.nothing(given), None, None
    # The heading is that of all of the context.
    turned = fit.training.encoding.heading(holes.isel(frame=slice(count)))
    follower._poses.encoding = dataclasses.replace(fit.training.encoding, align_heading=False)
    follower._poses.heading = turned
    for frame in range(count):
        arrival = follower.add(holes.isel(frame=[frame]))
        if own is None:
            own = follower.candidates(given, 1)[0]
            own = {name: jnp.asarray(value) for name, value in own.items()}
        if arrival.left is not None:
            parent, seen, group = arrival.left
            past = process.gone(window, past.split(parent), given, own, seen, group)
        own, window = process.moved(own, jnp.array(arrival.shift)), arrival.window
    assert len(past.count) > 1
    noise = process.noise(window, jax.random.key(0))
    found = process.predict(window, past, given, own, noise)[0]
    middle = {**own, **process.moved(own, jnp.array(-(count - WINDOW) / 2.0))}
    trained = trained_model(fit.model, fit.training.frames, fit.values())
    true = fit.model.predict(trained, frames_of(fit, holes, count), middle)["y"].mean[count:]
    np.testing.assert_allclose(found, true, atol=1e-6)


@pytest.mark.thorough
def test_draws_of_a_fit_count_alike(fit, unseen):
    many = dataclasses.replace(fit, tree=fit.tree.copy())
    posterior = fit.tree["posterior"].to_dataset()
    shifts = np.exp(0.05 * np.arange(-3, 3))
    drawn = {
        str(name): values.isel(draw=[0] * 6) * (1.0 if name != "beta" else shifts[None])
        for name, values in posterior.data_vars.items()
    }
    many.tree["posterior"] = posterior.isel(draw=[0] * 6).assign(drawn).assign_coords(draw=range(6))
    following = begun(many)
    for frame in range(WINDOW):
        said = following.update(unseen.isel(frame=[frame]))
    assert len(said.samples) == 18
    alone = begun(fit).update(unseen.isel(frame=slice(WINDOW)))
    assert np.linalg.norm(said.mean - alone.mean) < 0.5 * np.linalg.norm(alone.sd)


def test_what_cannot_be_followed_is_refused_in_a_sentence(fit, unseen, cycle_mode):
    with pytest.raises(InputError, match=r"not followed frame by frame\. Fit multifactor"):
        bm.online(cycle_mode)
    path = dataclasses.replace(fit, model=dataclasses.replace(fit.model, content=bm.GPDynamics()))
    with pytest.raises(InputError, match="only content on a circle"):
        bm.online(path)
    with pytest.raises(InputError, match="'nobody' is not in the training clips"):
        bm.online(fit, labels={"subject": "nobody"})
    following = begun(fit)
    with pytest.raises(InputError, match="30 frames a second"):
        following.update(unseen.isel(frame=[0]).assign_attrs(frame_rate=30.0))
    with pytest.raises(InputError, match="no Motion of frames"):
        following.update(unseen.isel(frame=0))
