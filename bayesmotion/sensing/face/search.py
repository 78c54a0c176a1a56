"""Finding the landmarks of a face in a new picture: search with an appearance model.

From landmarks x, the texture g under them is compared with that of a face: a linear map,
learned from starts whose way to the truth is known, gives from the one where the other is,

    d = R (g_x - mean) + r,     x <- shape model of (x + d),

with g standardised, so that light does not matter, and d in pixels of the mean shape. Cootes,
Edwards and Taylor (1998) learn one such map; here one follows the other, each learned from
where the one before it arrives (Xiong and De la Torre 2013), the first on a blurred picture,
so that it sees far. Ridge regression, its penalty chosen by leave-one-out on the training.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Shaped
from scipy.ndimage import gaussian_filter

from ...errors import InputError
from .appearance import AppearanceModel
from .mesh import Mesh, take_texture
from .procrustes import moved, pose_to

BLUR = (3.0, 2.0, 1.0, 0.5, 0.5)  # pixels, one for each step
PENALTIES = np.logspace(0.0, 6.0, 13)
POINTS = 900  # of the mesh that are looked at
LIMIT = 3.0  # standard deviations that a component of the shape may reach
TURN, GROWTH = 0.10, 0.06  # standard deviations of a start's turn and relative size


@dataclass(frozen=True)
class Found:
    """A face found in a picture.

    landmarks
        (L, 2) x, y in pixels.
    misfit
        Root mean square of what the appearance model leaves of the texture, in grey levels.
    failure
        Empty, or a sentence that says why the landmarks are not to be trusted.
    """

    landmarks: Float[np.ndarray, "l 2"]
    misfit: float
    failure: str


@dataclass(frozen=True)
class Search:
    """A trained search.

    model
        What faces look like.
    mesh
        The model's, with the p pixels that are looked at.
    maps
        For every step the matrix (2 L, p) and the constant (2 L,).
    shape_spread
        (ks,) standard deviations of the shape components, in pixels.
    worst
        Root mean square of what the mean face leaves of the training texture it is worst for,
        in grey levels: a face of the model leaves less.
    """

    model: AppearanceModel
    mesh: Mesh
    maps: tuple[tuple[np.ndarray, np.ndarray], ...]
    shape_spread: Float[np.ndarray, " ks"]
    worst: float

    def __call__(
        self, frame: Shaped[np.ndarray, "h w *c"], start: Float[np.ndarray, "l 2"]
    ) -> Found:
        """Find the face in a picture, from landmarks up to some pixels away.

        Raises
        ------
        InputError
            If the start is not like the model's landmarks.
        """
        if start.shape != self.model.mean_shape.shape or not np.isfinite(start).all():
            raise InputError(
                "start", "it is not like the model's landmarks", "Give as many, none missing"
            )
        landmarks = self._faced(start)
        for blur, (matrix, constant) in zip(BLUR, self.maps, strict=True):
            seen = _features(self.mesh, _soft(frame, blur), landmarks)
            landmarks = self._stepped(landmarks, matrix @ seen + constant)
        misfit = misfit_of(self.model, frame, landmarks)
        failure = ""
        if misfit > self.worst:
            failure = (
                f"what is under the landmarks is {misfit:.1f} grey levels away from any face of "
                f"the model, farther than training was from its mean ({self.worst:.1f}); "
                "start closer to the face"
            )
        return Found(landmarks, misfit, failure)

    def track(
        self, frames: Shaped[np.ndarray, "t h w *c"], start: Float[np.ndarray, "l 2"]
    ) -> list[Found]:
        """Find the face in the pictures of a video, each search from where the last ended."""
        found: list[Found] = []
        for frame in frames:
            found.append(self(frame, found[-1].landmarks if found else start))
        return found

    def _stepped(self, landmarks: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Move landmarks by a step in pixels of the mean shape, and keep them a face."""
        pose = pose_to(self.model.mean_shape, landmarks)
        a = pose[0] + 1j * pose[1]
        turned = a * (step[0::2] + 1j * step[1::2])
        return self._faced(landmarks + np.stack([turned.real, turned.imag], axis=1))

    def _faced(self, landmarks: np.ndarray) -> np.ndarray:
        """Give the face of the shape model closest to landmarks."""
        model = self.model
        aligned = moved(landmarks, pose_to(landmarks, model.mean_shape))
        shape = (aligned - model.mean_shape).reshape(-1) @ model.shape_basis
        shape = np.clip(shape, -LIMIT * self.shape_spread, LIMIT * self.shape_spread)
        face = model.mean_shape + (model.shape_basis @ shape).reshape(-1, 2)
        return moved(face, pose_to(face, landmarks))


