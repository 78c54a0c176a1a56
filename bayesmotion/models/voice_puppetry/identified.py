"""What data can tell of a chain: functions that are the same however its states are numbered.

log_likelihood          log p(all outputs | theta)
transition_power        trace of A, A^2, A^3 over K: sums of powers of the eigenvalues
sorted_<output>         the states' means of every feature, in order
log_volume_<output>     log |Lambda| / D of the states, in order
expected_<output>       sum_s p(s_t | y) mu_s at frames spread over the clips
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...gp.linalg import AnyArray
from ...model import Values
from .data import Frames
from .hidden_markov import recursions

if TYPE_CHECKING:
    from .program import VoicePuppetry

SHOWN = 4  # frames
POWERS = (1, 2, 3)


def quantities(model: "VoicePuppetry", frames: Frames, values: Mapping[str, AnyArray]) -> Values:
    """Return the quantities of the module."""
    found = recursions(model.chain(values, frames), model.emissions(values, frames))
    share = jnp.exp(found.posterior[_shown(frames)])
    transition = jnp.asarray(values["transition"])
    powers = [jnp.trace(jnp.linalg.matrix_power(transition, p)) / model.states for p in POWERS]
    out = {"log_likelihood": jnp.sum(found.frame), "transition_power": jnp.stack(powers)}
    for name in model.outputs:
        mean = jnp.asarray(values[f"{name}_mean"])
        volume = jnp.linalg.slogdet(jnp.asarray(values[f"{name}_precision"]))[1]
        out[f"sorted_{name}"] = jnp.sort(mean, axis=0)
        out[f"log_volume_{name}"] = jnp.sort(volume) / mean.shape[1]
        out[f"expected_{name}"] = share @ mean
    return out


def left_out(
    model: "VoicePuppetry", frames: Frames, values: Mapping[str, AnyArray]
) -> Float[Array, " n"]:
    """Return the log density of every frame given all others."""
    emission = model.emissions(values, frames)
    return recursions(model.chain(values, frames), emission).left_out(emission)


def dims(model: "VoicePuppetry") -> dict[str, tuple[str, ...]]:
    """Return the dimensions of the quantities."""
    found: dict[str, tuple[str, ...]] = {"log_likelihood": (), "transition_power": ("power",)}
    for name in model.outputs:
        found[f"sorted_{name}"] = ("rank", f"{name}_feature")
        found[f"log_volume_{name}"] = ("rank",)
        found[f"expected_{name}"] = ("shown_frame", f"{name}_feature")
    return found


def coords(model: "VoicePuppetry", frames: Frames) -> dict[str, list]:
    """Return the labels of ranks, powers and frames."""
    return {
        "rank": list(range(model.states)),
        "power": list(POWERS),
        "shown_frame": _shown(frames).tolist(),
    }


def _shown(frames: Frames) -> Int[np.ndarray, " f"]:
    n = len(frames.begins)
    return ((np.arange(min(SHOWN, n)) + 0.5) * n / min(SHOWN, n)).astype(int)
