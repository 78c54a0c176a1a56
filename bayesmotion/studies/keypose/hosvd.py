"""Classical multifactor tensor: higher-order SVD and the paper's rule of recognition.

Perera, Kudoh and Ikeuchi, section 5, after De Lathauwer, De Moor and Vandewalle (2000):

    P = Q x_1 S_position x_2 S_people x_3 S_task                                 (eq. 12)

S_m holds the left singular vectors of the mode-m unfolding, Q = P x_1 S_1^T x_2 S_2^T ...
With full ranks the product gives P back; with fewer columns it is the truncated HOSVD.

Recognition (eq. 13 and 14). The probe is brought into the subspace of the position mode.
For a class k of a mode (a person, a task) and a joint i the distance is that to the
nearest of the class's cells, and the class of the smallest weighted sum is taken:

    d_ki = min over cells c of k  |(S_position S_position^T (y - y_c))_i|^2
    k    = argmin_k sum_i w_i d_ki,     w_i = links between joint i and the body's centre

Novelty (eq. 15 and 16). F_k is the largest value that
repetitions of the class itself reach, measured on training cycles; a probe whose value
exceeds (1 + epsilon) F_k for the class it is nearest to is of no known class.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import tensorly as tl
from jaxtyping import Float, Int
from tensorly.tenalg.core_tenalg import multi_mode_dot

from ...errors import InputError


@dataclass(frozen=True)
class Tucker:
    """A core and one factor matrix a mode: core x_1 factors[0] x_2 factors[1] ..."""

    core: np.ndarray
    factors: tuple[np.ndarray, ...]

    def tensor(self) -> np.ndarray:
        """Multiply out."""
        return np.asarray(multi_mode_dot(self.core, list(self.factors)))


def hosvd(tensor: np.ndarray, ranks: Sequence[int] | None = None) -> Tucker:
    """Decompose a tensor by the singular vectors of its unfoldings.

    Parameters
    ----------
    tensor
        Any number of modes, without missing entries.
    ranks
        Columns kept of every mode; all by default.

    Raises
    ------
    InputError
        If an entry is missing or a rank is not between 1 and the mode's length.
    """
    ranks = _checked(tensor, ranks)
    factors = []
    for mode, rank in enumerate(ranks):
        left = np.linalg.svd(np.asarray(tl.unfold(tensor, mode)), full_matrices=False)[0]
        factors.append(_completed(left, rank))
    core = multi_mode_dot(tensor, [factor.T for factor in factors])
    return Tucker(np.asarray(core), tuple(factors))


@dataclass(frozen=True)
class PaperRule:
    """The paper's recognition, see the module.

    cells
        (C, D) vectors of the cells, in the subspace of the position mode.
    basis
        (D, R) columns of S_position.
    level
        (C, M) levels of the cells.
    joint
        (D,) index of the joint of every entry of a vector.
    weight
        (J,) weight of every joint.
    """

    cells: Float[np.ndarray, "c d"]
    basis: Float[np.ndarray, "d r"]
    level: Int[np.ndarray, "c m"]
    joint: Int[np.ndarray, " d"]
    weight: Float[np.ndarray, " j"]

    def distances(self, x: Float[np.ndarray, "n d"], mode: int) -> Float[np.ndarray, "n k"]:
        """Give the weighted distance of probes to every class of a mode."""
        gap = (x @ self.basis @ self.basis.T)[:, None] - self.cells[None]
        of_joint = (self.joint[:, None] == np.arange(len(self.weight))).astype(float)
        by_joint = np.square(gap) @ of_joint
        classes = self.level[:, mode].max() + 1
        nearest = [by_joint[:, self.level[:, mode] == k].min(axis=1) for k in range(classes)]
        return np.stack(nearest, axis=1) @ self.weight


def paper_rule(
    x: Float[np.ndarray, "n d"],
    level: Int[np.ndarray, "n m"],
    joint: Int[np.ndarray, " d"],
    weight: Float[np.ndarray, " j"],
    rank: int,
) -> PaperRule:
    """Build the tensor of the cells' mean vectors and keep its position mode.

    Parameters
    ----------
    x
        Training vectors.
    level
        Their levels; two modes or more.
    joint, weight
        As in `PaperRule`.
    rank
        Columns kept of the position mode.

    Raises
    ------
    InputError
        If a combination of levels has no segment: the classical tensor needs all.
    """
    shape = tuple(int(count) for count in level.max(axis=0) + 1)
    flat = np.ravel_multi_index(tuple(level.T), shape)
    counts = np.bincount(flat, minlength=int(np.prod(shape)))
    if (counts == 0).any():
        cell = np.unravel_index(int(np.argmin(counts)), shape)
        raise InputError(
            "tensor",
            f"there is no segment of the levels {tuple(int(i) for i in cell)}",
            "Record it, or use the Bayesian tensor, which allows for missing cells",
        )
    means = np.stack([x[flat == cell].mean(axis=0) for cell in range(len(counts))])
    tensor = means.T.reshape(x.shape[1], *shape)
    full = [min(rank, x.shape[1], len(counts)), *shape]
    basis = hosvd(tensor, full).factors[0]
    levels = np.stack(np.unravel_index(np.arange(len(counts)), shape), axis=1)
    return PaperRule(means @ basis @ basis.T, basis, levels, joint, weight)


def _checked(tensor: np.ndarray, ranks: Sequence[int] | None) -> tuple[int, ...]:
    """Refuse missing entries and ranks that do not fit."""
    if not np.isfinite(tensor).all():
        raise InputError(
            "tensor", "it has missing entries", "Use the Bayesian tensor for missing cells"
        )
    found = tuple(tensor.shape if ranks is None else ranks)
    if len(found) != tensor.ndim or not all(
        1 <= r <= n for r, n in zip(found, tensor.shape, strict=True)
    ):
        raise InputError(
            "tensor",
            f"the ranks {found} do not fit the shape {tensor.shape}",
            "Give every mode a rank between 1 and its length",
        )
    return found


def _completed(left: np.ndarray, rank: int) -> np.ndarray:
    """Give `rank` orthonormal columns, the first ones from `left`."""
    if rank <= left.shape[1]:
        return left[:, :rank]
    # A mode longer than all others together: what is missing is orthogonal to the data.
    extra = np.linalg.svd(left, full_matrices=True)[0][:, left.shape[1] : rank]
    return np.concatenate([left, extra], axis=1)
