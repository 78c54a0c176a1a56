"""Whitening of clips' own processes against their dense covariance."""

import jax
import jax.numpy as jnp
import numpy as np

from bayesmotion.gp.markov import BLOCK, draw, lanes_of, whiten

SIZES = (7, 2, 5, 1, 4)
CLIP = np.repeat(np.arange(len(SIZES)), SIZES)
N = len(CLIP)
TIME = np.random.default_rng(0).uniform(0.2, 3.0, size=N).cumsum()
VARIANCE = np.array([0.5, 2.0, 0.0, 1.0, 0.3])
SCALE = np.array([2.0, 0.5, 1.0, 3.0, 9.0])
NOISE = 0.1


def covariance():
    apart = np.abs(TIME[:, None] - TIME) / SCALE[CLIP]
    return (CLIP[:, None] == CLIP) * VARIANCE[CLIP] * np.exp(-apart)


def filtered(lanes):
    """Decays and variances in lanes, by hand."""
    before = np.where(np.diff(CLIP, prepend=-1) == 0, np.diff(TIME, prepend=0.0), np.inf)
    decay = lanes.placed(np.exp(-before / SCALE[CLIP]))
    return decay, lanes.of_clips(VARIANCE)


def test_every_frame_has_one_place_and_follows_its_own_clip():
    sizes = (3, BLOCK, 5 * BLOCK + 1, 2 * BLOCK, 1)
    lanes, clip = lanes_of(sizes), np.repeat(np.arange(5), sizes)
    there = lanes.frame < len(clip)
    assert sorted(lanes.frame[there]) == list(range(len(clip)))
    assert lanes.frame.shape == (6 * BLOCK, 2)
    owner = np.repeat(lanes.clip, BLOCK, axis=0)
    np.testing.assert_array_equal(owner[there], clip[lanes.frame[there]])
    first = np.isin(lanes.frame, np.concatenate([[0], np.cumsum(sizes)[:-1]]))
    np.testing.assert_array_equal(lanes.follows, there & ~first)
    place, lane = np.nonzero(lanes.follows)
    np.testing.assert_array_equal(lanes.frame[place - 1, lane] + 1, lanes.frame[place, lane])


def test_a_block_has_frames_of_one_clip():
    sizes = (3, BLOCK, 5 * BLOCK + 1, 2 * BLOCK, 1)
    lanes, clip = lanes_of(sizes), np.repeat(np.arange(5.0), sizes) + 1.0
    blocks = np.asarray(lanes.blocks(lanes.placed(clip[:, None])))[:, :, 0]
    for block, owner in zip(blocks, lanes.clip.ravel(), strict=True):
        assert set(block) <= {0.0, owner + 1.0}
    assert (blocks > 0.0).sum() == len(clip)


def test_values_come_back_from_their_places():
    lanes, values = lanes_of(SIZES), np.random.default_rng(1).normal(size=(N, 3))
    np.testing.assert_array_equal(lanes.taken(lanes.placed(values), N), values)
    np.testing.assert_array_equal(lanes.taken(lanes.of_clips(SCALE), N), SCALE[CLIP])


def test_whitened_columns_have_the_inverse_covariance_between_them():
    lanes = lanes_of(SIZES)
    seen = np.ones(N)
    seen[[0, 3, 4, 7, 14]] = 0.0
    z = np.random.default_rng(2).normal(size=(N, 4))
    K = covariance() + NOISE * np.eye(N)
    K, rows = K[np.ix_(seen > 0, seen > 0)], z[seen > 0]
    white, logdet = whiten(
        lanes.placed(z), lanes.placed(seen), *filtered(lanes), lanes.placed(NOISE * seen)
    )
    np.testing.assert_allclose(
        jnp.einsum("tlk,tlj->kj", white, white), rows.T @ np.linalg.solve(K, rows), rtol=1e-12
    )
    np.testing.assert_allclose(logdet, np.linalg.slogdet(K)[1], rtol=1e-12)


def test_draws_have_the_covariance():
    lanes = lanes_of(SIZES)
    decay, variance = filtered(lanes)
    # Of unit columns the draws are a root of the covariance.
    unit = lanes.placed(jnp.eye(N))
    root = lanes.taken(draw(unit, decay, variance), N)
    np.testing.assert_allclose(root @ root.T, covariance(), atol=1e-14)


def test_gradients_are_those_of_the_dense_covariance():
    lanes, seen = lanes_of(SIZES), np.ones(N)
    seen[:8] = seen[16] = 0.0
    z = np.random.default_rng(3).normal(size=(N, 2))
    apart = np.abs(TIME[:, None] - TIME) * (CLIP[:, None] == CLIP)
    before = lanes.placed(np.diff(TIME, prepend=0.0))

    def filtering(z, scale, variance, noise):
        decay = lanes.follows * jnp.exp(-before / lanes.of_clips(scale))
        return whiten(
            lanes.placed(z), lanes.placed(seen), decay, lanes.of_clips(variance),
            noise * lanes.placed(seen),
        )  # fmt: skip

    def by_filter(*args):
        white, logdet = filtering(*args)
        return jnp.sum(white**2 * jnp.array([1.0, 3.0])) + logdet

    def densely(z, scale, variance, noise):
        K = (CLIP[:, None] == CLIP) * variance[CLIP] * jnp.exp(-apart / scale[CLIP])
        K = (K + noise * jnp.eye(N))[np.ix_(seen > 0, seen > 0)]
        rows = z[seen > 0]
        squares = jnp.diag(rows.T @ jnp.linalg.solve(K, rows))
        return squares @ jnp.array([1.0, 3.0]) + jnp.linalg.slogdet(K)[1]

    at = (jnp.asarray(z), jnp.asarray(SCALE), jnp.asarray(VARIANCE), jnp.array(NOISE))
    found, true = (jax.grad(f, (0, 1, 2, 3))(*at) for f in (by_filter, densely))
    for one, other in zip(found, true, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)

    def slope(f):
        return lambda scale: jax.grad(f, 1)(at[0], scale, *at[2:])

    found, true = (jax.jacrev(slope(f))(at[1]) for f in (by_filter, densely))
    np.testing.assert_allclose(found, true, rtol=1e-8, atol=1e-9)
