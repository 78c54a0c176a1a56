"""Where the search for the mode of a shared latent model begins.

With a back-constraint, latent points are what ridge regression makes of the other views
from what the map sees: principal components of the prediction, each of unit size, for they
are what views have in common; if there are fewer than wanted, the main components of what
the map sees go on. Without one, they are principal components of all views together.
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from .shared_views import SharedTraining, Views

if TYPE_CHECKING:
    from .shared_gplvm import SharedGPLVM

RIDGE = 0.03  # of the mean square of what is seen, in every direction


def training_starts(
    model: "SharedGPLVM", training: SharedTraining, seed: int, count: int
) -> list[dict[str, np.ndarray]]:
    """Give `count` starts; the first has the latent points of the module as they are."""
    frames, sizes = training.frames, model.private_sizes()
    wanted = model.latent_size + (sizes[model.back] if model.back else 0)
    x = latent_start(model, frames, wanted)
    found = []
    for number in range(count):
        random = np.random.default_rng([seed, number])
        near = x + (0.3 if number else 0.0) * random.normal(size=x.shape)
        values = _hyperparameters(model)
        if model.back:
            centres = np.asarray(frames.centres)
            values |= model.constraint.start(np.asarray(frames.seen), near, centres, random)
        else:
            values["x"] = near
        for name, size in sizes.items():
            if size and name != model.back:
                values[f"{name}_private"] = random.normal(size=(len(x), size))
        found.append(values)
    return found


def latent_start(model: "SharedGPLVM", frames: Views, wanted: int) -> Float[np.ndarray, "n q"]:
    """Give latent points to begin from, each coordinate of unit size."""
    views = {name: np.asarray(y) for name, y in frames.y.items()}
    if not model.back:
        return _components(np.concatenate(list(views.values()), axis=1), wanted)
    seen = np.asarray(frames.seen)
    others = np.concatenate([y for name, y in views.items() if name != model.back], axis=1)
    gram = seen.T @ seen + RIDGE * len(seen) * np.mean(seen**2) * np.eye(seen.shape[1])
    told = seen @ np.linalg.solve(gram, seen.T @ others)
    common = _components(told, min(wanted, others.shape[1], seen.shape[1]))
    if common.shape[1] == wanted:
        return common
    rest = seen - common @ np.linalg.lstsq(common, seen)[0]
    return np.concatenate([common, _components(rest, wanted - common.shape[1])], axis=1)


def _components(y: Float[np.ndarray, "n d"], count: int) -> Float[np.ndarray, "n q"]:
    """Principal components, each of unit mean square; random ones where y has no more."""
    u = np.linalg.svd(y - y.mean(axis=0), full_matrices=False)[0][:, :count]
    return u * np.sqrt(len(y))


def _hyperparameters(model: "SharedGPLVM") -> dict[str, np.ndarray]:
    from .shared_gplvm import ALPHA_MEDIAN

    values: dict[str, np.ndarray] = {}
    if model.dynamics:
        values["alpha"] = np.array(ALPHA_MEDIAN)
    for name, size in model.private_sizes().items():
        wide = model.latent_size + size
        values[f"{name}_gamma"] = np.full([wide] if model.relevance else [], 1.0 / wide)
        for part, value in (("variance", 1.0), ("linear", 0.1), ("beta", 5.0)):
            values[f"{name}_{part}"] = np.array(value)
    return values
