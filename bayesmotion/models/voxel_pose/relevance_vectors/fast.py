"""Type-II maximum likelihood of the multivariate relevance vector machine, one basis at a time.

Tipping and Faul (2003) for many outputs that share the precisions alpha. The log marginal
likelihood depends on one alpha_i as `marginal` tells. With one output, or all
sparsities alike, its maximum is in closed form; here it is found by Newton's steps on
ln alpha. Each step adds, takes out or changes the basis that gains most, and updates all
means, covariances, s and q by rank one; the noise precisions are estimated again now and
then (`noise_precisions`), and then everything is computed anew.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ....errors import InputError
from ....search_state import SearchState
from .marginal import (
    best_alpha,
    gain_at,
    log_marginal,
    noise_precisions,
    patterns,
    posterior,
)

# Steps between two estimates of the noise, at least; with more bases in, as many as those.
ROUND = 40
# A basis that is zero at every row seen of an output says nothing of it.
TINY = 1e-300


@dataclass(frozen=True)
class Relevant:
    """The basis functions that were kept, and the posterior of their weights.

    kept
        (A,) which of the B basis functions.
    alpha
        (A,) precisions.
    beta
        (M,) noise precisions.
    mean
        (M, A) of the weights.
    covariance
        (M, A, A) of the weights.
    log_marginal
        Log marginal likelihood.
    steps
        How many were taken.
    converged
        Whether nothing more was to gain.
    """

    kept: Int[np.ndarray, " a"]
    alpha: Float[np.ndarray, " a"]
    beta: Float[np.ndarray, " m"]
    mean: Float[np.ndarray, "m a"]
    covariance: Float[np.ndarray, "m a a"]
    log_marginal: float
    steps: int
    converged: bool

    def predict(
        self, phi: Float[np.ndarray, "n a"]
    ) -> tuple[Float[np.ndarray, "n m"], Float[np.ndarray, "n m"]]:
        """Return means and variances of outputs at points where the kept bases are phi."""
        signal = np.stack([np.sum((phi @ C) * phi, axis=1) for C in self.covariance], axis=1)
        return phi @ self.mean.T, 1.0 / self.beta + signal


def maximise_marginal(
    phi: Float[np.ndarray, "n b"],
    y: Float[np.ndarray, "n m"],
    *,
    least_noise: Float[np.ndarray, " m"] | float = 0.0,
    max_steps: int = 5000,
    tolerance: float = 1e-3,
    progress: Callable[[int, float], None] | None = None,
    state: SearchState | None = None,
) -> Relevant:
    """Find the precisions that make the outputs likeliest.

    Parameters
    ----------
    phi
        (N, B) basis functions at the training points.
    y
        (N, M) outputs, of comparable variances: they share the precisions. NaN is missing.
    least_noise
        Variances that the noise of the outputs is at least. Where neighbouring points hardly
        differ, as frames of a motion do, the likeliest noise is next to none, and nearly all
        points are kept: the marginal likelihood takes them for independent.
    max_steps
        At most so many basis functions are added, taken out or changed.
    tolerance
        Gain of log marginal likelihood below which no step is taken. The noise is estimated
        until it changes by less than a hundredth of that, as a share of itself.
    progress
        Called with the steps done and the log marginal likelihood, after each round.
    state
        Where an earlier search stood, and where this one is kept.

    Raises
    ------
    InputError
        If an output does not vary, there are fewer than two points, or the least noise is
        negative.
    """
    variance = np.nanvar(y, axis=0) if len(y) > 1 else np.zeros(y.shape[1])
    if not np.all(variance > 0):
        raise InputError("outputs", "one of them does not vary", "Leave it out")
    least = np.broadcast_to(np.asarray(least_noise, dtype=float), variance.shape)
    if not np.all(least >= 0):
        raise InputError("least_noise", f"it is {least.min()}", "Give variances, or zero")
    search, state = _Search(phi, y, least), state or SearchState()
    steps, limit = state.steps(max_steps)
    if state.saved is not None:
        search.go_on_from(state.saved)
    converged = False
    while steps < limit and not converged:
        before = search.beta
        most = min(max(ROUND, len(search.active)), limit - steps)
        taken = search.climb(most, tolerance)
        steps += taken
        search.estimate_noise()
        changed = float(np.abs(np.log(search.beta / before)).max())
        still = max(1e-4, 1e-2 * tolerance)
        converged = taken < most and steps < limit and changed < still
        if taken == 0 and not converged and changed < 1e-2:
            # Only the noise still moves, and hardly: estimate it to the end.
            converged = search.finish_noise()
        state.keep(steps, limit, search.kept)
        if progress is not None:
            progress(steps, search.log_marginal())
    return search.result(steps, converged)


class _Search:
    """The state of the search: bases in the model, posterior, s and q of all bases."""

    def __init__(self, phi: np.ndarray, y: np.ndarray, least: np.ndarray) -> None:
        self.phi, self.y, self.least = phi, y, least
        self.beta = 1.0 / np.maximum(least, np.nanvar(y, axis=0) / 10.0)
        self.products = phi.T @ np.nan_to_num(y)
        # Products of the bases, one matrix for all outputs with the same rows seen.
        self.pattern = np.zeros(y.shape[1], dtype=int)
        grams = []
        for seen, own in patterns(y):
            self.pattern[own] = len(grams)
            grams.append(phi[seen].T @ phi[seen])
        self.gram = np.array(grams)
        self.diagonal = np.diagonal(self.gram, axis1=1, axis2=2)[self.pattern].T
        # Begin with the one that says most of all outputs.
        says = (self.products**2 / np.maximum(self.diagonal, TINY) * self.beta).sum(axis=1)
        self.active = [int(says.argmax())]
        self.alpha = np.array([float(self.diagonal[self.active[0]].max())])
        self.refresh()

    def refresh(self) -> None:
        """Compute everything anew from alpha and beta."""
        A, M = len(self.active), len(self.beta)
        # There is room for more bases, so that adding one moves nothing.
        room = A + A // 2 + ROUND
        self._wide = np.empty((*self.gram.shape[:2], room))
        self._wide[:, :, :A] = self.gram[:, :, self.active]
        # Outputs of one noise share a covariance if the same rows are seen of them: where the
        # least noise holds they all do.
        kinds = np.column_stack([self.beta, self.pattern])
        _, self.first, self.level = np.unique(kinds, axis=0, return_index=True, return_inverse=True)
        self.levels, self.kind = self.beta[self.first], self.pattern[self.first]
        self.mean = np.empty((M, A))
        self._room = np.zeros((len(self.levels), room, room))
        self.S, self.Q = np.empty_like(self.products.T), np.empty_like(self.products.T)
        for g, beta in enumerate(self.levels):
            own = self.level == g
            products, columns = self.products[:, own], self.columns[self.kind[g]]
            mean, covariance, _ = posterior(
                columns[self.active], products[self.active], self.alpha, beta
            )
            explained = np.sum((columns @ covariance) * columns, axis=1)
            self._room[g, :A, :A] = covariance
            self.mean[own] = mean.T
            self.S[own] = beta * self.diagonal[:, own].T - beta**2 * explained
            self.Q[own] = beta * (products - columns @ mean).T

    def kept(self) -> dict[str, np.ndarray]:
        """Return all that the search between two rounds is made of."""
        return {"active": np.array(self.active), "alpha": self.alpha, "beta": self.beta}

    def go_on_from(self, saved: Mapping[str, np.ndarray]) -> None:
        """Take up the search that was kept."""
        self.active, self.alpha = saved["active"].tolist(), saved["alpha"]
        self.beta = saved["beta"]
        self.refresh()

    @property
    def shared(self) -> np.ndarray:
        """The covariances (G, A, A) of the weights at each of the G levels of noise."""
        A = len(self.active)
        return self._room[:, :A, :A]

    @property
    def covariance(self) -> np.ndarray:
        """The covariances (M, A, A) of the weights of every output."""
        return self.shared[self.level]

    @property
    def columns(self) -> np.ndarray:
        """The columns (P, B, A) of the products of all bases with those in the model."""
        return self._wide[:, :, : len(self.active)]

    def _across(self, rows: np.ndarray) -> np.ndarray:
        """Return the products (G, B) of rows (G, A) with the columns of their patterns."""
        if len(self.gram) == 1:
            return rows @ self.columns[0].T
        return np.einsum("ga,gba->gb", rows, self.columns[self.kind])

    def climb(self, steps: int, tolerance: float) -> int:
        """Take steps while they gain; tell how many were taken."""
        for step in range(steps):
            s, q = self._without_own()
            best, height = best_alpha(s, q)
            now = np.zeros(len(best))
            now[self.active] = gain_at(self.alpha, s[:, self.active], q[:, self.active])
            gain = np.maximum(height, 0.0) - now
            if len(self.active) == 1 and height[self.active[0]] <= 0:
                gain[self.active[0]] = 0.0  # the last one stays
            chosen = int(gain.argmax())
            if gain[chosen] < tolerance:
                return step
            if height[chosen] <= 0:
                self._take_out(chosen)
            elif chosen in self.active:
                self._change(chosen, float(best[chosen]))
            else:
                self._add(chosen, float(best[chosen]))
        return steps

    def _without_own(self) -> tuple[np.ndarray, np.ndarray]:
        """Return s and q: S and Q as they are with the basis itself left out."""
        s, q = self.S.copy(), self.Q.copy()
        own = self.alpha / np.maximum(self.alpha - self.S[:, self.active], 1e-12 * self.alpha)
        s[:, self.active] *= own
        q[:, self.active] *= own
        # Rounding may leave nothing, or less, of what is nearly explained.
        return np.maximum(s, 1e-12 * self.beta[:, None] * self.diagonal.T), q

    def _add(self, chosen: int, alpha: float) -> None:
        beta = self.levels[:, None]
        size = 1.0 / (alpha + self.S[self.first, chosen])
        weight = size[self.level] * self.Q[:, chosen]
        gram = self.gram[self.kind, chosen]
        towards = beta * (self.shared @ gram[:, self.active, None])[:, :, 0]
        seen = beta * (gram - self._across(towards))
        A = len(self.active)
        if self._room.shape[1] == A:
            more = (0, A // 2 + 1)
            self._room = np.pad(self._room, ((0, 0), more, more))
            self._wide = np.pad(self._wide, ((0, 0), (0, 0), more))
        for g, room in enumerate(self._room):
            room[:A, :A] += np.multiply.outer(size[g] * towards[g], towards[g])
            room[:A, A] = room[A, :A] = -size[g] * towards[g]
            room[A, A] = size[g]
        self.mean = np.column_stack([self.mean - weight[:, None] * towards[self.level], weight])
        self.S -= (size[:, None] * seen**2)[self.level]
        self.Q -= weight[:, None] * seen[self.level]
        self.active.append(chosen)
        self.alpha = np.append(self.alpha, alpha)
        self._wide[:, :, A] = self.gram[:, :, chosen]

    def _change(self, chosen: int, alpha: float) -> None:
        place = self.active.index(chosen)
        column = self.shared[:, :, place]
        more = alpha - self.alpha[place]
        # 1 / (C_jj + 1 / more), also where the change is tiny.
        share = more / (1.0 + more * column[:, place])
        self._move(place, share, column)
        self.alpha[place] = alpha

    def _take_out(self, chosen: int) -> None:
        place = self.active.index(chosen)
        column = self.shared[:, :, place]
        self._move(place, 1.0 / column[:, place], column)
        self.mean = np.delete(self.mean, place, axis=1)
        A = len(self.active)
        for room in self._room:
            room[place : A - 1, :A] = room[place + 1 : A, :A]
            room[: A - 1, place : A - 1] = room[: A - 1, place + 1 : A]
        self._wide[:, :, place : A - 1] = self._wide[:, :, place + 1 : A]
        self.alpha = np.delete(self.alpha, place)
        self.active.pop(place)

    def _move(self, place: int, share: np.ndarray, column: np.ndarray) -> None:
        """Update for a precision of the basis at `place` that has changed; (G,) and (G, A)."""
        column = column.copy()
        seen = self.levels[:, None] * self._across(column)
        weight = share[self.level] * self.mean[:, place]
        for g, block in enumerate(self.shared):
            block -= np.multiply.outer(share[g] * column[g], column[g])
        self.mean = self.mean - weight[:, None] * column[self.level]
        self.S += (share[:, None] * seen**2)[self.level]
        self.Q += weight[:, None] * seen[self.level]

    def estimate_noise(self) -> None:
        """Estimate the noise precisions once, and compute everything anew."""
        beta = noise_precisions(
            self.phi[:, self.active], self.y, self.alpha, self.mean, self.covariance
        )
        self.beta = 1.0 / np.maximum(1.0 / beta, self.least)
        self.refresh()

    def finish_noise(self, rounds: int = 50) -> bool:
        """Estimate the noise until it stays as it is; tell whether it does."""
        for _ in range(rounds):
            before = self.beta
            self.estimate_noise()
            if np.abs(np.log(self.beta / before)).max() < 1e-5:
                return True
        return False

    def log_marginal(self) -> float:
        return log_marginal(self.phi[:, self.active], self.y, self.alpha, self.beta)

    def result(self, steps: int, converged: bool) -> Relevant:
        order = np.argsort(self.active)
        return Relevant(
            np.array(self.active)[order],
            self.alpha[order],
            self.beta,
            # In the order of memory a file has, so that products round alike.
            np.ascontiguousarray(self.mean[:, order]),
            np.ascontiguousarray(self.covariance[:, order][:, :, order]),
            self.log_marginal(),
            steps,
            converged,
        )
