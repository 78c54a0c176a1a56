"""Shapes up to where they lie, how large they are and how they are turned.

A shape is L landmarks in the plane, written as complex numbers z_l = x_l + i y_l. A pose
moves it: z -> a z + t, where a = s exp(i phi) scales and turns. The pose that takes z
closest to w in the sum of squares is

    a = sum_l conj(z_l - mean z) (w_l - mean w) / sum_l |z_l - mean z|^2,   t = mean w - a mean z

Generalised Procrustes analysis (Gower 1975) takes all shapes closest to their mean, whose
own place, turn and size are fixed by convention.
"""

import numpy as np
from jaxtyping import Float

from ...errors import InputError

ROUNDS = 100
CLOSE = 1e-10  # change of the mean, relative to its size, at which the rounds end


def pose_to(
    shape: Float[np.ndarray, "*n l 2"], target: Float[np.ndarray, "*m l 2"]
) -> Float[np.ndarray, "*k 4"]:
    """Give the poses that take shapes closest to targets: (Re a, Im a, Re t, Im t)."""
    z, w = _complex(shape), _complex(target)
    middle_z, middle_w = z.mean(axis=-1, keepdims=True), w.mean(axis=-1, keepdims=True)
    centred = z - middle_z
    a = (centred.conj() * (w - middle_w)).sum(axis=-1) / (np.abs(centred) ** 2).sum(axis=-1)
    t = middle_w[..., 0] - a * middle_z[..., 0]
    return np.stack([a.real, a.imag, t.real, t.imag], axis=-1)


def moved(
    shape: Float[np.ndarray, "*n l 2"], pose: Float[np.ndarray, "*m 4"]
) -> Float[np.ndarray, "*k l 2"]:
    """Move shapes by poses."""
    a, t = pose[..., 0] + 1j * pose[..., 1], pose[..., 2] + 1j * pose[..., 3]
    z = a[..., None] * _complex(shape) + t[..., None]
    return np.stack([z.real, z.imag], axis=-1)


def inverse(pose: Float[np.ndarray, "*n 4"]) -> Float[np.ndarray, "*n 4"]:
    """Give the poses that undo poses."""
    a, t = pose[..., 0] + 1j * pose[..., 1], pose[..., 2] + 1j * pose[..., 3]
    back = 1.0 / a
    shift = -t / a
    return np.stack([back.real, back.imag, shift.real, shift.imag], axis=-1)


def generalised_procrustes(
    shapes: Float[np.ndarray, "n l 2"],
) -> tuple[Float[np.ndarray, "n l 2"], Float[np.ndarray, "l 2"], Float[np.ndarray, "n 4"]]:
    """Take shapes closest to their mean.

    Returns
    -------
    The shapes at the mean's place, turn and size; the mean, centred, as large as the shapes
    are on average and turned as the first; and the poses that take them back.

    Raises
    ------
    InputError
        If there are no shapes, fewer than three landmarks, or a shape is a single point.
    """
    if len(shapes) == 0 or shapes.shape[1] < 3 or not np.isfinite(shapes).all():
        raise InputError(
            "landmarks", "shapes of three or more known landmarks are needed", "Check their file"
        )
    sizes = _size(shapes)
    if sizes.min() <= 1e-9 * max(sizes.max(), 1.0):
        raise InputError("landmarks", "those of a shape are all in one point", "Check their file")
    mean = _centred(shapes[0])
    mean = mean * sizes.mean() / _size(mean)
    aligned = shapes
    for _ in range(ROUNDS):
        aligned = moved(shapes, pose_to(shapes, mean))
        new = _centred(aligned.mean(axis=0))
        new = moved(new, pose_to(new, _centred(shapes[0])))
        new = _centred(new) * sizes.mean() / _size(new)
        change = np.abs(new - mean).max() / sizes.mean()
        mean = new
        if change < CLOSE:
            break
    to_mean = pose_to(shapes, mean)
    return moved(shapes, to_mean), mean, inverse(to_mean)


def _complex(shape: np.ndarray) -> np.ndarray:
    return shape[..., 0] + 1j * shape[..., 1]


def _centred(shape: np.ndarray) -> np.ndarray:
    return shape - shape.mean(axis=-2, keepdims=True)


def _size(shape: np.ndarray) -> np.ndarray:
    """Give the root of the sum of squared distances from the middle."""
    return np.asarray(np.sqrt((_centred(shape) ** 2).sum(axis=(-2, -1))))
