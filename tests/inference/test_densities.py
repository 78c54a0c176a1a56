"""What is no density is refused by all that would take it for one."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpyro
import pytest
from numpyro import distributions as dist
from numpyro.handlers import condition, seed

from bayesmotion.errors import InputError
from bayesmotion.gp.unnormalised import Marked, NoDensity, factor
from bayesmotion.inference.densities import require_densities
from bayesmotion.inference.sampling.ensemble import fit_ensemble
from bayesmotion.inference.sampling.nuts import fit_nuts
from bayesmotion.models.gait_pose import GaitPose, PathDynamics
from bayesmotion.models.multifactor import GPDynamics, Multifactor
from bayesmotion.motion.cycles import cycles_of
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

KEY = jax.random.key(0)
PRODUCT = NoDensity("no constant", "Fix a", ("a",))


def product():
    a = numpyro.sample("a", dist.LogNormal())
    x = numpyro.sample("x", Marked(dist.Normal(0.0, a), PRODUCT))
    factor("more", -jnp.square(x) * a, replace(PRODUCT, what="no constant either"))


def bound():
    factor("y", numpyro.sample("x", dist.Normal()), NoDensity("a bound", "Use map"))


def test_a_product_is_refused_until_what_its_constant_depends_on_is_fixed():
    with pytest.raises(InputError, match=r"site 'x': no constant.*Fix a"):
        require_densities(seed(product, KEY), ())
    fixed = condition(product, data={"a": jnp.array(1.0)})
    require_densities(seed(fixed, KEY), ())


def test_a_bound_is_refused_whatever_is_fixed():
    with pytest.raises(InputError, match=r"site 'y': a bound.*Use map"):
        require_densities(seed(condition(bound, data={"x": jnp.array(1.0)}), KEY), ())


def test_marks_change_no_number():
    def plain():
        a = numpyro.sample("a", dist.LogNormal())
        x = numpyro.sample("x", dist.Normal(0.0, a))
        numpyro.factor("more", -jnp.square(x) * a)

    at = {"a": jnp.array(0.7), "x": jnp.array(-1.3)}
    densities = [
        jax.jit(lambda at, one=one: numpyro.infer.util.log_density(one, (), {}, at)[0])(at)
        for one in (plain, product)
    ]
    assert densities[0] == densities[1]


@pytest.fixture(scope="module")
def walks():
    return synthetic_walkers(("ann", "ben"), ("walk",), seconds=2.6, frame_rate=30.0)


@pytest.mark.parametrize("fit", [fit_nuts, fit_ensemble])
def test_samplers_refuse_what_has_no_density(walks, fit):
    few = walks.isel(frame=walks["time"].values < 0.5)
    with pytest.raises(InputError, match=r"'x'.*balanced.*alpha.*not balanced.*method map"):
        fit(Multifactor(GPDynamics(balanced=True)), few)
    with pytest.raises(InputError, match=r"'dynamics'.*multiplies.*alpha.*without dynamics"):
        fit(GaitPose(dynamics=PathDynamics()), cycles_of(walks, 1, poses=6))
