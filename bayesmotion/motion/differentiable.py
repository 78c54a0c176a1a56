"""Forward kinematics in JAX: joint positions as a function that has a gradient."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .kinematics import parts_of, poses_of, rotations_of
from .skeleton import Skeleton


def rotations(
    skeleton: Skeleton, angle: Float[Array | np.ndarray, "*batch dof"]
) -> Float[Array, "*batch joint 3 3"]:
    """Give the global rotation of every joint.

    Differentiable, and to be compiled with `skeleton` static.

    Parameters
    ----------
    skeleton
        The tree.
    angle
        Angles in radians in the order of `skeleton.dofs`.

    Returns
    -------
    Rotation matrices from each joint's frame to the world, in the order of
    `skeleton.joints`; the identity where all angles are zero.
    """
    tree, frames, _ = parts_of(skeleton)
    return jnp.asarray(rotations_of(jnp, tree, frames, jnp.asarray(angle)))


def forward(
    skeleton: Skeleton,
    angle: Float[Array | np.ndarray, "*batch dof"],
    root_position: Float[Array | np.ndarray, "*batch 3"],
) -> Float[Array, "*batch joint 3"]:
    """Give the position of every joint.

    Differentiable (gradients are finite everywhere), and to be compiled with
    `skeleton` static: ``jax.jit(forward, static_argnums=0)``.

    Parameters
    ----------
    skeleton
        The tree.
    angle
        Angles in radians in the order of `skeleton.dofs`.
    root_position
        Positions of the root in the skeleton's unit.

    Returns
    -------
    Positions in the skeleton's unit, in the order of `skeleton.joints`.
    """
    tree, frames, offsets = parts_of(skeleton)
    where, _ = poses_of(jnp, tree, frames, offsets, jnp.asarray(angle), jnp.asarray(root_position))
    return jnp.asarray(where)
