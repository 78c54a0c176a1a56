"""A model of six unknowns, and clips that are arrays: everything compiles in seconds."""

from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import xarray as xr

from bayesmotion import registry


@dataclass(frozen=True)
class LineData:
    """x (n,) and y (n, 2) of a regression."""

    x: np.ndarray
    y: np.ndarray

    @property
    def data(self) -> tuple:
        return (self.x, self.y)

    def observed(self) -> xr.Dataset:
        return xr.Dataset({"y": (("point", "output"), self.y)})

    def constants(self) -> xr.Dataset:
        return xr.Dataset({"x": ("point", self.x)})


@dataclass(frozen=True)
class Line:
    """y_d = a_d + b_d x + noise: the posterior is known but for the noise's scale."""

    spread: float = 10.0
    name: ClassVar[str] = "line"

    def prepare(self, motion):
        return LineData(motion["x"].values, motion["y"].values)

    def program(self, x, y):
        a = numpyro.sample("a", dist.Normal(0.0, self.spread).expand([2]).to_event(1))
        b = numpyro.sample("b", dist.Normal(0.0, self.spread).expand([2]).to_event(1))
        noise = numpyro.sample("noise", dist.LogNormal(0.0, 1.0).expand([2]).to_event(1))
        mean = numpyro.deterministic("mean", a + b * jnp.asarray(x)[:, None])
        numpyro.sample("y", dist.Normal(mean, noise), obs=y)

    def initial_values(self, training, seed, count):
        random = np.random.default_rng(seed)
        one = {"noise": np.ones(2)}
        return [
            {**one, "a": random.normal(size=2), "b": random.normal(size=2)} for _ in range(count)
        ]

    def dims(self):
        outputs = ("output",)
        own = {"y": ("point", "output"), "mean": ("point", "output")}
        return own | dict.fromkeys(("a", "b", "noise"), outputs)

    def coords(self, training):
        return {"output": ["left", "right"], "point": list(range(len(training.x)))}


def clips() -> xr.Dataset:
    """Two lines, one a hundred times as steep as the other."""
    random = np.random.default_rng(3)
    x = np.linspace(2.0, 5.0, 30)
    y = np.array([1.0, -2.0]) + np.outer(x, [0.5, 30.0]) + random.normal(size=(30, 2)) * [0.05, 1.0]
    return xr.Dataset({"x": ("point", x), "y": (("point", "output"), y)})


@pytest.fixture(scope="session")
def line_motion():
    return clips()


@pytest.fixture(scope="session")
def line(monkeypatch_session):
    monkeypatch_session.setitem(registry._REGISTERED, Line.name, Line)
    return Line()


@pytest.fixture(scope="session")
def monkeypatch_session():
    with pytest.MonkeyPatch.context() as patch:
        yield patch
