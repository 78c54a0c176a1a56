"""The models of the collection by name, and what is asked of each.

A model is a frozen dataclass of plain settings around a NumPyro program. `Model`
names its verbs; everything that fits, saves, loads and samples asks for no more.
A new model is one line in `models.MODELS`.
"""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
import xarray as xr
from jaxtyping import PRNGKeyArray

from ..errors import InputError
from ..gp.linalg import AnyArray
from . import MODELS


@runtime_checkable
class TrainingData(Protocol):
    """A model's training data."""

    @property
    def data(self) -> tuple:
        """The arguments of the model's program: pytrees of arrays."""
        ...

    def observed(self) -> xr.Dataset:
        """What the model explains, one variable an observed site, NaN where not seen."""
        ...

    def constants(self) -> xr.Dataset:
        """What is needed to bring the observed values back to their units."""
        ...


@runtime_checkable
class Model(Protocol):
    """The verbs of a model."""

    name: ClassVar[str]
    __dataclass_fields__: ClassVar[dict[str, Any]]

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Any:
        """Make the model from its fields as plain values (`dataclasses.asdict`)."""
        ...

    @property
    def prepare(self) -> Callable[..., Any]:
        """Make recordings, and settings of their features, into `TrainingData`."""
        ...

    @property
    def program(self) -> Callable[..., None]:
        """The generative program, a function of `TrainingData.data`."""
        ...

    def starts(self, training: Any, seed: int, count: int) -> list[dict[str, np.ndarray]]:
        """Give values of the program's sites to begin the search for the mode from."""
        ...

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the names of the dimensions of every site, observed ones too."""
        ...

    def coords(self, training: Any) -> dict[str, list]:
        """Give the labels of every dimension."""
        ...


@runtime_checkable
class Nested(Protocol):
    """A model whose search for the mode begins at that of a plainer one."""

    @property
    def plainer(self) -> Model | None:
        """The plainer model; None where this one is the plainest."""
        ...

    def starts_from(
        self, training: Any, seed: int, count: int, plainer: Mapping[str, AnyArray]
    ) -> list[dict[str, np.ndarray]]:
        """Give starts as `Model.starts`, from the values at the plainer model's mode."""
        ...

    def roots(self, training: Any, start: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        """Give for sites (N, Q) a root of their approximate covariance, see `maximise`."""
        ...


@runtime_checkable
class Turning(Protocol):
    """A model with latent points that count up to a rotation and reflection about the origin."""

    @property
    def turns(self) -> tuple[str, ...]:
        """Names of such sites, each (N, Q)."""
        ...


@runtime_checkable
class Collapsible(Protocol):
    """A model some of whose sites can be integrated out, and drawn again."""

    @property
    def collapsed(self) -> Callable[..., None]:
        """The program without those sites."""
        ...

    def complete_draw(
        self, key: PRNGKeyArray, frames: Any, values: Mapping[str, AnyArray]
    ) -> dict[str, AnyArray]:
        """Draw those sites given the values of the others; give all of them."""
        ...


@runtime_checkable
class Cautious(Protocol):
    """A model that says, once it is fitted, what not to trust of it."""

    def cautions(self, training: Any, values: Mapping[str, AnyArray]) -> list[str]:
        """Give a sentence for each part that its trained values leave in doubt."""
        ...


def describe_model(model: Model) -> dict[str, Any]:
    """Give a model's name and settings as plain values."""
    return {"name": model.name, **asdict(model)}


def build_model(settings: Mapping[str, Any], where: object) -> Any:
    """Make the model that `describe_model` described.

    Raises
    ------
    InputError
        If it is a model this version does not know, or with other settings.
    """
    settings = dict(settings)
    name = settings.pop("name", None)
    if name not in MODELS:
        raise InputError(where, f"it holds a fit of {name!r}", f"Known are {', '.join(MODELS)}")
    module, class_name = MODELS[name].split(":")
    kind = getattr(importlib.import_module(module, __package__), class_name)
    try:
        return kind.from_settings(settings)
    except (TypeError, KeyError) as error:
        raise InputError(
            where, f"its settings of {name!r} are of another version ({error})", "Fit again"
        ) from error
