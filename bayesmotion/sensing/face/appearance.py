"""Active appearance model of a face (Cootes, Edwards and Taylor 1998).

    s = mean_s + P_s b_s                 shape: landmarks aligned by Procrustes analysis
    g = mean_g + P_g b_g                 texture: colours, warped onto the mean shape
    (w b_s, b_g) = Q c                   both from the parameters c

P_s, P_g and Q are principal components that keep 95 % of the variance each; w^2 is the ratio
of the textures' variance to the shapes', so that a pixel of one and a grey level of the other
weigh as much as they vary. A picture is the texture painted onto the shape, moved to where
the head is: the pose is no part of c.

Where several people are given, each has means of their own, and the components span what
changes within a person: a face at rest is then c = 0 for everyone, and `of` makes the model
of a person who was not among them. With one person this is the model of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Shaped

from ...errors import InputError
from .mesh import Mesh, make_mesh, paint_texture, take_texture
from .procrustes import generalised_procrustes, inverse, moved, pose_to

KEEP = 0.95


@dataclass(frozen=True)
class AppearanceModel:
    """An active appearance model with k parameters.

    mesh
        On the mean shape of all people.
    mean_shape
        (L, 2) in pixels, centred.
    mean_texture
        (P C,) colours, 0 to 255, pixel by pixel.
    shape_basis
        (2 L, ks) orthonormal components P_s.
    texture_basis
        (P C, kg) orthonormal components P_g.
    weight
        w, grey levels a pixel.
    basis
        (ks + kg, k) orthonormal components Q.
    spread
        (k,) standard deviations of the parameters in training.
    kept
        Shares of the variance that the three analyses keep: shape, texture, both.
    """

    mesh: Mesh
    mean_shape: Float[np.ndarray, "l 2"]
    mean_texture: Float[np.ndarray, " pc"]
    shape_basis: Float[np.ndarray, "ll ks"]
    texture_basis: Float[np.ndarray, "pc kg"]
    weight: float
    basis: Float[np.ndarray, "ksg k"]
    spread: Float[np.ndarray, " k"]
    kept: tuple[float, float, float]

    @property
    def channels(self) -> int:
        """Give the number of colours, 1 or 3."""
        return len(self.mean_texture) // len(self.mesh.pixels)

    def textures(
        self, frames: Shaped[np.ndarray, "n h w *c"], landmarks: Float[np.ndarray, "n l 2"]
    ) -> Float[np.ndarray, "n pc"]:
        """Take textures off pictures under known landmarks, in grey levels 0 to 255."""
        return _textures(self.mesh, frames, landmarks)

    def encode(
        self, frames: Shaped[np.ndarray, "n h w *c"], landmarks: Float[np.ndarray, "n l 2"]
    ) -> Float[np.ndarray, "n k"]:
        """Give the parameters of pictures with known landmarks.

        Raises
        ------
        InputError
            If pictures or landmarks do not fit the model.
        """
        self.check(frames, landmarks)
        aligned = moved(landmarks, pose_to(landmarks, self.mean_shape))
        shape = (aligned - self.mean_shape).reshape(len(frames), -1) @ self.shape_basis
        texture = (self.textures(frames, landmarks) - self.mean_texture) @ self.texture_basis
        return np.hstack([self.weight * shape, texture]) @ self.basis

    def decode(
        self, parameters: Float[np.ndarray, "n k"]
    ) -> tuple[Float[np.ndarray, "n l 2"], Float[np.ndarray, "n pc"]]:
        """Give the shapes, centred, and the textures of parameters."""
        both = parameters @ self.basis.T
        count = self.shape_basis.shape[1]
        shape = both[:, :count] @ self.shape_basis.T / self.weight
        texture = self.mean_texture + both[:, count:] @ self.texture_basis.T
        return self.mean_shape + shape.reshape(len(parameters), -1, 2), texture

    def poses(self, landmarks: Float[np.ndarray, "n l 2"]) -> Float[np.ndarray, "n 4"]:
        """Give where heads are in pictures: the poses that take the mean shape there."""
        return inverse(pose_to(landmarks, self.mean_shape))

    def landmarks(
        self, parameters: Float[np.ndarray, "n k"], poses: Float[np.ndarray, "*n 4"]
    ) -> Float[np.ndarray, "n l 2"]:
        """Give the landmarks of parameters in pictures where heads are at poses."""
        return moved(self.decode(parameters)[0], poses)

    def render(
        self,
        parameters: Float[np.ndarray, "n k"],
        poses: Float[np.ndarray, "*n 4"],
        background: Shaped[np.ndarray, "h w *c"],
    ) -> Float[np.ndarray, "n h w c"]:
        """Paint the faces of parameters onto a picture, at one pose or at one for each.

        Raises
        ------
        InputError
            If the picture's colours are not the model's.
        """
        ground = _coloured(background[None])[0]
        if ground.shape[-1] != self.channels:
            raise InputError(
                "background",
                f"it has {ground.shape[-1]} channels and the model {self.channels}",
                "Give a picture like the model's",
            )
        shapes, textures = self.decode(parameters)
        colours = np.clip(textures, 0.0, 255.0).reshape(len(textures), -1, self.channels)
        places = moved(shapes, poses)
        painted = [
            paint_texture(self.mesh, one, at, ground)
            for one, at in zip(colours, places, strict=True)
        ]
        return np.stack(painted) if painted else np.empty((0, *ground.shape))

    def of(
        self, frames: Shaped[np.ndarray, "n h w *c"], landmarks: Float[np.ndarray, "n l 2"]
    ) -> "AppearanceModel":
        """Give the model of another person: her means, and the components as they are.

        Raises
        ------
        InputError
            As `encode`.
        """
        self.check(frames, landmarks)
        aligned = moved(landmarks, pose_to(landmarks, self.mean_shape))
        texture = self.textures(frames, landmarks).mean(axis=0)
        return replace(self, mean_shape=aligned.mean(axis=0), mean_texture=texture)

    def check(self, frames: np.ndarray, landmarks: np.ndarray) -> None:
        """Refuse pictures and landmarks that are not like those of training.

        Raises
        ------
        InputError
            If they are not.
        """
        _check_pictures(frames, landmarks)
        if landmarks.shape[1] != len(self.mean_shape):
            raise InputError(
                "landmarks",
                f"there are {landmarks.shape[1]} and the model has {len(self.mean_shape)}",
                "Mark pictures as those of training",
            )
        if _coloured(frames[:1]).shape[-1] != self.channels:
            raise InputError(
                "pictures", f"the model has {self.channels} channels", "Give such pictures"
            )


def fit_appearance(
    frames: Shaped[np.ndarray, "n h w *c"],
    landmarks: Float[np.ndarray, "n l 2"],
    *,
    person: Sequence[str] | None = None,
    keep: float = KEEP,
    scale: float = 1.0,
) -> AppearanceModel:
    """Fit an active appearance model to pictures with known landmarks.

    Parameters
    ----------
    frames
        Grey or with channels, 0 to 255.
    landmarks
        x, y in pixels; pixel centres are whole numbers.
    person
        Who is in every picture; by default the same in all.
    keep
        Share of the variance that each of the three analyses keeps.
    scale
        Pixels of the texture for a pixel of the pictures.

    Raises
    ------
    InputError
        If pictures and landmarks do not fit each other, nothing varies, or a setting is out
        of its range.
    """
    _check_pictures(frames, landmarks)
    people = np.zeros(len(frames), dtype=int) if person is None else np.asarray(person)
    if len(people) != len(frames):
        raise InputError("person", "there is not one for every picture", "Name who is in each")
    if not 0 < keep <= 1 or not scale > 0:
        raise InputError(
            f"keep {keep}, scale {scale}", "they are out of range", "Keep at most 1 of it"
        )
    aligned, mean, _ = generalised_procrustes(landmarks)
    mesh = make_mesh(mean, scale)
    shapes = _within(aligned.reshape(len(frames), -1), people)
    taken = _textures(mesh, frames, landmarks)
    textures = _within(taken, people)
    shape_basis, shape_kept = principal(shapes, keep)
    texture_basis, texture_kept = principal(textures, keep)
    weight = float(np.sqrt(np.var(textures, axis=0).sum() / np.var(shapes, axis=0).sum()))
    both = np.hstack([weight * shapes @ shape_basis, textures @ texture_basis])
    basis, kept = principal(both, keep)
    spread = (both @ basis).std(axis=0)
    return AppearanceModel(
        mesh, mean, taken.mean(axis=0), shape_basis, texture_basis, weight, basis, spread,
        (shape_kept, texture_kept, kept),
    )  # fmt: skip


def principal(
    rows: Float[np.ndarray, "n d"], keep: float
) -> tuple[Float[np.ndarray, "d k"], float]:
    """Give the fewest principal components of centred rows that keep a share of the variance.

    Returns
    -------
    The components, orthonormal, and the share they keep.

    Raises
    ------
    InputError
        If the rows are all the same.
    """
    count, width = rows.shape
    # The smaller of the two matrices has all the eigenvalues that are not zero.
    small = rows.T @ rows if width <= count else rows @ rows.T
    values, vectors = np.linalg.eigh(small)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    if values[0] <= 1e-12 * max(1.0, count):
        raise InputError("pictures", "nothing changes from one to the next", "Give other pictures")
    share = np.cumsum(values) / values.sum()
    number = int(np.searchsorted(share, keep - 1e-12)) + 1
    basis = vectors[:, :number]
    if width > count:
        basis = rows.T @ basis / np.sqrt(values[:number])
    return basis, float(share[number - 1])


def _within(rows: np.ndarray, people: np.ndarray) -> np.ndarray:
    """Take every person's mean off her rows."""
    out = np.empty_like(rows)
    for one in np.unique(people):
        out[people == one] = rows[people == one] - rows[people == one].mean(axis=0)
    return out