def train_search(
    model: AppearanceModel,
    frames: Shaped[np.ndarray, "n h w *c"],
    landmarks: Float[np.ndarray, "n l 2"],
    *,
    seed: int,
    displacement: float = 8.0,
    starts: int = 10,
) -> Search:
    """Learn to search from starts around the true landmarks of training pictures.

    Parameters
    ----------
    model
        Fitted to these pictures, or to others like them.
    frames, landmarks
        As `bayesmotion.sensing.face.appearance.fit_appearance`.
    seed
        Of the starts.
    displacement
        How many pixels away from the truth a search may start.
    starts
        For every picture.

    Raises
    ------
    InputError
        If a setting is out of its range, or pictures do not fit the model.
    """
    from sklearn.linear_model import RidgeCV

    if not displacement > 0 or starts < 1:
        raise InputError("search", "displacement and starts", "Give positive numbers")
    model.check(frames, landmarks)
    aligned = moved(landmarks, pose_to(landmarks, model.mean_shape))
    shape = (aligned - model.mean_shape).reshape(len(frames), -1) @ model.shape_basis
    away = model.textures(frames, landmarks) - model.mean_texture
    worst = float(np.sqrt((away**2).mean(axis=1)).max())
    search = Search(model, _thinned(model.mesh), (), shape.std(axis=0), worst)
    which = np.repeat(np.arange(len(frames)), starts)
    random = np.random.default_rng(seed)
    at = [search._faced(one) for one in _started(random, landmarks[which], displacement)]
    for blur in BLUR:
        soft = [_soft(frame, blur) for frame in frames]
        now = list(zip(which, at, strict=True))
        seen = np.stack([_features(search.mesh, soft[n], one) for n, one in now])
        steps = np.stack([_way(model, one, landmarks[n]) for n, one in now])
        ridge = RidgeCV(alphas=PENALTIES).fit(seen, steps)
        search = replace(search, maps=(*search.maps, (ridge.coef_, ridge.intercept_)))
        taken = ridge.predict(seen)
        at = [search._stepped(one, step) for one, step in zip(at, taken, strict=True)]
    return search


def misfit_of(
    model: AppearanceModel, frame: Shaped[np.ndarray, "h w *c"], landmarks: Float[np.ndarray, "l 2"]
) -> float:
    """Give the root mean square of what a model leaves of the texture under landmarks."""
    rest = model.textures(frame[None], landmarks[None])[0] - model.mean_texture
    rest = rest - model.texture_basis @ (model.texture_basis.T @ rest)
    return float(np.sqrt(np.mean(rest**2)))


def _started(random: np.random.Generator, landmarks: np.ndarray, displacement: float) -> np.ndarray:
    """Move landmarks away: at most `displacement` to any side, turned and grown a little."""
    count = len(landmarks)
    far = displacement * np.sqrt(random.uniform(size=count))
    towards = random.uniform(0.0, 2 * np.pi, size=count)
    shift = np.stack([far * np.cos(towards), far * np.sin(towards)], axis=1)
    a = (1.0 + GROWTH * random.normal(size=count)) * np.exp(1j * TURN * random.normal(size=count))
    middle = landmarks.mean(axis=1, keepdims=True)
    pose = np.stack([a.real, a.imag, np.zeros(count), np.zeros(count)], axis=1)
    return moved(landmarks - middle, pose) + middle + shift[:, None]


def _way(model: AppearanceModel, landmarks: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Give the step from landmarks to the truth in pixels of the mean shape."""
    pose = pose_to(model.mean_shape, landmarks)
    step = target - landmarks
    turned = (step[:, 0] + 1j * step[:, 1]) / (pose[0] + 1j * pose[1])
    return np.stack([turned.real, turned.imag], axis=1).reshape(-1)


def _soft(frame: np.ndarray, blur: float) -> np.ndarray:
    """Give a picture in grey, blurred."""
    grey = np.asarray(frame, dtype=float)
    if grey.ndim == 3:
        grey = grey.mean(axis=-1)
    return gaussian_filter(grey, blur)


def _features(mesh: Mesh, grey: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """Give the standardised grey levels under landmarks at the pixels of a mesh."""
    found = take_texture(mesh, grey[..., None], landmarks)[:, 0]
    return (found - found.mean()) / max(float(found.std()), 1e-6)


def _thinned(mesh: Mesh) -> Mesh:
    """Keep some `POINTS` pixels of a mesh, evenly spread."""
    kept = np.unique(np.linspace(0, len(mesh.pixels) - 1, POINTS).astype(int))
    return replace(
        mesh, pixels=mesh.pixels[kept], corners=mesh.corners[kept], weights=mesh.weights[kept]
    )
