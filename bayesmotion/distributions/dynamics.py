"""Gaussian process dynamics on the latent path (GPDM, balanced GPDM).

x_t = h(state) + noise with a Gaussian process prior on h, one for each latent
dimension with the same covariance. Of first order (Wang, Fleet, Hertzmann 2007,
eq. 16) the state is x = x_{t-1}:

    k = alpha_1 exp(-alpha_2 / 2 |x - x'|^2) + alpha_3 x^T x' + delta / alpha_4

Of second order (Wang, Fleet, Hertzmann 2008, eq. 12, with the velocity in place of
the frame before) it is x = x_{t-1} and v = x_{t-1} - x_{t-2}, so that a path passes
the same place slowly or fast, each time going on as it came:

    k = alpha_1 exp(-alpha_2 / 2 |x - x'|^2 - alpha_3 / 2 |v - v'|^2)
        + alpha_4 x^T x' + alpha_5 v^T v' + delta / alpha_6

With h integrated out, all steps of all clips are one matrix-normal; no step
leads from one clip into another. The frames of a clip that have no state before
them, its first or its first two, are N(0, I).

In the balanced model (Urtasun, Fleet, Fua 2006) the log density of the steps
is multiplied by D / Q, so that it weighs as much as the D observed dimensions.
"""

from collections.abc import Sequence
from functools import partial
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ..gp.kernels import Kernel, Points, linear, rbf
from ..gp.linalg import AnyArray, cholesky, inverse_factor
from ..gp.matrix_normal import Conditioned, complete, condition, log_density


class Steps(NamedTuple):
    """Where clips begin and which frame follows which.

    first
        (C,) index of the first frame of each clip.
    before, after
        (T,) indices such that frame ``after[i]`` follows frame ``before[i]``.
    opening, later
        (B,) and (T - B,) which of the steps are a clip's first, and all others.
    """

    first: Int[AnyArray, " c"]
    before: Int[AnyArray, " t"]
    after: Int[AnyArray, " t"]
    opening: Int[AnyArray, " b"]
    later: Int[AnyArray, " l"]


class GivenSteps(NamedTuple):
    """Steps seen in training: the states they began in, and the process conditioned on them."""

    alpha: Float[AnyArray, " a"]
    states: Points
    after: Float[AnyArray, "t q"]
    conditioned: Conditioned


def steps_of(sizes: Sequence[int]) -> Steps:
    """Give the steps of clips of so many frames, one after another."""
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(int)
    after = np.setdiff1d(np.arange(sum(sizes)), first)
    opens = np.isin(after - 1, first)
    return Steps(first, after - 1, after, np.flatnonzero(opens), np.flatnonzero(~opens))


def order_of(alpha: Float[AnyArray, " a"]) -> int:
    """Give the order of the dynamics whose hyperparameters these are, 1 (four) or 2 (six)."""
    return {4: 1, 6: 2}[alpha.shape[0]]


def kernel(alpha: Float[AnyArray, " a"]) -> Kernel:
    """Covariance of h on the factor ``x``, and of second order also ``v``, without the noise."""
    near = rbf("x", length_scale=alpha[1] ** -0.5, variance=alpha[0])
    if order_of(alpha) == 1:
        return near + linear("x", variance=alpha[2])
    alike = near * rbf("v", length_scale=alpha[2] ** -0.5)
    return alike + linear("x", variance=alpha[3]) + linear("v", variance=alpha[4])


def _covariance(alpha: Float[AnyArray, " a"], states: Points) -> Float[Array, "t t"]:
    K = kernel(alpha).matrix(states, states)
    return K + jnp.eye(len(K)) / alpha[-1]


def _states(
    order: int, x: Float[AnyArray, "n q"], steps: Steps
) -> tuple[dict[str, AnyArray], Float[AnyArray, "s q"]]:
    """States that the steps of a path begin in, and where they lead."""
    after = _led_to(order, steps)
    if order == 1:
        return {"x": x[after - 1]}, x[after]
    return {"x": x[after - 1], "v": x[after - 1] - x[after - 2]}, x[after]


def _led_to(order: int, steps: Steps) -> Int[AnyArray, " s"]:
    """Frames with a state before them."""
    return steps.after if order == 1 else steps.after[steps.later]


def _stateless(order: int, steps: Steps) -> Int[AnyArray, " f"]:
    """Frames without a state before them."""
    if order == 1:
        return steps.first
    return jnp.concatenate([steps.first, steps.after[steps.opening]])


def given_steps(alpha: AnyArray, x: AnyArray, steps: Steps) -> GivenSteps:
    """Condition h on the steps of a latent path."""
    return _given(alpha, *_states(order_of(alpha), x, steps))


