"""The keypose model: its density by hand, known values found, samplers agree, NaN left out."""

import json
from functools import partial

import jax
import numpy as np
import pytest
from jaxtyping import TypeCheckError
from numpyro.infer.util import log_density as of_program
from scipy.stats import norm

import bayesmotion as bm
from bayesmotion.errors import InputError
from bayesmotion.inference.predicting import predict
from bayesmotion.models.keyposes import Keyposes
from bayesmotion.models.keyposes.data import (
    KeyposeData,
    answers,
    beats_of,
    clip_minima,
    with_beats,
)
from bayesmotion.models.keyposes.energy import Minima, energy
from bayesmotion.models.keyposes.program import SITES, TrainedKeyposes, probability
from bayesmotion.motion.synthetic.dance import synthetic_dance

SITES_TRUE = {
    "deep_global": 0.3,
    "deep_body": 1.0,
    "log_slope": 1.3,
    "lag": 0.05,
    "log_width": -2.0,
}
density = jax.jit(lambda model, data, values: of_program(model.program, data, {}, values)[0],
                  static_argnums=0)  # fmt: skip
TRUE = {name: np.asarray(value) for name, value in SITES_TRUE.items()}
MODEL = Keyposes()


def made(n=60, seed=0, unknown=()):
    random = np.random.default_rng(seed)
    columns = random.normal(size=n), random.normal(size=n), 0.1 * random.normal(size=n)
    known = np.ones((n, 1), bool)
    known[list(unknown)] = False
    data = KeyposeData(*columns, np.zeros((n, 1)), known)
    p = np.asarray(probability(data, TrainedKeyposes(**TRUE)))
    answer = (random.random(n) < p).astype(float)[:, None]
    return data._replace(keypose=np.where(known, answer, 0.0)), p


def by_hand(data, values):
    total = (
        norm.logpdf(values["deep_global"], 0, 1.5) + norm.logpdf(values["deep_body"], 0, 1.5)
        + norm.logpdf(values["log_slope"], np.log(3), 0.7) + norm.logpdf(values["lag"], 0, 0.1)
        + norm.logpdf(values["log_width"], np.log(0.1), 0.5)
    )  # fmt: skip
    slope, width = np.exp(values["log_slope"]), np.exp(values["log_width"])
    each = []
    for g, h, o, k, known in zip(*data, strict=True):
        one = 1 / (1 + np.exp(-slope * (g - values["deep_global"])))
        two = 1 / (1 + np.exp(-slope * (h - values["deep_body"])))
        p = (1 - (1 - one) * (1 - two)) * np.exp(-((o - values["lag"]) ** 2) / (2 * width**2))
        each.append(np.log(p if k[0] else 1 - p) if known[0] else 0.0)
    return total, np.array(each)


def test_the_program_has_the_density_written_by_hand_and_unknown_answers_have_no_part():
    data, _ = made(unknown=(3, 7))
    prior, each = by_hand(data, TRUE)
    found = float(density(MODEL, (data,), TRUE))
    assert found == pytest.approx(prior + each.sum(), rel=1e-6)
    np.testing.assert_allclose(jax.jit(MODEL.pointwise)(data, TRUE), each, rtol=1e-5, atol=1e-9)
    kept = np.setdiff1d(np.arange(60), (3, 7))
    dropped = KeyposeData(*(column[kept] for column in data))
    again = float(density(MODEL, (dropped,), TRUE))
    assert again == pytest.approx(found, rel=1e-9)


def test_probability_is_high_only_for_deep_minima_near_the_lag():
    depths = np.array([[3.0, -4.0, 3.0], [-4.0, -4.0, 3.0]])
    offset, known = np.array([0.05, 0.05, 0.6]), np.ones((3, 1), bool)
    one = KeyposeData(*depths, offset, np.zeros((3, 1)), known)
    p = np.asarray(probability(one, TrainedKeyposes(**TRUE)))
    assert p[0] > 0.95
    assert p[1] < 0.01
    assert p[2] < 0.01


def test_rows_are_the_beats_with_a_minimum():
    one = Minima(
        np.array([10, -1, -1]), np.array([1, np.nan, np.nan]), np.array([2, np.nan, np.nan])
    )
    two = Minima(np.array([11, 20, -1]), np.array([1, 1, np.nan]), np.array([1, 4, np.nan]))
    rows = clip_minima(one, two, np.array([9.0, 22.0, 40.0]), 10.0)
    assert rows.frame.tolist() == [10, 20]
    np.testing.assert_allclose(rows.offset, [0.1, -0.2])
    assert rows.in_global[1] == -4.0


def test_answers_need_all_frames_near_to_be_looked_at_but_for_a_yes():
    looked = np.zeros(40)
    looked[12], looked[30:] = 1.0, np.nan
    yes, known = answers(np.array([10, 15, 20, 29]), looked, 2.0)
    assert yes.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert known.tolist() == [True, True, True, False]