def _coloured(frames: np.ndarray) -> np.ndarray:
    """Give pictures as numbers with an axis of channels."""
    return np.asarray(frames if frames.ndim == 4 else frames[..., None], dtype=float)


def _textures(mesh: Mesh, frames: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Take the textures off pictures, one row for each."""
    # Picture by picture: all of them as floating point numbers would take eight times the room.
    rows = [
        take_texture(mesh, _coloured(one[None])[0], at).ravel()
        for one, at in zip(frames, landmarks, strict=True)
    ]
    return np.stack(rows)


def _check_pictures(frames: np.ndarray, landmarks: np.ndarray) -> None:
    """Refuse pictures without landmarks and landmarks without pictures."""
    if len(frames) == 0 or len(frames) != len(landmarks):
        raise InputError(
            "pictures",
            f"there are {len(frames)}, and landmarks of {len(landmarks)}",
            "Give landmarks for every picture",
        )
    if frames.ndim not in (3, 4) or (frames.ndim == 4 and frames.shape[-1] not in (1, 3)):
        raise InputError(
            "pictures", f"they have the shape {frames.shape}", "Give grey or colour pictures"
        )
    if not np.isfinite(landmarks).all():
        missing = int((~np.isfinite(landmarks).all(axis=(1, 2))).sum())
        raise InputError(
            "landmarks",
            f"{missing} pictures have landmarks that are missing",
            "Leave these pictures out",
        )
