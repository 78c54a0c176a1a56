r"""The difference of two mean curves, of which few people are known: model and posterior.

Of every person s a curve z_s over phases t is known: the difference of their mean strides in two
conditions (paired), or their mean stride in the one condition they were seen in. With K_s(t)
strides in it

    z_s(t) = x_s' B(t) + u_s(t) + e_s(t)
    u_s(t) = r_{g(s)} sigma(t) a_s(t),        a_s ~ GP(0, C)      how people differ
    e_s(t) ~ N(0, c_s(t)),                    c_s(t) = sum_c kappa_c^2(t) / K_{s,c}(t)
    1 / sigma^2(t) ~ Gamma(nu / 2, nu tau^2 / 2)                   inverse chi^2, mean 1 / tau^2
    log nu ~ U(log 1/2, log 64),              log tau^2 uniform over five decades
    C(t, t') = exp(-(w(t) - w(t'))^2 / 2)     w rises with t; on a circle, its chord

with B flat, log r of the second of two groups N(0, 1/2), and the variances kappa^2 of strides
about their person's mean known by those strides alone, p(kappa^2) = 1 / kappa^2. What is asked is
delta(t) = l' B(t). `program` is this model in NumPyro.

Given the variances all is Gaussian, and B is integrated out in closed form (restricted likelihood).
The variances of a phase are integrated over by quadrature, nu, tau and r too. They are learned of
the curves' values phase by phase: neighbouring phases tell the same of nu, tau and r, so that they
count as many as there are independent ones (a composite likelihood). Were the likelihood of whole
curves used instead, the sd of every phase would be learned from how its neighbours move with it, to
a precision that holds only where C is exactly right. By this the margin of delta at one phase is
that of n - 1 to n - 1 + 64 degrees of freedom, as few or as many as the phases are alike.

Between phases draws of delta are joined as the model has them: delta(t) = m(t) + s(t) a(t), with a
~ GP(0, C), and the variances by a chi^2 field of the same smoothness. How smooth, w, is estimated
from neighbouring phases of the residuals (as random field theory does), and taken for known.

Kiebel, Poline, Friston, Holmes and Worsley (NeuroImage 1999) on smoothness; Smyth (Stat. Appl.
Genet. Mol. Biol. 2004) on variances that are alike; Varin, Reid and Firth (Stat. Sinica 2011) on
composite likelihoods.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jaxtyping import Float, Int
from numpyro.distributions import constraints
from scipy.special import chdtrc, chdtri, gammaln, logsumexp

# Quadrature: variances of a phase in logs, from that of its residuals on.
NODES = np.arange(-8.0, 5.0, 0.12)
NU = 2.0 ** np.arange(-1, 7)
TAU2 = np.exp(np.linspace(np.log(1e-3), np.log(1e2), 31))
STRIDE_QUANTILES = (np.arange(3) + 0.5) / 3
RATIO_SD = float(np.sqrt(0.5))
LOG_RATIOS = RATIO_SD * np.linspace(-2.0, 2.0, 7)
# Smoothness is averaged over this share of the phases; neighbours correlate at least so much.
WINDOW, LEAST_CORRELATION, MOST_CORRELATION = 0.1, 0.02, 1.0 - 1e-10
# A chi^2 field of more degrees of freedom is as good as constant.
MOST_FIELDS = 12
RANK_TOLERANCE = 1e-6
# Residuals are not taken to be smaller than this share of the usual one.
FLOOR, SMALLEST = 1e-9, 1e-300


@dataclass(frozen=True)
class People:
    """What is known of a difference: a curve of every person.

    value
        z (n, T); NaN where a person was not seen at a phase.
    design
        x_s (n, p).
    asked
        l (p,).
    strides
        1 / K (n, C, T): one over the strides of every condition; 0 where there are none.
    within
        (C, T): sums of squares of strides about their person's mean.
    freedom
        (C, T): degrees of freedom of these; 0 where all have one stride: then the variance of
        strides is part of that of people.
    group
        (n,): 0, or 1 for the second of two groups.
    periodic
        Whether the last phase is followed by the first.
    """

    value: Float[np.ndarray, "n t"]
    design: Float[np.ndarray, "n p"]
    asked: Float[np.ndarray, " p"]
    strides: Float[np.ndarray, "n c t"]
    within: Float[np.ndarray, "c t"]
    freedom: Float[np.ndarray, "c t"]
    group: Int[np.ndarray, " n"]
    periodic: bool = False

    @property
    def scale(self) -> float:
        """The median over phases of the residual variance: what the range of tau^2 is about."""
        return float(np.median(_least_squares(self)[1]))


@dataclass(frozen=True)
class Difference:
    """The posterior of the difference, and what was learned beside it.

    mean, sd, draws
        (T,), (T,) and (S, T).
    nu
        Posterior mean.
    people_sd
        (T,): sigma, the root of the posterior median of its square.
    stride_sd
        (C, T): kappa, the root of the median; 0 where strides do not tell it.
    ratio
        Posterior mean of r of the second group.
    independent
        So many independent phases there are.
    correlation
        C (T, T).
    sigma2, kappa2
        Draws (S, T) and (S, C, T) of the variances, those that the draws of the difference have.
    """

    mean: Float[np.ndarray, " t"]
    sd: Float[np.ndarray, " t"]
    draws: Float[np.ndarray, "s t"]
    nu: float
    people_sd: Float[np.ndarray, " t"]
    stride_sd: Float[np.ndarray, "c t"]
    ratio: float
    independent: float
    correlation: Float[np.ndarray, "t t"]
    sigma2: Float[np.ndarray, "s t"]
    kappa2: Float[np.ndarray, "s c t"]


def program(people: People, correlation: Float[np.ndarray, "t t"], scale: float) -> None:
    """The model of people who were seen at all phases, given C."""
    n, phases = people.value.shape
    nu = numpyro.sample("nu", dist.LogUniform(NU[0], NU[-1]))
    tau2 = numpyro.sample("tau2", dist.LogUniform(scale * TAU2[0], scale * TAU2[-1]))
    flat = dist.ImproperUniform(constraints.real, (), (*people.design.shape[1:], phases))
    mean = people.design @ numpyro.sample("B", flat)
    with numpyro.plate("phase", phases):
        sigma2 = 1.0 / numpyro.sample("precision", dist.Gamma(nu / 2.0, nu * tau2 / 2.0))
    r = jnp.ones(n)
    if people.group.any():
        r = jnp.exp(people.group * numpyro.sample("log_r", dist.Normal(0.0, RATIO_SD)))
    c = jnp.zeros((n, phases))
    if people.freedom.any():
        shape = people.freedom.shape
        positive = dist.ImproperUniform(constraints.positive, (), shape)
        kappa2 = numpyro.sample("kappa2", positive)
        numpyro.factor("reference_prior", -jnp.log(kappa2).sum())
        squares = dist.Gamma(people.freedom / 2.0, 0.5 / kappa2).to_event(2)
        numpyro.sample("within", squares, obs=people.within)
        c = jnp.einsum("nct,ct->nt", people.strides, kappa2)
    sd_u, sd_e = r[:, None] * jnp.sqrt(sigma2), jnp.sqrt(c)
    covariance = correlation * (
        sd_u[:, :, None] * sd_u[:, None, :] + sd_e[:, :, None] * sd_e[:, None, :]
    )
    with numpyro.plate("person", n):
        numpyro.sample("z", dist.MultivariateNormal(mean, covariance), obs=people.value)


def difference(people: People, draws: int, random: np.random.Generator) -> Difference:
    """Return the posterior of l' B(t).

    Parameters
    ----------
    people
        At every phase more of them than columns of the design.
    draws
        Number S of draws.
    random
        What they are drawn with.

    Examples
    --------
    >>> import numpy as np
    >>> from bayesmotion.gp.curve_differences import People, difference
    >>> random = np.random.default_rng(0)
    >>> value = 3.0 + random.normal(size=(6, 1)) * np.ones(50)
    >>> none, ones = np.zeros((1, 50)), np.ones((6, 1))
    >>> people = People(
    ...     value, ones, np.ones(1), np.zeros((6, 1, 50)), none, none, np.zeros(6, int)
    ... )
    >>> difference(people, 200, random).draws.shape
    (200, 50)
    """
    residual, spread = _least_squares(people)
    correlation = correlation_of(residual, people.periodic)
    phases = len(spread)
    independent = phases**2 / float(np.sum(correlation**2))
    kappa2 = _stride_variances(people)
    sigma2 = spread[:, None] * np.exp(NODES)
    log_r = LOG_RATIOS if people.group.any() else np.zeros(1)
    given = [_given_variances(people, sigma2, kappa2, float(np.exp(value))) for value in log_r]
    evidence, mean, variance = (np.stack(part) for part in zip(*given, strict=True))
    learned = _learned(evidence, sigma2, log_r, float(np.median(spread)), independent / phases)
    # Nodes of every phase in the order of the sd that they give.
    share, mean, sd = (
        np.moveaxis(part, 2, 0).reshape(phases, -1)
        for part in (learned.share, mean, np.sqrt(variance))
    )
    order = np.argsort(sd, axis=1)
    share, mean, sd = (np.take_along_axis(part, order, axis=1) for part in (share, mean, sd))
    centre = np.sum(share * mean, axis=1)
    total = np.sqrt(np.sum(share * (sd**2 + (mean - centre[:, None]) ** 2), axis=1))
    freedom = len(people.value) - people.design.shape[1] + learned.nu
    field, level = _fields(correlation, draws, freedom, random)
    cumulative, drawn = np.cumsum(share, axis=1), np.empty((draws, phases))
    node = np.empty((draws, phases), dtype=int)
    for t in range(phases):
        at = np.minimum(np.searchsorted(cumulative[t], level[:, t]), share.shape[1] - 1)
        drawn[:, t] = mean[t, at] + sd[t, at] * field[:, t]
        node[:, t] = order[t, at]
    of_strides, of_people = np.unravel_index(node, evidence.shape[:2] + evidence.shape[3:])[1:]
    half = np.argmax(np.cumsum(learned.share.sum(axis=(0, 1)), axis=1) >= 0.5, axis=1)
    people_sd = np.sqrt(np.take_along_axis(sigma2, half[:, None], axis=1)[:, 0])
    stride_sd = np.sqrt(kappa2[len(kappa2) // 2])
    return Difference(
        centre,
        total,
        drawn,
        learned.nu,
        people_sd,
        stride_sd,
        learned.r,
        independent,
        correlation,
        sigma2[np.arange(phases), of_people],
        np.moveaxis(kappa2[of_strides, :, np.arange(phases)], 2, 1),
    )


def correlation_of(residual: Float[np.ndarray, "n t"], periodic: bool) -> Float[np.ndarray, "t t"]:
    """Return C of residuals: w rises between neighbours by what their correlation asks for."""
    phases = residual.shape[1]
    size = np.sqrt(np.sum(residual**2, axis=0))
    unit = residual / np.where(size > 0.0, size, 1.0)
    neighbour = np.sum(unit * np.roll(unit, -1, axis=1), axis=0)
    step2 = -2.0 * np.log(np.clip(neighbour, LEAST_CORRELATION, MOST_CORRELATION))
    width = max(1, round(WINDOW * phases))
    if not periodic:
        step2 = step2[:-1]
        weight = np.ones(min(width, len(step2)))
        if len(step2):
            filled = np.convolve(np.ones_like(step2), weight, "same")
            step2 = np.convolve(step2, weight, "same") / filled
        w = np.concatenate([[0.0], np.cumsum(np.sqrt(step2))])
        return np.exp(-0.5 * (w[:, None] - w) ** 2)
    around = np.fft.irfft(
        np.fft.rfft(step2) * np.fft.rfft((np.arange(phases) < width) / width), phases
    )
    w = np.concatenate([[0.0], np.cumsum(np.sqrt(np.roll(around, -(width // 2))))])
    angle = 2.0 * np.pi * w[:-1] / w[-1]
    chord = w[-1] / np.pi * np.sin(0.5 * (angle[:, None] - angle))
    return np.exp(-0.5 * chord**2)


def _least_squares(
    people: People,
) -> tuple[Float[np.ndarray, "n t"], Float[np.ndarray, " t"]]:
    """Return residuals, 0 where nothing was seen, and their variance (T,)."""
    X, seen = people.design, np.isfinite(people.value)
    z, w = np.where(seen, people.value, 0.0), 1.0 * seen
    gram = np.einsum("np,nt,nq->tpq", X, w, X)
    B = np.linalg.solve(gram, np.einsum("np,nt->tp", X, z)[..., None])[..., 0]
    residual = w * (z - X @ B.T)
    variance = np.sum(residual**2, axis=0) / np.maximum(w.sum(axis=0) - X.shape[1], 1.0)
    return residual, np.maximum(variance, FLOOR * np.median(variance) + np.finfo(float).tiny)


def _stride_variances(people: People) -> Float[np.ndarray, "j c t"]:
    """Return quantiles of the posterior of kappa^2, alike in weight."""
    known = people.freedom > 0
    if not known.any():
        return np.zeros((1, *people.within.shape))
    freedom = np.where(known, people.freedom, 1.0)
    return np.stack([
        np.where(known, people.within / chdtri(freedom, quantile), 0.0)
        for quantile in STRIDE_QUANTILES
    ])  # fmt: skip


def _given_variances(
    people: People, sigma2: Float[np.ndarray, "t g"], kappa2: Float[np.ndarray, "j c t"], r: float
) -> tuple[Float[np.ndarray, "j t g"], Float[np.ndarray, "j t g"], Float[np.ndarray, "j t g"]]:
    """Return the log restricted likelihood, and mean and variance of l' B, of every phase."""
    X, seen = people.design, np.isfinite(people.value)
    z = np.where(seen, people.value, 0.0)
    noise = np.einsum("nct,jct->jnt", people.strides, kappa2)
    scale = np.where(people.group == 1, r**2, 1.0)
    weight = 1.0 / (scale[:, None, None] * sigma2 + noise[..., None])
    log_weight = np.einsum("jntg,nt->jtg", np.log(weight), 1.0 * seen)
    weight = weight * seen[..., None]
    inverse = np.linalg.inv(np.einsum("np,jntg,nq->jtgpq", X, weight, X, optimize=True))
    moment = np.einsum("np,jntg,nt->jtgp", X, weight, z, optimize=True)
    B = np.einsum("jtgpq,jtgq->jtgp", inverse, moment)
    squares = np.einsum("jntg,nt->jtg", weight, z**2) - np.sum(B * moment, axis=-1)
    evidence = 0.5 * (log_weight + np.linalg.slogdet(inverse)[1] - squares)
    asked = people.asked
    return evidence, B @ asked, np.einsum("p,jtgpq,q->jtg", asked, inverse, asked)


