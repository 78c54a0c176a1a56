"""Symmetric positive definite matrices factorised and inverted block by block.

With blocks of a few hundred rows nearly all of the work is in matrix products, which XLA does at
the full speed of a core, while the triangular solves and inverses that it hands to LAPACK come to
half of that. Of K = L L^T the blocks of rows i and columns j are

    C_ij = K_ij - sum_(k < j) L_ik L_jk^T,    L_jj = chol C_jj,    L_ij = C_ij L_jj^-T,
    U = L^-T:   U_jj = L_jj^-T,    U_ij = -(sum_(i <= k < j) U_ik L_jk^T) L_jj^-T   for i < j,
    K^-1 = U U^T:   (K^-1)_ij = sum_(k >= i) U_ik U_jk^T   for j <= i,

with n^3 / 3 multiplications and additions each, as LAPACK's potrf, trtri and lauum. Every product
is of rows with rows (A B^T), which is the fastest that there is; A^T B takes half as long again.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .linalg import AnyArray, triangular_inverse

# Rows of a block: fewer make many small products, more leave much to LAPACK.
ROWS = 110
# Blocks at most: with their number grows what is to be compiled.
BLOCKS = 8


class Blocks(NamedTuple):
    """A Cholesky factor L, block by block.

    rows
        L_jk for each block j and those k before it: (n_j, n_k).
    inverses
        L_jj^-1 for each block j: (n_j, n_j).
    """

    rows: tuple[tuple[Float[Array, "_ _"], ...], ...]
    inverses: tuple[Float[Array, "_ _"], ...]


def sizes_of(n: int) -> tuple[int, ...]:
    """Return into blocks of how many rows each n rows are cut.

    Examples
    --------
    >>> sizes_of(330)
    (110, 110, 110)
    """
    count = min(BLOCKS, max(1, round(n / ROWS)))
    ends = [n * k // count for k in range(count + 1)]
    return tuple(end - begin for begin, end in pairwise(ends))


def factorise(
    K: Float[AnyArray, "n n"], Z: Float[AnyArray, "d n"], nugget: Float[AnyArray, ""] | float = 0.0
) -> tuple[Blocks, Float[Array, "d n"], Float[Array, ""]]:
    """Return the blocks of L, H = Z L^-T and log |K|: of a row z of Z, |z L^-T|^2 = z K^-1 z^T.

    The nugget is added to the diagonal of K, without a copy; the lower triangle alone is read.
    From where K is not positive definite all is NaN.

    Examples
    --------
    >>> import jax.numpy as jnp
    >>> _, H, logdet = factorise(4.0 * jnp.eye(2), jnp.ones((1, 2)))
    >>> H.tolist(), round(float(logdet), 4)
    ([[0.5, 0.5]], 2.7726)
    """
    K, Z, begin, logdet = jnp.asarray(K), jnp.asarray(Z), 0, jnp.zeros((), K.dtype)
    columns: list[tuple[Array, Array]] = []
    rows, inverses = [], []
    for size in sizes_of(len(K)):
        end = begin + size
        C, H, eye = K[begin:, begin:end], Z[:, begin:end], jnp.eye(size, dtype=K.dtype)
        row = tuple(below[len(below) - len(C) :][:size] for below, _ in columns)
        for (below, of_z), own in zip(columns, row, strict=True):
            C, H = C - below[len(below) - len(C) :] @ own.T, H - of_z @ own.T
        L = jax.lax.linalg.cholesky(C[:size] + nugget * eye, symmetrize_input=False)
        inverse = triangular_inverse(L)
        columns.append((C[size:] @ inverse.T, H @ inverse.T))
        rows.append(row)
        inverses.append(inverse)
        logdet = logdet + 2.0 * jnp.sum(jnp.log(jnp.diagonal(L)))
        begin = end
    whitened = jnp.concatenate([of_z for _, of_z in columns], axis=1)
    return Blocks(tuple(rows), tuple(inverses)), whitened, logdet


def inverse_rows(blocks: Blocks) -> list[Float[Array, "_ _"]]:
    """Return U_(i, i:) for each block i, of the upper triangular U = L^-T."""
    upper: list[list[Array]] = []
    for j, (row, inverse) in enumerate(zip(*blocks, strict=True)):
        for i, own in enumerate(upper):
            total = sum((own[k - i] @ row[k].T for k in range(i + 1, j)), own[0] @ row[i].T)
            own.append(-(total @ inverse.T))
        upper.append([inverse.T])
    return [jnp.concatenate(own, axis=1) for own in upper]


def products(
    left: Sequence[Float[AnyArray, "_ _"]], right: Sequence[Float[AnyArray, "_ _"]]
) -> Float[Array, "n n"]:
    """Return the product of rows from the diagonal on with others, where that is symmetric.

    Block (i, j), j <= i, is the sum over k >= i of left_ik right_jk^T; that of the rows of
    U with themselves is K^-1. All rows end at the same column.
    """
    lower = [
        [jnp.asarray(one) @ other[:, other.shape[1] - one.shape[1] :].T for other in right[: i + 1]]
        for i, one in enumerate(left)
    ]
    count = range(len(left))
    whole = [[lower[i][j] if j <= i else lower[j][i].T for j in count] for i in count]
    return jnp.concatenate([jnp.concatenate(row, axis=1) for row in whole])
