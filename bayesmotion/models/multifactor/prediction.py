"""A trained multifactor model, as new clips see it."""

from typing import NamedTuple

from ...distributions.dynamics import GivenSteps
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import Conditioned
from ...gp.on_circle import ConditionedOnCircle
from .frames import Frames


class Trained(NamedTuple):
    """A trained model that new clips are seen in the light of.

    hyper
        Trained values of gamma, beta, scale, and alpha where there is one.
    styles
        For each factor the trained style vectors (L, S), with their novel dimensions.
    points
        Factors and content of the training frames.
    conditioned
        The outputs' process conditioned on the training frames.
    steps
        The dynamics conditioned on the training steps, None for the circle.
    frames, values
        The training frames and all site values: where a search for new clips begins.
    """

    hyper: dict[str, AnyArray]
    styles: dict[str, AnyArray]
    points: dict[str, AnyArray]
    conditioned: Conditioned | ConditionedOnCircle
    steps: GivenSteps | None
    frames: Frames
    values: dict[str, AnyArray]
