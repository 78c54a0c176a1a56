"""How a model is fitted: one function, and one small object a method.

    fit(model, recordings, method=NUTS(draws=500, chains=4), seed=0)

A method is a frozen dataclass of settings with a name; a name alone means its defaults.
All of them give a `Fit`. Which ones a model has is in its `about.methods`.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import xarray as xr

from ..errors import InputError
from ..fit import Fit
from ..model import Fittable, FittedByEM, FittedByFastMarginal, FittedLocally
from ..programs import forget_programs, one_at_a_time
from ..seeds import require_seed
from .optimisation.map import fit_map
from .optimisation.point import estimate_fit
from .sampling.ensemble import EnsembleStart, fit_ensemble
from .sampling.nuts import fit_nuts
from .sampling.nuts_chains import Mass
from .sampling.whitening import Start

Progress = Callable[[int, float], None]


@dataclass(frozen=True)
class Run:
    """How a method is run, whatever the method.

    seed
        The one seed.
    checkpoint
        File for the state of a long run; none where None.
    resume
        Go on from the checkpoint if there is one.
    progress
        Called with the steps done and the best log density.
    """

    seed: int = 0
    checkpoint: Path | None = None
    resume: bool = False
    progress: Progress | None = None


@runtime_checkable
class Method(Protocol):
    """A way to fit a model."""

    name: ClassVar[str]

    def __call__(self, model: Any, recordings: xr.Dataset, run: Run) -> Fit:
        """Fit the model."""
        ...


@dataclass(frozen=True)
class MAP:
    """The posterior mode, by L-BFGS from several initial values.

    initial
        How many initial values are tried.
    keep
        How many of them are followed to the end.
    max_steps
        At most so many steps.
    """

    initial: int = 4
    keep: int = 2
    max_steps: int = 1000
    name: ClassVar[str] = "map"

    def __call__(self, model: Any, recordings: xr.Dataset, run: Run) -> Fit:
        """Fit the model; see `inference.optimisation.map.fit_map`."""
        return fit_map(
            model, recordings, starts=self.initial, keep=self.keep, max_steps=self.max_steps,
            **_run(run),
        )  # fmt: skip


@dataclass(frozen=True)
class NUTS:
    """Draws from the posterior by the no-U-turn sampler; see `inference.sampling.nuts.fit_nuts`.

    Parameters
    ----------
    draws
        Kept of every chain.
    warmup
        Iterations of every chain that adapt the sampler, and are not kept.
    chains
        How many.
    start
        ``map``: around the mode; ``typical``: where the draws are, in the scales found there, for
        paths of hundreds of unknowns; ``prior``: at draws of the prior.
    mass
        The mass matrix that is adapted; ``dense`` for few unknowns and a long warm-up.
    max_tree_depth
        At most 2^n - 1 leapfrog steps a draw.
    integrate
        Whether sites that can be integrated out are, and drawn again for each draw.
    """

    draws: int = 500
    warmup: int = 500
    chains: int = 4
    start: Start = "map"
    mass: Mass = "diagonal"
    max_tree_depth: int = 10
    integrate: bool = True
    name: ClassVar[str] = "nuts"

    def __call__(self, model: Any, recordings: xr.Dataset, run: Run) -> Fit:
        """Fit the model."""
        return fit_nuts(model, recordings, **asdict(self), **_run(run))


@dataclass(frozen=True)
class Ensemble:
    """Draws by an ensemble of walkers, for models of few unknowns; see `fit_ensemble`.

    Parameters
    ----------
    draws
        Kept of all, evenly chosen.
    warmup
        Steps of every walker that are not kept.
    steps
        Of every walker after that.
    walkers
        How many; None: three for each unknown.
    start
        ``map``: around the mode; ``prior``: at draws of the prior.
    """

    draws: int = 2000
    warmup: int = 1000
    steps: int = 2000
    walkers: int | None = None
    start: EnsembleStart = "map"
    name: ClassVar[str] = "ensemble"

    def __call__(self, model: Any, recordings: xr.Dataset, run: Run) -> Fit:
        """Fit the model."""
        return fit_ensemble(model, recordings, **asdict(self), **_run(run))


@dataclass(frozen=True)
class EM:
    """Expectation maximisation, for models that have it.

    max_steps
        At most so many steps.
    tolerance
        Gain of the log density, relative to its size, below which a step is the last.
    """

    max_steps: int = 200
    tolerance: float = 1e-6
    name: ClassVar[str] = "em"

    def __call__(self, model: Any, recordings: xr.Dataset, run: Run) -> Fit:
        """Fit the model."""
        if not isinstance(model, FittedByEM):
            raise _no_method(model, self.name)
        return estimate_fit(
            model, recordings, model.em, self.name, asdict(self), **_run(run)
        )  # fmt: skip


@dataclass(frozen=True)
class FastMarginal:
    """Fast marginal likelihood (Tipping and Faul 2003), for models that have it.

    max_steps
        At most so many steps, of one basis function each.
    tolerance
        Gain of log marginal likelihood below which no step is taken.
    """

    max_steps: int = 4000
    tolerance: float = 1e-3
    name: ClassVar[str] = "fast_marginal"

    def __call__(self, model: Any, recordings: xr.Dataset, run: Run) -> Fit:
        """Fit the model."""
        if not isinstance(model, FittedByFastMarginal):
            raise _no_method(model, self.name)
        return estimate_fit(
            model, recordings, model.fast_marginal, self.name, asdict(self), **_run(run)
        )  # fmt: skip


@dataclass(frozen=True)
class LocalLearning:
    """Learning patch by patch, for models whose latent points lie about a surface.

    sweeps
        How often the surface is covered.
    """

    sweeps: int = 40
    name: ClassVar[str] = "local"

    def __call__(self, model: Any, recordings: xr.Dataset, run: Run) -> Fit:
        """Fit the model."""
        if not isinstance(model, FittedLocally):
            raise _no_method(model, self.name)
        return estimate_fit(
            model, recordings, model.local_learning, self.name, asdict(self), **_run(run)
        )  # fmt: skip


METHODS: Mapping[str, type[Method]] = {
    kind.name: kind for kind in (MAP, NUTS, Ensemble, EM, FastMarginal, LocalLearning)
}


@one_at_a_time
def fit(
    model: Fittable,
    recordings: xr.Dataset,
    *,
    method: Method | str | None = None,
    seed: int = 0,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Fit:
    """Fit a model to recordings.

    Parameters
    ----------
    model
        The model with its settings.
    recordings
        What the model explains (`bm.models()` says which); NaN where missing.
    method
        A method object, or its name for its default settings; the model's first method
        where None.
    seed
        The one seed: the same seed gives the same fit.
    checkpoint, resume
        File for the state of a long run, and whether to go on from there; where there is no
        such file yet the run begins. A search that has not converged goes on for `max_steps` more.
    progress
        Called with the steps done and the best log density.

    Returns
    -------
    The fit: model, recordings, and a DataTree with ArviZ's groups. A point estimate is a
    posterior of one draw.

    Raises
    ------
    InputError
        If the recordings do not suit the model, the model has no such method, or the seed is
        out of range.
    NumericalError
        If no initial values have a finite log density.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> model, walks = bm.example("multifactor")
    >>> fit = bm.fit(model, walks, method=bm.MAP(max_steps=50), seed=0)
    """
    require_seed(seed)
    forget_programs()
    names = _methods_of(model)
    chosen = _method(names[0] if method is None else method)
    if chosen.name not in names:
        raise _no_method(model, chosen.name)
    if resume and checkpoint is None:
        raise InputError("resume", "there is nothing to go on from", "Name the file: checkpoint=")
    path = None if checkpoint is None else Path(checkpoint)
    found = chosen(model, recordings, Run(seed, path, resume, progress))
    if is_dataclass(chosen):
        # As the method is made from them again (`evaluate.held_out`).
        found.tree.attrs["settings"] = json.dumps(asdict(chosen))
    return found


def _method(method: Method | str) -> Method:
    if not isinstance(method, str):
        return method
    if method not in METHODS:
        raise InputError(
            f"method {method!r}", "there is no such method", f"Use one of {', '.join(METHODS)}"
        )
    return METHODS[method]()


def _methods_of(model: Any) -> tuple[str, ...]:
    """Return the names of a model's methods; any program has those that need no verb."""
    about = getattr(model, "about", None)
    return ("map", "nuts", "ensemble") if about is None else about.methods


def _no_method(model: Any, name: str) -> InputError:
    return InputError(
        f"method {name!r}",
        f"model {model.name!r} is not fitted by it",
        f"Use one of {', '.join(_methods_of(model))}",
    )


def _run(run: Run) -> dict[str, Any]:
    return {
        "seed": run.seed,
        "checkpoint": run.checkpoint,
        "resume": run.resume,
        "progress": run.progress,
    }


__all__ = [
    "EM",
    "MAP",
    "METHODS",
    "NUTS",
    "Ensemble",
    "FastMarginal",
    "LocalLearning",
    "Method",
    "Run",
    "fit",
]