class _Learned(NamedTuple):
    """Posterior weights of all nodes by phase, and posterior means of nu and r."""

    share: Float[np.ndarray, "r j t g"]
    nu: float
    r: float


def _learned(
    evidence: Float[np.ndarray, "r j t g"], sigma2: Float[np.ndarray, "t g"],
    log_r: Float[np.ndarray, " r"], scale: float, power: float,
) -> _Learned:  # fmt: skip
    """Integrate over nu, tau^2 and r."""
    prior = _prior(sigma2, scale)
    top = evidence.max(axis=(0, 1, 3), keepdims=True)
    likelihood = np.exp(evidence - top) / evidence.shape[1]
    marginal = np.einsum("rtg,vtgh->rtvh", likelihood.sum(axis=1), prior, optimize=True)
    marginal = np.maximum(marginal, SMALLEST)  # of many people, far from what they tell
    log_hyper = power * np.log(marginal).sum(axis=1)
    log_hyper -= 0.5 * (log_r[:, None, None] / RATIO_SD) ** 2
    hyper = np.exp(log_hyper - logsumexp(log_hyper))
    averaged = np.einsum("rtvh,vtgh->rtg", hyper[:, None] / marginal, prior, optimize=True)
    share = averaged[:, None] * likelihood
    share /= share.sum(axis=(0, 1, 3), keepdims=True)
    nu, r = float(hyper.sum(axis=(0, 2)) @ NU), float(hyper.sum(axis=(1, 2)) @ np.exp(log_r))
    return _Learned(share, nu, r)


