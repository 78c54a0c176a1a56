"""The pace of clips, learned: how many radians a frame their phases go.

The logarithm of a clip's step is a linear function of its styles with a Gaussian prior, as the
outputs are, and something of its own:

    log step_c = log(2 pi / (1 s x frame rate)) + m + b^T z_c + e_c
    m ~ N(0, 0.4^2)              all clips': a cycle takes about one second
    b ~ N(0, style_sd^2 I)       z_c = s_c (x) g_c (x) ..., the product of the linear factors'
                                 vectors (Wang, Fleet and Hertzmann 2007, section 4.2)
    e_c ~ N(0, own_sd^2)

    own_sd ~ LogNormal(log 0.05, 0.7), style_sd ~ LogNormal(log 0.2, 1.2)

m and b are integrated out, and the two sizes by sums over a grid (`GRID`), whose points count by
their prior: the log steps of all clips are a mixture of joint normals, and those of new clips given
the trained ones are as well. A clip of a gait or a person that is known, or like one, is expected
to go at the pace of these, the more exactly the less training clips differ. Sums over the grid
leave nothing for a search to find, which would be long about it: a few steps tell these sizes,
beside frames by the thousand.

The speed of a clip at a moment is not its pace: its logarithm varies about that as an
Ornstein-Uhlenbeck process of sd `wander_sd` and time scale `WANDER_S` (`wandering`). Training
clips are long, and their mean speed is taken for their pace.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpyro import distributions as dist
from numpyro.distributions.transforms import ExpTransform

from ...gp.linalg import AnyArray, cholesky

COMMON_SD = 0.4
OWN_MEDIAN, OWN_LOG_SD = 0.05, 0.7
STYLE_MEDIAN, STYLE_LOG_SD = 0.2, 1.2
# Where the sizes lie, in their prior's standard deviations from its median.
GRID = tuple(np.linspace(-2.4, 2.4, 9).tolist())
# Seconds in which the momentary speed of a clip is forgotten.
WANDER_S = 0.1


def step_distribution(
    frame_rate: Float[AnyArray, ""] | float,
    alike: Float[AnyArray, "a a"],
    known: Float[AnyArray, " k"] | None = None,
) -> dist.Distribution:
    """Return the distribution of the steps of clips, radians a frame.

    Parameters
    ----------
    frame_rate
        Frames a second.
    alike
        (A, A) products z_c^T z_c' of the styles; of trained clips first, then of new ones.
    known
        (K,) steps of trained clips; the distribution is that of the other clips given these.
    """
    count = alike.shape[0]
    away = np.stack(np.meshgrid(GRID, GRID, indexing="ij")).reshape(2, -1)
    own = OWN_MEDIAN * np.exp(OWN_LOG_SD * away[0])
    style = STYLE_MEDIAN * np.exp(STYLE_LOG_SD * away[1])
    log_weight = jnp.asarray(-0.5 * np.sum(away**2, axis=0))
    mean = jnp.full(count, jnp.log(2.0 * np.pi / frame_rate))

    def covariance(own: Array, style: Array) -> Array:
        return COMMON_SD**2 + style**2 * jnp.asarray(alike) + own**2 * jnp.eye(count)

    K = jax.vmap(covariance)(jnp.asarray(own), jnp.asarray(style))
    means = jnp.broadcast_to(mean, (len(own), count))
    if known is not None:
        means, K, log_density = jax.vmap(_given, (None, 0, None))(mean, K, jnp.log(known))
        log_weight = log_weight + log_density
    root = jax.vmap(lambda K: cholesky(K, 0.0))(K)
    sizes = dist.Categorical(logits=log_weight)
    mixed = dist.MixtureSameFamily(sizes, dist.MultivariateNormal(means, scale_tril=root))
    return dist.TransformedDistribution(mixed, ExpTransform())


def _given(
    mean: Float[Array, " a"], K: Float[Array, "a a"], known: Float[Array, " k"]
) -> tuple[Float[Array, " m"], Float[Array, "m m"], Float[Array, ""]]:
    """Return mean and covariance of a normal vector's last entries given the first, and p(first).

    The last is the log density up to a constant.
    """
    k = len(known)
    root = cholesky(K[:k, :k], 0.0)
    gain = jax.scipy.linalg.solve_triangular(root, K[:k, k:], lower=True)
    away = jax.scipy.linalg.solve_triangular(root, known - mean[:k], lower=True)
    log_density = -0.5 * jnp.sum(away**2) - jnp.sum(jnp.log(jnp.diagonal(root)))
    return mean[k:] + gain.T @ away, K[k:, k:] - gain.T @ gain, log_density


def wandering(
    time: Float[AnyArray, " n"],
    until: Float[AnyArray, " n"],
    step: Float[AnyArray, " n"],
    white: Float[AnyArray, "n 2"],
    sd: float,
    frame_rate: Float[AnyArray, ""] | float,
) -> Float[Array, " n"]:
    """Return how far the phase has gone from the middle of a context, frame by frame, in radians.

    With the time scale tau, over a context of length L the mean of the wandering log speed has
    the variance 2 sd^2 tau / L (1 - tau / L (1 - exp(-L / tau))); the context is passed at the
    speed that its first number tells, which is forgotten after it. h frames later the phase is
    off by about as much as an integrated Ornstein-Uhlenbeck process, by the second number:
    2 (sd step)^2 tau (h - tau (1 - exp(-h / tau))).

    Parameters
    ----------
    time
        Frames from the middle of the context.
    until
        The last frame of the context, counted so.
    step
        The clip's pace, radians a frame.
    white
        Two standard normal numbers of the frame's clip.
    sd
        Of the log speed.
    frame_rate
        Frames a second.
    """
    tau = WANDER_S * frame_rate
    length = 2.0 * until + 1.0
    mean = 2.0 * tau / length * (1.0 - tau / length * (1.0 - jnp.exp(-length / tau)))
    speed = jnp.exp(sd * jnp.sqrt(mean) * white[:, 0])
    ahead = jnp.maximum(time - until, 0.0)
    forgotten = tau * (1.0 - jnp.exp(-ahead / tau))
    gone = speed * jnp.minimum(time, until) + ahead + (speed - 1.0) * forgotten
    variance = 2.0 * tau * (ahead - forgotten)
    # Smooth at the end of the context, where the variance is of second order in time.
    further = sd * jnp.sqrt(jnp.where(ahead > 0.0, variance, 1.0)) * (ahead > 0.0)
    return jnp.asarray(step) * (gone + further * white[:, 1])
