"""Where gait cycles lie when nothing but their order is known: tori and cylinders.

A point of the surface has a pose p, the phase of the cycle, a gait g, whose neighbours
are the gaits most like it, and a layer s, its stride (Ding and Fan, eq. 6 and 7):

    torus      t = ((R + r_s cos a) cos b, (R + r_s cos a) sin b, r_s sin a)
    cylinder   t = (r_s cos a, delta g, r_s sin a)
    circle     t = (r_s cos a, y_g, r_s sin a): the pose alone is known, y is left free

with a = 2 pi p / P and b = 2 pi g / G. Latent points are free, but every coordinate of
each is drawn to what the same coordinates of its neighbours make of it, as on the
surface (eq. 8 to 10), with weights W that sum to one in every row:

    log p(x) = - sum_axis |(I - W_axis) x_axis|^2 / sigma^2
               - |x|^2 / (2 latent_sd^2) + constant.

The first part alone is the paper's energy. It does not care where the points lie as a
whole and grows with their size: no density. With the second part it is a Gaussian of
each axis, of precision 2 (I - W)^T (I - W) / sigma^2 + I / latent_sd^2, and the constant
is known (`log_normaliser`).
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import fast_tsp
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ..errors import InputError
from ..gp.linalg import AnyArray, cholesky

Kind = Literal["torus", "cylinder", "circle"]
WITHIN, ACROSS = 10, 6
# A gait away counts like one and a half poses: the ten nearest are then five poses in
# line and the three nearest of either gait beside.
GAIT_STEP = 1.5
RIDGE = 1e-3
LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True)
class Surface:
    """A surface of P poses x G gaits x S layers, and its points in the order (s, g, p).

    kind
        ``torus``, ``cylinder`` or ``circle``.
    poses, gaits
        P and G.
    radii
        r_s of every layer, from the inner one outwards.
    spacing
        Distance of neighbouring gaits on the middle circle of the torus, and on the cylinder.
    """

    kind: Kind
    poses: int
    gaits: int
    radii: tuple[float, ...] = (1.0,)
    spacing: float = 0.5

    def __post_init__(self) -> None:
        """Refuse layers that do not lie around each other."""
        if not self.radii or any(
            outer <= inner for inner, outer in zip((0.0, *self.radii), self.radii, strict=False)
        ):
            raise InputError(
                f"surface with the radii {self.radii}",
                "they do not grow from layer to layer",
                "Give the layers from the inner one outwards, radii above zero",
            )

    @property
    def major(self) -> float:
        """R of the torus: gaits are `spacing` apart, and at least half of that inside the ring."""
        return max(self.gaits * self.spacing / (2.0 * np.pi), 2.0 * self.radii[-1])

    @property
    def size(self) -> int:
        """Number of points N."""
        return self.poses * self.gaits * len(self.radii)

    @property
    def closed(self) -> bool:
        """Whether the last gait is beside the first."""
        return self.kind == "torus"

    def index(self) -> Int[np.ndarray, "n 3"]:
        """Layer, gait and pose of every point."""
        shape = (len(self.radii), self.gaits, self.poses)
        return np.stack(np.unravel_index(np.arange(self.size), shape), axis=1)

    def at(self, pose: AnyArray, gait: AnyArray, radius: AnyArray) -> Float[Array, "n 3"]:
        """Points at poses and gaits that need not be whole numbers, and at any radius.

        Differentiable.
        """
        a = 2.0 * jnp.pi * jnp.asarray(pose) / self.poses
        across, up = radius * jnp.cos(a), radius * jnp.sin(a)
        if self.kind == "torus":
            b = 2.0 * jnp.pi * jnp.asarray(gait) / self.gaits
            out = self.major + across
            return jnp.stack([out * jnp.cos(b), out * jnp.sin(b), up], axis=1)
        along = self.spacing * (jnp.asarray(gait) - 0.5 * (self.gaits - 1))
        return jnp.stack([across, along, up], axis=1)

    def points(self) -> Float[np.ndarray, "n 3"]:
        """The ideal surface (eq. 6, eq. 7)."""
        layer, gait, pose = self.index().T
        return np.array(self.at(pose, gait, np.asarray(self.radii)[layer]))


def tour(distance: Float[np.ndarray, "g g"]) -> list[int]:
    """Order gaits along the shortest closed way through all of them.

    Parameters
    ----------
    distance
        (G, G) symmetric, not negative.
    """
    if len(distance) < 4:
        return list(range(len(distance)))
    # The solver takes whole numbers of two bytes; up to twenty places it is exact.
    whole = np.rint(distance * (65535 / max(float(distance.max()), 1e-300))).astype(int)
    return list(fast_tsp.find_tour(whole.tolist(), duration_seconds=2.0, stop_when_converged=True))


def open_path(distance: Float[np.ndarray, "g g"]) -> list[int]:
    """Order gaits along the shortest way through all of them that need not close.

    It is the closed one through one place more, which is no way from any gait.
    """
    count = len(distance)
    extended = np.zeros((count + 1, count + 1))
    extended[:count, :count] = distance
    order = tour(extended)
    cut = order.index(count)
    return [*order[cut + 1 :], *order[:cut]]


def length_of(distance: Float[np.ndarray, "g g"], order: list[int], *, closed: bool) -> float:
    """Length of the way through gaits in this order."""
    after = np.roll(order, -1) if closed else order[1:]
    return float(sum(distance[a, b] for a, b in zip(order, after, strict=False)))


class Topology(NamedTuple):
    """Neighbours of every point and the weights their coordinates have.

    neighbours
        (N, K) indices.
    weights
        (Q, N, K) one set an axis, each summing to one.
    constrained
        (Q,) 1 where the axis is held to its weights, 0 where it is free.
    """

    neighbours: Int[AnyArray, "n k"]
    weights: Float[AnyArray, "q n k"]
    constrained: Float[AnyArray, " q"]

    def residual(self, x: Float[AnyArray, "n q"]) -> Float[AnyArray, "n q"]:
        """(I - W) x, axis by axis."""
        x = jnp.asarray(x)
        made = jnp.einsum("qnk,nkq->nq", self.weights, x[jnp.asarray(self.neighbours)])
        return (x - made) * self.constrained


def topology_of(surface: Surface, within: int = WITHIN, across: int = ACROSS) -> Topology:
    """Give the neighbours by structure, and the weights from the ideal surface (eq. 8, 9).

    Parameters
    ----------
    within
        Neighbours in a point's own layer.
    across
        Neighbours in the layers beside it, shared between both where there are two.

    Raises
    ------
    InputError
        If the layers have fewer points than that.
    """
    if surface.kind == "circle":
        # Poses of one gait alone: gaits know nothing of each other.
        line = Surface("circle", surface.poses, 1, surface.radii)
        own = _neighbours(line, min(within, surface.poses - 1), 0)
        layer, gait, pose = surface.index().T
        first = (layer * surface.gaits + gait) * surface.poses
        neighbours = first[:, None] + own[pose]
        constrained = np.array([1.0, 0.0, 1.0])
    else:
        neighbours = _neighbours(surface, within, across)
        constrained = np.ones(3)
    t = surface.points()
    return Topology(neighbours, lle_weights(t, neighbours), constrained)


def _neighbours(surface: Surface, within: int, across: int) -> Int[np.ndarray, "n k"]:
    layers, gaits, poses = len(surface.radii), surface.gaits, surface.poses
    if within >= gaits * poses or (layers > 1 and across > gaits * poses):
        raise InputError(
            f"surface of {gaits} gaits and {poses} poses",
            f"it has no {within} neighbours within and {across} across layers",
            "Take more gaits, or fewer neighbours",
        )
    rows = []
    for layer in range(layers):
        for gait in range(gaits):
            # What is near pose 0 is near every pose, so many poses further on.
            near = _near_first(surface, layer, 0 if surface.closed else gait, within, across)
            other, beside, apart = near.T
            beside = (beside + (gait if surface.closed else 0)) % gaits
            on = (apart + np.arange(poses)[:, None]) % poses
            rows.append((other * gaits + beside) * poses + on)
    return np.concatenate(rows)


def _near_first(
    surface: Surface, layer: int, gait: int, within: int, across: int
) -> Int[np.ndarray, "k 3"]:
    """Layer, gait and pose of the neighbours of a gait's first pose."""
    beside = [s for s in (layer - 1, layer + 1) if 0 <= s < len(surface.radii)]
    near = [(layer, i) for i in _nearest(surface, gait, within + 1)[1:]]
    for number, other in enumerate(beside):
        share = across // len(beside) + (number < across % len(beside))
        near += [(other, i) for i in _nearest(surface, gait, share)]
    return np.array([(s, i // surface.poses, i % surface.poses) for s, i in near])


def _nearest(surface: Surface, gait: int, count: int) -> list[int]:
    """Points of a layer nearest to a gait's first pose by steps of pose and gait, it first."""
    around = np.arange(surface.poses)
    apart = np.minimum(around, surface.poses - around)
    beside = np.arange(surface.gaits) - gait
    between = np.abs(beside)
    if surface.closed:
        between = np.minimum(beside % surface.gaits, -beside % surface.gaits)
    steps = (GAIT_STEP * between[:, None]) ** 2 + apart[None, :] ** 2
    return [int(i) for i in np.argsort(steps.ravel(), kind="stable")[:count]]


def lle_weights(
    t: Float[np.ndarray, "n q"], neighbours: Int[np.ndarray, "n k"]
) -> Float[np.ndarray, "q n k"]:
    """Weights with which each coordinate of a point is made of its neighbours' (eq. 8, 9).

    C w = 1 with C_jk = (t_i - t_j) (t_i - t_k), scaled to the sum one. C has rank one:
    a ridge of `RIDGE` times its trace chooses among the solutions the smoothest.
    """
    apart = t[:, None, :] - t[neighbours]
    C = np.einsum("njq,nkq->qnjk", apart, apart)
    trace = np.trace(C, axis1=2, axis2=3)
    ridge = np.where(trace > 1e-12, RIDGE * trace, 1.0)
    C = C + ridge[..., None, None] * np.eye(neighbours.shape[1])
    w = np.linalg.solve(C, np.ones((*C.shape[:-1], 1)))[..., 0]
    return w / w.sum(axis=-1, keepdims=True)


def precision(topology: Topology, sigma: float, latent_sd: float) -> Float[np.ndarray, "q n n"]:
    """Precision of every axis (dense), 2 (I - W)^T (I - W) / sigma^2 + I / latent_sd^2."""
    n = len(topology.neighbours)
    out = []
    for weights, held in zip(topology.weights, topology.constrained, strict=True):
        rest = np.eye(n)
        np.subtract.at(rest, (np.arange(n)[:, None], np.asarray(topology.neighbours)), weights)
        out.append(2.0 * held * rest.T @ rest / sigma**2 + np.eye(n) / latent_sd**2)
    return np.stack(out)


def log_normaliser(topology: Topology, sigma: float, latent_sd: float) -> float:
    """Log of the constant of the density; it takes one factorisation an axis."""
    q, n = topology.weights.shape[:2]
    logdets = [np.linalg.slogdet(axis)[1] for axis in precision(topology, sigma, latent_sd)]
    return float(0.5 * sum(logdets) - 0.5 * n * q * LOG_2PI)


class LocallyLinear(dist.Distribution):
    """The distribution of latent points x (N, Q) around a surface; see the module.

    Parameters
    ----------
    topology
        Neighbours and weights.
    sigma, latent_sd
        Scales of the two parts.
    normaliser
        From `log_normaliser`; with zero the log density is known up to a constant.
    """

    arg_constraints: ClassVar = {}
    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("topology", "normaliser")
    pytree_aux_fields = ("sigma", "latent_sd")

    def __init__(self, topology, sigma, latent_sd, normaliser, *, validate_args=None):
        self.topology, self.sigma, self.latent_sd = topology, sigma, latent_sd
        self.normaliser = normaliser
        q, n = topology.weights.shape[:2]
        super().__init__(batch_shape=(), event_shape=(n, q), validate_args=False)

    def log_prob(self, value):
        """Log density of the points `value` (N, Q)."""
        energy = jnp.sum(self.topology.residual(value) ** 2) / self.sigma**2
        return self.normaliser - energy - 0.5 * jnp.sum(value**2) / self.latent_sd**2

    def sample(self, key=None, sample_shape=()):
        """Draw points, by one dense factorisation an axis."""
        assert key is not None, "a draw needs a key"
        n, q = self.event_shape
        white = jax.random.normal(key, (*sample_shape, n, q))
        rest = jnp.eye(n) - self._dense()
        gram = jnp.einsum("qab,qac->qbc", rest, rest) * self.topology.constrained[:, None, None]
        P = 2.0 * gram / self.sigma**2 + jnp.eye(n) / self.latent_sd**2
        L = jax.vmap(cholesky)(P)
        draw = jax.vmap(
            lambda factor, z: jax.scipy.linalg.solve_triangular(factor.T, z, lower=False)
        )
        flat = jnp.moveaxis(white.reshape(-1, n, q), (0, 1, 2), (2, 1, 0))
        return jnp.moveaxis(draw(L, flat), (0, 1, 2), (2, 1, 0)).reshape(white.shape)

    def _dense(self):
        q, n = self.topology.weights.shape[:2]
        row = jnp.arange(n)[:, None]
        empty = jnp.zeros((q, n, n))
        return empty.at[:, row, jnp.asarray(self.topology.neighbours)].add(self.topology.weights)
