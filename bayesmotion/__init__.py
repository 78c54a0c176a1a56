"""Bayesian models of human motion.

>>> import bayesmotion as bm
>>> model, recordings = bm.example("multifactor")
>>> fit = bm.fit(model, recordings, method=bm.MAP(max_steps=50), seed=0)

All that users need is a name of this package; each is imported when it is first asked for.
"""

import importlib
import os
import sys
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any

# The covariance matrices here have hundreds of rows, where a second BLAS thread
# gains little; but on a busy machine waiting threads spin, and one evaluation has
# been seen to take fifteen times as long. Whoever sets the variable keeps their value.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

# Every factorisation of a covariance here is done in double precision: the
# kernel matrices of smooth motion have condition numbers far above 1e7.
jax.config.update("jax_enable_x64", True)

__version__ = "0.1.0"

if TYPE_CHECKING:
    from .catalogue import example, models
    from .criticism.alignment import aligned
    from .criticism.calibration import calibrate
    from .criticism.checks import predictive_check, predictive_groups, prior_sensitivity
    from .criticism.compare import compare
    from .criticism.contract import check_model
    from .criticism.diagnostics import diagnose
    from .criticism.identified import identified
    from .criticism.loo import leave_one_out
    from .criticism.rank_test import rank_test
    from .errors import InputError, MotionWarning, NumericalError
    from .fit import Fit, load
    from .inference.methods import EM, MAP, NUTS, Ensemble, FastMarginal, LocalLearning, fit
    from .inference.predicting import Prediction, predict
    from .model import About, Model, PointEstimate, SBCCase, Units, draw_sites, register
    from .models.multifactor import OU, Circle, Factor, GPDynamics, Multifactor, White
    from .motion import check, clips, downsample, read, split, with_labels, write
    from .prediction import Bernoulli, GPPredictive, IndependentNormal, Mixture, Predictive
    from .tasks.forecast import Forecast, forecast
    from .tasks.recognize import recognize
    from .tasks.synthesise import Synthesis, synthesize

# Public names by the module that has them.
_PUBLIC: dict[str, tuple[str, ...]] = {
    "catalogue": ("example", "models"),
    "criticism.alignment": ("aligned",),
    "criticism.calibration": ("calibrate",),
    "criticism.checks": ("predictive_check", "predictive_groups", "prior_sensitivity"),
    "criticism.compare": ("compare",),
    "criticism.contract": ("check_model",),
    "criticism.diagnostics": ("diagnose",),
    "criticism.identified": ("identified",),
    "criticism.loo": ("leave_one_out",),
    "criticism.rank_test": ("rank_test",),
    "errors": ("InputError", "MotionWarning", "NumericalError"),
    "fit": ("Fit", "load"),
    "inference.methods": (
        "EM", "MAP", "NUTS", "Ensemble", "FastMarginal", "LocalLearning", "fit",
    ),
    "inference.predicting": ("Prediction", "predict"),
    "models.multifactor": ("OU", "Circle", "Factor", "GPDynamics", "Multifactor", "White"),
    "motion": ("check", "clips", "downsample", "read", "split", "with_labels", "write"),
    "model": ("About", "Model", "PointEstimate", "SBCCase", "Units", "draw_sites", "register"),
    "prediction": ("Bernoulli", "GPPredictive", "IndependentNormal", "Mixture", "Predictive"),
    "tasks.recognize": ("recognize",),
    "tasks.forecast": ("Forecast", "forecast"),
    "tasks.synthesise": ("Synthesis", "synthesize"),
}  # fmt: skip
_WHERE = {name: module for module, names in _PUBLIC.items() for name in names}

__all__ = sorted(_WHERE)  # pyright: ignore[reportUnsupportedDunderAll]


@cache
def _public(name: str) -> Any:
    return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)


class _Package(ModuleType):
    """The package as users see it: a public name is itself, whatever module is called so too."""

    def __getattribute__(self, name: str) -> Any:
        """Import a public name when it is first asked for: reading files needs no sampler."""
        return _public(name) if name in _WHERE else super().__getattribute__(name)

    def __dir__(self) -> list[str]:
        """Return the public names."""
        return __all__


sys.modules[__name__].__class__ = _Package