def test_beats_go_into_the_recording_and_come_back():
    dance = synthetic_dance(0, beats=6)
    for beats in (dance.beats, np.array([0.313, 0.9, 1.55, 2.2])):
        back = beats_of(with_beats(dance.motion, beats)) / 60.0
        np.testing.assert_allclose(back, beats, atol=2e-3)
    with pytest.raises(InputError, match="fewer than two"):
        with_beats(dance.motion, np.array([1.0]))


def test_missing_joints_leave_gaps_in_the_energy_or_count_for_nothing():
    random = np.random.default_rng(0)
    position = np.cumsum(random.normal(size=(60, 4, 3)), axis=0)
    gap = position.copy()
    gap[20:23, 1] = np.nan
    found, whole = energy(gap, 30.0), energy(position, 30.0)
    assert np.isnan(found).tolist() == [20 <= i < 23 for i in range(60)]
    far = np.abs(np.arange(60) - 21) > 14
    np.testing.assert_allclose(found[far], whole[far], rtol=1e-6)
    limb = position.copy()
    limb[:, 2] = np.nan
    np.testing.assert_allclose(energy(limb, 30.0), energy(position[:, [0, 1, 3]], 30.0))


@pytest.fixture(scope="module")
def example():
    return Keyposes.example(0)


@pytest.fixture(scope="module")
def fits(example):
    model, dances = example
    return {
        "map": bm.fit(model, dances, method=bm.MAP(initial=2)),
        "nuts": bm.fit(model, dances, method=bm.NUTS(draws=300, warmup=300, chains=2)),
        "ensemble": bm.fit(model, dances, method=bm.Ensemble(draws=2000, steps=3000)),
    }


@pytest.mark.filterwarnings("ignore")
def test_nuts_and_the_ensemble_agree_within_their_errors(fits):
    import arviz as az

    worth = json.loads(fits["ensemble"].tree.attrs["ess"])
    for name in SITES:
        a, b = (fits[how].tree["posterior"][name] for how in ("nuts", "ensemble"))
        error = np.sqrt(float(a.var()) / float(az.ess(a)) + float(b.var()) / worth[name])
        assert abs(float(a.mean() - b.mean())) < 4 * error, name


def test_predictions_average_over_the_draws_and_beat_the_share(example, fits):
    model, _ = example
    new = Keyposes.example(1)[1]
    found = predict(fits["nuts"], new).site().means()[:, 0]
    answer = model.prepare(new).observed()["keypose"].values[:, 0]
    share = float(fits["nuts"].training.observed()["keypose"].mean())

    def score(p):
        return np.log(np.where(answer > 0, p, 1 - p)).mean()

    assert score(found) > score(np.full(len(answer), share))
    draws = fits["nuts"].tree["posterior"].ds
    data = model.prepare(new).minima
    sites = TrainedKeyposes(*(draws[n].values.ravel() for n in SITES))
    each = np.asarray(jax.jit(jax.vmap(partial(probability, data)))(sites))
    all_draws = predict(fits["nuts"], new, draws=600).site().means()[:, 0]
    np.testing.assert_allclose(all_draws, np.mean(each, axis=0), atol=1e-9)


def test_answers_nobody_gave_are_predicted(example, fits):
    _, dances = example
    unknown = dances.assign(keypose=("frame", np.full(dances.sizes["frame"], np.nan)))
    told, again = (predict(fits["map"], one).site().means() for one in (dances, unknown))
    np.testing.assert_allclose(told, again)
    with pytest.raises(InputError, match="no answer is known"):
        Keyposes().prepare(unknown)
    with pytest.raises(InputError, match="no beat"):
        Keyposes().prepare(dances.drop_vars("beat"))


def test_every_setting_changes_the_density(example):
    _, dances = example
    settings = [
        Keyposes(), Keyposes(window=0.1), Keyposes(tolerance=0.03), Keyposes(smoothing=0.02),
        Keyposes(weights="masses"),
    ]  # fmt: skip
    found = {float(density(m, m.prepare(dances).data, TRUE)) for m in settings}
    assert len(found) == len(settings)
    for bad in ({"window": 0.0}, {"tolerance": -1.0}):
        with pytest.raises(InputError, match="positive seconds"):
            Keyposes(**bad)
    # A caller whose types are not checked is told so in a sentence.
    with pytest.raises((InputError, TypeCheckError), match=r"no such weights|parameter 'weights'"):
        Keyposes(weights="heavy")


def test_the_calibration_case_draws_answers_of_both_kinds():
    case, data = MODEL.sbc_case()
    values, seen = jax.jit(case.draw, static_argnums=0)(case.model, jax.random.key(3), data)
    assert set(np.unique(seen.keypose)) <= {0.0, 1.0}
    assert set(values) == set(SITES)
