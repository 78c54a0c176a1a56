"""The paper's shared model, and one that looks at a window of sound, by name.

``sgplvm`` is the paper's: its A and B are two starts of the search for a new path
(`initial_values`). The latent points of ``sgplvm_window`` are all that a window of sound
tells: no bottleneck, and nothing of the map is left to overfit; it learns from every eighth
frame, a third of a second apart, where what it does not explain is nearly independent.
"""

from dataclasses import replace

from .back_constraint import MLP, BackConstraint, Identity
from .program import Dynamics, Inducing, SharedGPLVM
from .window import ContextWindow

ONE_FRAME = ContextWindow(half_width=0)
WINDOW = ContextWindow(half_width=8, lag_scale=4.0, feature_scale=10.0, components=150)
PUBLISHED = {
    "sgplvm": SharedGPLVM(
        back=BackConstraint("audio", MLP(), ONE_FRAME), dynamics=Dynamics(linear=1.0),
        inducing=Inducing(150, above=0),
    ),
    "sgplvm_window": SharedGPLVM(
        latent_size=WINDOW.components, back=BackConstraint("audio", Identity(), WINDOW),
        relevance=False, dynamics=None, inducing=None, every=8,
    ),
}  # fmt: skip


def published(name: str, features: int) -> SharedGPLVM:
    """Return one of `PUBLISHED` for a back-constrained view of so many features.

    A map that is the identity has as many coordinates as its window has principal components:
    no more than numbers.
    """
    model = PUBLISHED[name]
    assert model.back is not None
    window = model.back.window
    numbers = (2 * window.half_width + 1) * features
    if not isinstance(model.back.map, Identity) or numbers >= model.latent_size:
        return model
    fewer = replace(window, components=numbers)
    return replace(model, latent_size=numbers, back=replace(model.back, window=fewer))
