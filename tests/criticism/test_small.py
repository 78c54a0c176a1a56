"""The small versions of the models: what is drawn, what is spoilt, what is looked at."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.criticism.calibration import calibrate, quantities
from bayesmotion.criticism.controls import FAULTS, Faults, Wrong
from bayesmotion.criticism.small import KINDS, REFUSED, small_trial
from bayesmotion.criticism.small.tensor import _root
from bayesmotion.errors import InputError
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.model import Marginalised, model_names

TURN = np.array([[0.6, -0.8], [0.8, 0.6]])


def turned(values):
    return {**values, "x": values["x"] @ TURN}


def reflected(values):
    return {**values, "x": -values["x"]}


def swapped(values):
    """Components in the other order, one direction the other way."""
    other = {name: jnp.asarray(value)[::-1] for name, value in values.items()}
    return {**other, "factor": other["factor"].at[0].multiply(-1.0)}


def mirrored(values):
    return {**reflected(values), "face_private": -values["face_private"]}


# What no data can tell: the same draw in other words.
SAME = {
    ("multifactor", "gp_second"): turned,
    ("mixture_ppca", "mixture_ppca"): swapped,
    ("shared-gplvm", "free"): mirrored,
    ("gait-pose", "gplvm"): reflected,
    ("gait-pose", "on_torus"): None,
    ("tensor", "tensor"): None,
    ("relevance_vector", "relevance_vector"): None,
}


@pytest.mark.parametrize(("model", "kind"), SAME)
def test_a_draw_fits_its_program_and_every_fault_is_felt(model, kind):
    trial, data = small_trial(model, kind)
    values, seen = jax.jit(lambda key: trial.draw(trial.model, key, data))(jax.random.key(1))

    @jax.jit
    def looked_at(faults, seen, values):
        wrong = Wrong(trial, faults)
        density = ProgramDensity(wrong, jacobian=True)
        real = density.real(values, (seen,))
        natural = density.natural(real, (seen,))
        if isinstance(trial.model, Marginalised):
            natural = {**values, **natural}
        return density(real, (seen,)), quantities(wrong, seen, values), natural

    right, found, natural = looked_at(Faults(), seen, values)
    for name, value in natural.items():
        np.testing.assert_allclose(value, values[name], rtol=1e-9, err_msg=name)
    leaves = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(found)])
    assert np.isfinite(leaves).all()
    change = SAME[model, kind]
    if change is not None:
        _, again, _ = looked_at(Faults(), seen, change(values))
        for name, value in found.items():
            np.testing.assert_allclose(again[name], value, rtol=1e-7, atol=1e-9, err_msg=name)
    for control in ("prior", "noise"):
        wrong, spoilt, _ = looked_at(FAULTS[control], seen, values)
        assert abs(float(wrong - right)) > 1e-3
        told = float(spoilt["log_density"] - found["log_density"])
        assert (abs(told) > 1e-3) == (control == "noise")
    other = trial.shuffle(jax.random.key(2), seen)
    wrong, _, _ = looked_at(Faults(), other, values)
    assert abs(float(wrong - right)) > 1e-3
    pairs = zip(jax.tree.leaves(other), jax.tree.leaves(seen), strict=True)
    for one, same in pairs:
        np.testing.assert_array_equal(np.sort(np.ravel(one)), np.sort(np.ravel(same)))


@pytest.mark.parametrize(("model", "kinds"), REFUSED.items())
def test_what_cannot_be_drawn_from_is_refused(model, kinds):
    for kind in kinds:
        with pytest.raises(InputError, match=r"constant, which depends on|function of the data"):
            calibrate(*small_trial(model, kind), simulations=1, seed=0)


def test_every_model_has_a_small_version():
    assert set(KINDS) == set(model_names()) - {"line", "mean_cycle"}
    for names in ((), ("circle_white",)):
        with pytest.raises(InputError, match=r"there is no such|has no such"):
            small_trial("tensor" if names else "tensors", *names)


def test_a_root_of_sigma_is_that_of_an_inverse_wishart_matrix():
    keys = jax.random.split(jax.random.key(0), 4000)
    root = jax.vmap(lambda key: _root(key, jnp.array(2.0), jnp.array(5.0), 2))(keys)
    precision = np.linalg.inv(np.asarray(root @ root.transpose(0, 2, 1)))
    # Wishart with 5 degrees of freedom and scale I / 2.
    errors = precision.std(axis=0) / np.sqrt(len(keys))
    assert np.abs((precision.mean(axis=0) - 2.5 * np.eye(2)) / errors).max() < 3.5
    assert np.var(precision[:, 0, 1]) == pytest.approx(5.0 / 4.0, rel=0.1)
