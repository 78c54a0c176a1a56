"""Blocks give what the function gives entry by entry."""

import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.inference.draws import in_blocks


@pytest.mark.parametrize(("count", "size"), [(7, 3), (6, 3), (2, 8), (1, 1)])
def test_every_entry_is_mapped_once(count: int, size: int):
    random = np.random.default_rng(0)
    values = {"a": random.normal(size=(count, 4)), "none": np.zeros((count, 0))}
    found = in_blocks(lambda v: (jnp.sum(v["a"]), v["none"]), values, size)
    np.testing.assert_allclose(found[0], values["a"].sum(axis=1))
    assert found[1].shape == (count, 0)