def with_path(given: GivenSteps, x: AnyArray) -> GivenSteps:
    """Condition h on the steps of one path more."""
    states, after = _states(order_of(given.alpha), x, steps_of([len(x)]))
    both = {name: jnp.concatenate([given.states[name], states[name]]) for name in states}
    return _given(given.alpha, both, jnp.concatenate([given.after, after]))


def _given(alpha: AnyArray, states: Points, after: AnyArray) -> GivenSteps:
    known = condition(after, _covariance(alpha, states), complete(*after.shape))
    return GivenSteps(alpha, states, after, known)


@partial(jax.jit, static_argnames="length")
def roll_out(given: GivenSteps, x: Float[AnyArray, "m q"], length: int) -> Float[Array, "n q"]:
    """Continue a path (at least two frames) to `length` frames.

    Each frame is the mean of what follows the state before it.
    """
    weights = given.conditioned.inverse[0].T @ given.conditioned.half[0]

    def step(state, _):
        previous, last = state
        here = {"x": last[None], "v": (last - previous)[None]}
        after = (kernel(given.alpha).matrix(here, given.states) @ weights)[0]
        return (last, after), after

    rest = jax.lax.scan(step, (x[-2], x[-1]), length=length - len(x))[1]
    return jnp.concatenate([x, rest])


def path_root(
    alpha: Float[AnyArray, " a"],
    x: Float[AnyArray, "n q"],
    steps: Steps,
    given: GivenSteps | None,
    weight: float,
    precision: float,
) -> Float[Array, "n n"]:
    """Give R with R R^T = (precision I + weight B^T K^-1 B)^-1, to scale a search over paths by.

    That is about the covariance of a path near `x` whose data tell it with `precision`:
    K is the covariance of its steps, and B takes first differences, of second order
    second differences, what the steps differ by from going on as before.
    """
    order, n = order_of(alpha), x.shape[0]
    _, K = _moves(alpha, x, steps, given)
    row, after = np.arange(len(K)), np.asarray(_led_to(order, steps))
    B = np.zeros((len(K), n))
    for back, factor in enumerate((1.0, -1.0) if order == 1 else (1.0, -2.0, 1.0)):
        B[row, after - back] = factor
    half = inverse_factor(cholesky(K)) @ B
    return inverse_factor(cholesky(precision * jnp.eye(n) + weight * half.T @ half)).T


def _moves(
    alpha: Float[AnyArray, " a"],
    x: Float[AnyArray, "n q"],
    steps: Steps,
    given: GivenSteps | None,
) -> tuple[Float[AnyArray, "s q"], Float[Array, "s s"]]:
    """Steps of a path less their mean, and their covariance."""
    states, after = _states(order_of(alpha), x, steps)
    K = _covariance(alpha, states)
    if given is None:
        return after, K
    mean, (K,) = given.conditioned(kernel(alpha).matrix(states, given.states), K)
    return after - mean, K


def _centred(x: Float[AnyArray, "n q"], steps: Steps) -> Float[Array, "n q"]:
    """A path less the mean of each clip."""
    n, clips = x.shape[0], len(steps.first)
    clip = jnp.searchsorted(jnp.asarray(steps.first), jnp.arange(n), side="right") - 1
    count = jnp.diff(jnp.asarray(steps.first), append=n)
    sums = jnp.zeros((clips, x.shape[1])).at[clip].add(x)
    return jnp.asarray(x) - (sums / count[:, None])[clip]


def path_scale(x: Float[AnyArray, "n q"], steps: Steps) -> Float[Array, ""]:
    """Root mean square of a path about the mean of each clip.

    About the origin a path far from it would be large without moving at all.
    """
    return jnp.sqrt(jnp.mean(_centred(x, steps) ** 2))


def unit_scale(x: Float[AnyArray, "n q"], steps: Steps) -> Float[Array, "n q"]:
    """Scale every clip of a path about its mean, all alike, so that `path_scale` is one."""
    return at_scale(x, steps, 1.0)


def at_scale(x: Float[AnyArray, "n q"], steps: Steps, scale: ArrayLike) -> Float[Array, "n q"]:
    """Scale every clip of a path about its mean, all alike, so that `path_scale` is `scale`."""
    moving = _centred(x, steps)
    return jnp.asarray(x) - moving + scale * moving / jnp.sqrt(jnp.mean(moving**2))


