"""One person against the norm: p values of people of it, and of who is not."""

import numpy as np
import pytest
from scipy.stats import kstest

import bayesmotion as bm

T = np.linspace(0.0, 100.0, 31)
WAVES = np.stack([np.cos(k * np.pi * T / 100.0) for k in range(5)])


def strides(random, people, each=1, sd=1.0):
    own = np.repeat(random.normal(size=(people, 5)) @ WAVES, each, axis=0)
    curves = 20.0 + own + sd * (each > 1) * random.normal(size=(people * each, 5)) @ WAVES
    return bm.read_curves(
        curves,
        labels={"subject": [f"p{number:02}" for number in range(people) for _ in range(each)]},
    )


def test_p_values_of_people_of_the_norm_are_uniform_however_few_there_are():
    random = np.random.default_rng(0)
    p, naive = [], []
    for _ in range(50):
        curves = strides(random, 6)
        found = bm.norm(curves, "p00", draws=400)
        p.append(found.p)
        rest = curves.values[1:]
        away = np.abs(curves.values[0] - rest.mean(axis=0)) / rest.std(axis=0, ddof=1)
        new = np.abs(random.normal(size=(400, 5)) @ WAVES) / np.sqrt((WAVES**2).sum(axis=0))
        naive.append(np.mean(new.max(axis=1) >= away.max()))
    assert kstest(p, "uniform").pvalue > 0.05
    # A control: as if mean and sd of five people were those of all.
    assert kstest(naive, "uniform").pvalue < 0.01


def test_who_leaves_the_norm_is_found_where():
    curves = strides(np.random.default_rng(1), 12, 4)
    limp = 8.0 * np.exp(-0.5 * ((T - 60.0) / 8.0) ** 2)
    curves = curves + limp * (curves["subject"].values == "p03")[:, None]
    curves.name = "knee"
    found = bm.norm({"knee": curves, "hip": strides(np.random.default_rng(2), 12, 4)}, "p03")
    knee, hip = found.channels["knee"], found.channels["hip"]
    assert knee.p < 0.01 < 0.02 < hip.p
    assert 40.0 < T[knee.outside].min() < 60.0 < T[knee.outside].max() < 80.0
    assert not hip.outside.any()
    assert found.p == pytest.approx(2 * knee.p)
    assert "outside from" in repr(found)


def test_many_strides_of_a_person_leave_less_open():
    curves = strides(np.random.default_rng(3), 10, 8, sd=3.0)
    alone = curves.isel(stride=np.r_[0, 8:80])
    assert np.all(bm.norm(alone, "p00").channels["value"].sd
                  > 1.3 * bm.norm(curves, "p00").channels["value"].sd)  # fmt: skip


def test_what_is_no_norm_is_refused():
    curves = strides(np.random.default_rng(0), 5)
    with pytest.raises(bm.InputError, match="no stride is of it"):
        bm.norm(curves, "somebody")
    with pytest.raises(bm.InputError, match="3 others"):
        bm.norm(curves.isel(stride=slice(0, 3)), "p00")
    with pytest.warns(bm.MotionWarning, match="norm is of 4 people"):
        bm.norm(curves, "p00", draws=50)
