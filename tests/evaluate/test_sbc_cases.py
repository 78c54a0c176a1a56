"""The calibration cases of all models: exact draws, and faults that are felt."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.evaluate.sbc.calibration import calibrate_case, quantities
from bayesmotion.evaluate.sbc.controls import FAULTS, Faults, Wrong
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.model import Marginalised
from bayesmotion.models.gait_pose import VARIANTS
from bayesmotion.models.multifactor import OU, GPDynamics, Multifactor, White
from bayesmotion.registry import model_class, model_names
from bayesmotion.studies.calibration.study import default_model

TURN = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
SHIPPED = {
    name: default_model(model_class(name))
    for name in model_names()
    if name not in ("line", "mean_cycle")
}
VARIED = {
    "multifactor, white": Multifactor(residual=White()),
    "multifactor, one residual": Multifactor(residual=OU(per_clip=False)),
    "multifactor, first order": Multifactor(content=GPDynamics(order=1), residual=White()),
    "multifactor, second order": Multifactor(content=GPDynamics(), residual=White()),
    "gait_pose, free points": VARIANTS["gplvm"],
    "gait_pose, on a torus": VARIANTS["on_torus1"],
}


def turned(values):
    return {**values, "x": values["x"] @ TURN}


def swapped(values):
    """Components in the other order, one direction the other way."""
    other = {name: jnp.asarray(value)[::-1] for name, value in values.items()}
    return {**other, "factor": other["factor"].at[0].multiply(-1.0)}


def mirrored(values):
    """Latent coordinates in the other order, the other way round."""
    both = {name: values[name][::-1] for name in ("audio_gamma", "face_gamma")}
    return {**values, **both, "x": -values["x"][:, ::-1]}


def renumbered(values):
    """States numbered the other way round."""
    other = {name: jnp.asarray(value)[::-1] for name, value in values.items()}
    return {**other, "transition": other["transition"][:, ::-1]}


# What no data can tell: the same draw in other words.
SAME = {
    "mixture_ppca": swapped,
    "shared_gplvm": mirrored,
    "voice_puppetry": renumbered,
    "multifactor, second order": turned,
}


@pytest.mark.parametrize("name", [*SHIPPED, *VARIED])
def test_a_draw_fits_its_program_and_every_fault_is_felt(name):
    model = (SHIPPED | VARIED)[name]
    case, data = model.sbc_case()
    values, seen = jax.jit(lambda key: case.draw(case.model, key, data))(jax.random.key(1))

    @jax.jit
    def looked_at(faults, seen, values):
        wrong = Wrong(case, faults)
        density = ProgramDensity(wrong, jacobian=True)
        real = density.real(values, (seen,))
        natural = density.natural(real, (seen,))
        if isinstance(case.model, Marginalised):
            natural = {**values, **natural}
        return density(real, (seen,)), quantities(wrong, seen, values), natural

    right, found, natural = looked_at(Faults(), seen, values)
    for site, value in natural.items():
        np.testing.assert_allclose(value, values[site], rtol=1e-9, err_msg=site)
    leaves = np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(found)])
    assert np.isfinite(leaves).all()
    if name in SAME:
        _, again, _ = looked_at(Faults(), seen, SAME[name](values))
        for site, value in found.items():
            np.testing.assert_allclose(again[site], value, rtol=1e-7, atol=1e-9, err_msg=site)
    for control in ("prior", "noise"):
        wrong, spoilt, _ = looked_at(FAULTS[control], seen, values)
        assert abs(float(wrong - right)) > 1e-3
        told = float(spoilt["log_density"] - found["log_density"])
        assert (abs(told) > 1e-3) == (control == "noise")
    other = case.shuffle(jax.random.key(2), seen)
    wrong, _, _ = looked_at(Faults(), other, values)
    assert abs(float(wrong - right)) > 1e-3
    for one, same in zip(jax.tree.leaves(other), jax.tree.leaves(seen), strict=True):
        np.testing.assert_array_equal(np.sort(np.ravel(one)), np.sort(np.ravel(same)))


@pytest.mark.parametrize(
    "model",
    [Multifactor(content=GPDynamics(balanced=True)), VARIANTS["gpdm"], VARIANTS["ll_gpdm"]],
    ids=["balanced", "gpdm", "ll_gpdm"],
)
def test_what_cannot_be_drawn_from_is_refused(model):
    with pytest.raises(InputError, match=r"constant, which depends on"):
        calibrate_case(*model.sbc_case(), simulations=1, seed=0)


def test_the_case_is_of_the_settings_given():
    narrow = replace(SHIPPED["gait_pose"], subject_noise_sd=0.1)
    assert narrow.sbc_case()[0].model.subject_noise_sd == 0.1
