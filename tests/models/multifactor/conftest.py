"""A problem small enough for brute force: two training clips, a new one, four features."""

from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.distributions.styles import entries_of
from bayesmotion.models.multifactor import OU, Circle, Factor, Multifactor, White
from bayesmotion.models.multifactor.frames import Frames, frames_of

D = 4
RATE = 12.0
TWO_FACTORS = (Factor("subject", size=2, novel_dims=0), Factor("gait", size=3, novel_dims=0))
LABELS = {
    "subject": {"one": "ann", "two": "ben", "new": ""},
    "gait": {"one": "walk", "two": "run", "new": "run"},
}
KNOWN = {"subject": ["ann", "ben"], "gait": ["walk", "run"]}


@dataclass(frozen=True)
class Tiny:
    """Arrays and site values of the small problem for one model."""

    model: Multifactor
    y: dict[str, np.ndarray] = field(default_factory=dict)
    values: dict[str, dict] = field(default_factory=dict)

    def frames(self, *clips: str, trained=None) -> Frames:
        known = {factor.name: KNOWN[factor.name] for factor in self.model.factors}
        return frames_of(
            {clip: self.y[clip] for clip in clips}, LABELS, known, trained, frame_rate=RATE
        )

    def sites(self, *clips: str) -> dict:
        """Site values of training clips, of the new clip, or of both together."""
        out = dict(self.values["training"]) if "one" in clips else {}
        for name, value in self.values["new"].items() if "new" in clips else ():
            out[name] = jnp.concatenate([out[name], value]) if name in out else value
        return out


def unit(x: np.ndarray, *sizes: int) -> np.ndarray:
    """A path of clips of so many frames, scaled about each clip's mean to unit mean square."""
    rows = np.split(x, np.cumsum(sizes)[:-1])
    mean = np.concatenate([np.broadcast_to(row.mean(axis=0), row.shape) for row in rows])
    return mean + (x - mean) / np.sqrt(np.mean((x - mean) ** 2))


def make_tiny(
    content=Circle(),  # noqa: B008 (frozen)
    priors: str = "proper",
    factors=TWO_FACTORS,
    residual=White(),  # noqa: B008 (frozen)
) -> Tiny:
    random = np.random.default_rng(11)
    model = Multifactor(content, factors, priors=priors, residual=residual, student_df=None)
    y = {"one": random.normal(size=(5, D)), "two": random.normal(size=(4, D))}
    y["new"] = random.normal(size=(4, D))
    y["one"][3:, 1] = np.nan
    y["two"][0, 1] = np.nan
    y["new"][2:] = np.nan
    y["new"][1, 2:] = np.nan
    training = {
        "gamma": np.array(0.7),
        "beta": np.array(20.0),
        "scale": np.array([0.5, 0.8, 1.0, 1.6]),
    }
    if residual == OU():
        training |= {
            "residual_variance": np.array([0.3, 0.1]),
            "residual_time": np.array([2.5, 1.5]),
        }
    for factor in factors:
        styles = random.normal(size=(2, factor.size))
        linear = factor.kind == "linear"
        name = f"shape_{factor.name}" if linear else f"style_{factor.name}"
        training[name] = entries_of(styles) if linear else styles
    new = {f"style_{f.name}": random.normal(size=(1, f.size)) for f in factors[:1]}
    if residual == OU(per_clip=False):
        training |= {"residual_variance": np.array([0.3]), "residual_time": np.array([2.5])}
    if residual == OU():
        new |= {"residual_variance": np.array([0.5]), "residual_time": np.array([4.0])}
    if model.on_circle:
        training |= {"phase_point": np.array([[-0.5, -0.8]]), "step": np.array([0.4, 0.7])}
        new |= {"phase_point": np.array([[0.3, 1.1]]), "step": np.array([0.5])}
    else:
        alpha = {1: [0.3, 0.8, 0.5], 2: [0.3, 0.8, 0.6, 0.5, 0.4]}[model.path.order]
        training |= {"alpha": np.array(alpha)}
        # Both paths have unit scale, and so has their union.
        training |= {"x": unit(random.normal(size=(9, 2)), 5, 4)}
        new |= {"x": unit(random.normal(size=(4, 2)), 4)}
    values = {
        name: {site: jnp.asarray(value) for site, value in part.items()}
        for name, part in (("training", training), ("new", new))
    }
    return Tiny(model, y, values)


@pytest.fixture(scope="session")
def tiny():
    """Make the small problem for a model."""
    return make_tiny