class UnitScale(dist.Distribution):
    """Paths of unit scale: `path`, given that, with a scale put before them.

    A path x (N, Q) of C clips is the means of its clips and its movement about them,
    which has n = (N - C) Q dimensions. With r its `path_scale`, the means and the
    movement divided by r are distributed as the density of `path` where r is one, and
    log r is N(1, 1 / n), whatever they are. Movements of one shape fill a volume
    r^n d log r, so

        log p(x) = log path(unit_scale(x)) - n / 2 (log r)^2 + const,

    whose mode is at r = 1. The constant leaves out the integral of `path` over r = 1,
    the density of unit scale under `path`: a joint density of x and of hyperparameters
    is that given unit scale.
    """

    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("path",)

    def __init__(self, path, *, validate_args=None):
        self.path = path
        super().__init__(batch_shape=(), event_shape=path.event_shape, validate_args=False)

    def log_prob(self, value):
        """Log density of the path `value` (N, Q)."""
        n = (value.shape[0] - len(self.path.steps.first)) * value.shape[1]
        log_scale = jnp.log(path_scale(value, self.path.steps))
        # log r is normal; a unit of volume of the shape and of log r is r^n of x.
        scale = dist.Normal(1.0, n**-0.5).log_prob(log_scale) - n * log_scale
        return self.path.log_prob(unit_scale(value, self.path.steps)) + scale - 0.5 * jnp.log(n)

    def sample(self, key, sample_shape=()):
        """Draw paths and scale each: their shapes are those of `path` of any scale.

        For draws of the joint distribution see `distributions.unit_paths`.
        """
        scaled = partial(unit_scale, steps=self.path.steps)
        draws = self.path.sample(key, sample_shape)
        for _ in sample_shape:
            scaled = jax.vmap(scaled)
        return scaled(draws)


class GPDynamics(dist.Distribution):
    """Distribution of latent paths x (N, Q) under Gaussian process dynamics.

    Parameters
    ----------
    alpha
        (4,) hyperparameters of dynamics of first order or (6,) of second, see the module.
    steps
        First frames and pairs of frames.
    shape
        (N, Q).
    given
        Steps seen before, that h is conditioned on; none where None.
    weight
        What the log density of the steps is multiplied by: 1, or D / Q when balanced.
        With any other weight than 1 the log density has no normaliser.
    """

    arg_constraints: ClassVar = {"alpha": constraints.positive}
    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("alpha", "steps", "given")
    pytree_aux_fields = ("shape_", "weight")

    def __init__(self, alpha, steps, shape, given=None, weight=1.0, *, validate_args=None):
        self.alpha, self.steps, self.given = alpha, steps, given
        self.shape_, self.weight = tuple(shape), weight
        super().__init__(batch_shape=(), event_shape=self.shape_, validate_args=False)

    def log_prob(self, value):
        """Log density of the path `value` (N, Q)."""
        q, order = value.shape[1], order_of(self.alpha)
        start = dist.Normal().log_prob(value[_stateless(order, self.steps)]).sum()
        after, K = _moves(self.alpha, value, self.steps, self.given)
        if len(after) == 0:
            return start
        moves = log_density(after, K, jnp.ones(q), complete(after.shape[0], q))
        return start + self.weight * moves

    def sample(self, key=None, sample_shape=()):
        """Draw paths frame by frame, each step given all steps before it.

        The weight is not looked at: an unnormalised density has no draws of its own.
        """
        assert key is not None, "a draw needs a key"
        keys = jax.random.split(key, sample_shape) if sample_shape else key
        draw = self._one_path
        for _ in sample_shape:
            draw = jax.vmap(draw)
        return draw(keys)

    def _one_path(self, key):
        n, q = self.shape_
        order = order_of(self.alpha)
        white = jax.random.normal(key, (n, q))
        begun = _stateless(order, self.steps)
        leads_to = jnp.asarray(_led_to(order, self.steps))
        count = len(leads_to)

        def step(i, state):
            # Row i of the Cholesky factor of the steps' covariance, and of its inverse; what
            # is not drawn yet is masked out.
            x, inverse = state
            states, _ = _states(order, x, self.steps)
            here = {name: part[i][None] for name, part in states.items()}
            own, cross = _covariance(self.alpha, here), kernel(self.alpha).matrix(here, states)
            shift = jnp.zeros((1, q))
            if self.given is not None:
                known = self.given.conditioned
                past = kernel(self.alpha).matrix(states, self.given.states)
                shift, (own,) = known(past[i][None], own)
                cross = cross - (past[i][None] @ known.inverse[0].T) @ (past @ known.inverse[0].T).T
            row = (cross[0] * (jnp.arange(count) < i)) @ inverse.T
            spread = jnp.sqrt(own[0, 0] - row @ row)
            inverse = inverse.at[i].set(-(row @ inverse) / spread).at[i, i].set(1.0 / spread)
            here = shift[0] + row @ white[leads_to] + spread * white[leads_to[i]]
            return x.at[leads_to[i]].set(here), inverse

        x = jnp.zeros((n, q)).at[begun].set(white[begun])
        return jax.lax.fori_loop(0, count, step, (x, jnp.zeros((count, count))))[0]
