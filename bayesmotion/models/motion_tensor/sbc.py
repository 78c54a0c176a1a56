"""A small tensor model: three people, two tasks, three repetitions of every cell.

The main effects have a flat prior and no draws. They are integrated out, so that the
posterior of the other numbers is that given what main effects leave of the data, which
has a proper density and is the same whatever the effects are: here they are as large as
the root of the scale.
"""

import itertools
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import NoiseMeaning, SBCCase, Values, draw_sites, shuffled
from ...models.multifactor_tensor import SITES, MultifactorTensor, TensorData, tensor_data

PEOPLE, TASKS, REPETITIONS, POSITIONS = 3, 2, 3, 2


def trial(kind: str) -> tuple[SBCCase, TensorData]:
    """Give the small model and its data."""
    assert kind == "tensor"
    cells = list(itertools.product(range(PEOPLE), range(TASKS)))
    level = np.repeat(np.array(cells), REPETITIONS, axis=0)
    data = tensor_data(np.zeros((len(level), POSITIONS)), level, (PEOPLE, TASKS))
    noise: NoiseMeaning = "log_odds"
    model = MultifactorTensor()
    return SBCCase(model, _draw, _shuffle, _quantities, "log_odds", (("log_odds", noise),)), data


def _draw(
    model: MultifactorTensor, key: PRNGKeyArray, data: TensorData
) -> tuple[Values, TensorData]:
    """Draw the three numbers, Sigma, and segments with all their effects."""
    site_key, sigma_key, cell_key, key = jax.random.split(key, 4)
    values = draw_sites(model, site_key, data)
    values = {name: values[name] for name in SITES}
    n, q = data.y.shape
    root = _root(sigma_key, jnp.exp(values["log_scale"]), jnp.exp(values["log_dof"]) + q - 1.0, q)
    share = jax.nn.sigmoid(values["log_odds"])
    # Segments of one cell share the draw of the first of them.
    first = jnp.argmax(jnp.asarray(data.same), axis=1)
    cell = jax.random.normal(cell_key, (n, q))[first] @ root.T
    repetition = jax.random.normal(key, (n, q)) @ root.T
    size = jnp.exp(0.5 * values["log_scale"])
    effects = size * jnp.asarray(data.design) @ jnp.ones((data.design.shape[1], q))
    y = effects + jnp.sqrt(share) * cell + jnp.sqrt(1.0 - share) * repetition
    return values, data._replace(y=y)


def _root(key: PRNGKeyArray, scale: AnyArray, nu: AnyArray, q: int) -> Array:
    """Draw a root of Sigma ~ InverseWishart(nu, scale I), through Bartlett's factor of Sigma^-1.

    Sigma^-1 = A A^T / scale, A lower triangular, of chi variables with nu - i degrees of
    freedom on the diagonal (i = 0, 1, ..) and standard normal ones below it.
    """
    below_key, key = jax.random.split(key)
    freedom = nu - jnp.arange(q)
    diagonal = jnp.sqrt(2.0 * jax.random.gamma(key, 0.5 * freedom))
    A = jnp.tril(jax.random.normal(below_key, (q, q)), -1) + jnp.diag(diagonal)
    return jnp.sqrt(scale) * jnp.linalg.inv(A).T


def _shuffle(key: PRNGKeyArray, data: TensorData) -> TensorData:
    """Put all segments in a random order, whosever and whatever they are."""
    return data._replace(y=shuffled(key, data.y, np.zeros(len(data.y), int)))


def _quantities(
    model: MultifactorTensor, data: TensorData, values: Mapping[str, AnyArray]
) -> Values:
    """Give the three numbers."""
    return {name: jnp.asarray(values[name]) for name in SITES}