def _prior(sigma2: Float[np.ndarray, "t g"], scale: float) -> Float[np.ndarray, "v t g h"]:
    """Return the density of log sigma^2 given nu (v) and tau^2 (h): nodes are even in it.

    With x = tau^2 / sigma^2 it is (nu / 2)^(nu / 2) / Gamma(nu / 2) (x e^-x)^(nu / 2), of twice a
    nu the square.
    """
    x = scale * TAU2 / sigma2[..., None]
    powers = [np.exp(0.5 * NU[0] * (np.log(x) - x + 1.0))]
    for _ in NU[1:]:
        powers.append(powers[-1] ** 2)
    size = np.exp(0.5 * NU * (np.log(0.5 * NU) - 1.0) - gammaln(0.5 * NU))
    return size[:, None, None, None] * np.stack(powers)


def _fields(
    correlation: Float[np.ndarray, "t t"], draws: int, freedom: float,
    random: np.random.Generator,
) -> tuple[Float[np.ndarray, "s t"], Float[np.ndarray, "s t"]]:  # fmt: skip
    """Return draws of a Gaussian field, and the level of a chi^2 field: 1 where it is smallest."""
    factor = factor_of(correlation)

    def gaussian() -> np.ndarray:
        return random.standard_normal((draws, factor.shape[1])) @ factor.T

    field, count = gaussian(), int(np.clip(round(freedom), 1, MOST_FIELDS))
    squares = np.zeros_like(field)
    for _ in range(count):
        squares += gaussian() ** 2
    return field, chdtrc(count, squares)


def factor_of(correlation: Float[np.ndarray, "t t"]) -> Float[np.ndarray, "t r"]:
    """Return a root of C, of low rank."""
    value, vector = np.linalg.eigh(correlation)
    kept = value > RANK_TOLERANCE * value[-1]
    factor = vector[:, kept] * np.sqrt(value[kept])
    return factor / np.sqrt(np.sum(factor**2, axis=1, keepdims=True))
