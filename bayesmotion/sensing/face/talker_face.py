"""The synthetic talker's face, drawn from her jaw and lips.

Lengths are in units of the face: 128 of them are the picture's width, the origin lies
between the eyes and the mouth, y points down. Drawn with curves and shading, not with the
warp of the appearance model, so that the model is not right by construction.
"""

import itertools

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter, map_coordinates
from skimage.draw import polygon

from .procrustes import inverse, moved

FINE = 2  # pixels drawn for a pixel of the picture, along each axis
JAW, BROWS, EYES, NOSE, OUTER, INNER = 9, 6, 8, 4, 8, 8
OUTER_LIPS = slice(JAW + BROWS + EYES + NOSE, JAW + BROWS + EYES + NOSE + OUTER)
INNER_LIPS = slice(OUTER_LIPS.stop, OUTER_LIPS.stop + INNER)
LANDMARKS = INNER_LIPS.stop
# Colours: ground, hair, skin, brow, lip, mouth, teeth, white of the eye, iris.
GROUND, HAIR, SKIN = (90.0, 130.0, 150.0), (70.0, 45.0, 30.0), (205.0, 160.0, 135.0)
BROW, LIP, MOUTH = (75.0, 50.0, 38.0), (165.0, 85.0, 85.0), (60.0, 20.0, 25.0)
TEETH, WHITE, IRIS = (225.0, 220.0, 205.0), (235.0, 232.0, 228.0), (60.0, 80.0, 90.0)
SKIN_GRID = 96  # points of the skin's texture along each axis


def skin_of(random: np.random.Generator) -> Float[np.ndarray, "n n"]:
    """Make freckles and shades, in grey levels, that stay where they are on the face."""
    coarse = gaussian_filter(random.normal(size=(SKIN_GRID, SKIN_GRID)), 6.0, mode="wrap")
    fine = gaussian_filter(random.normal(size=(SKIN_GRID, SKIN_GRID)), 1.2, mode="wrap")
    return 9.0 * coarse / coarse.std() + 7.0 * fine / fine.std()


def face_landmarks(
    seen: Float[np.ndarray, "*t 3"], poses: Float[np.ndarray, "*t 4"]
) -> Float[np.ndarray, "*t l 2"]:
    """Give the landmarks of faces: jaw, brows, eyes, nose, outer and inner lips.

    Parameters
    ----------
    seen
        Jaw opening, lip rounding, lip closure, each between 0 and 1.
    poses
        Take units of the face to pixels.
    """
    jaw, rounding, closure = np.moveaxis(seen, -1, 0)[..., None]
    around = np.linspace(np.pi, 0.0, JAW)
    outline = np.stack(
        [40.0 * np.cos(around) + 0 * jaw, -6.0 + (56.0 + 9.0 * jaw) * np.sin(around)], axis=-1
    )
    still = np.broadcast_to(_upper_face(), (*jaw.shape[:-1], BROWS + EYES + NOSE, 2))
    lips = _lips(jaw, rounding, closure)
    return moved(np.concatenate([outline, still, lips], axis=-2), poses)


def draw_face(
    seen: Float[np.ndarray, " 3"],
    pose: Float[np.ndarray, " 4"],
    size: int,
    skin: Float[np.ndarray, "n n"],
) -> Float[np.ndarray, "h w 3"]:
    """Draw a face in a square picture of `size` pixels."""
    finer = pose * FINE
    # A fine pixel's centre is not its corner: pixel x of the picture holds FINE of them.
    finer[2:] += (FINE - 1) / 2.0
    marks = face_landmarks(seen, finer)
    rows, columns = np.indices((FINE * size, FINE * size)).astype(float)
    at = moved(np.stack([columns, rows], axis=-1).reshape(-1, 2), inverse(finer))
    x, y = at.T.reshape(2, *rows.shape)
    canvas = np.empty((*rows.shape, 3))
    canvas[:] = GROUND
    canvas -= 0.25 * y[..., None]
    head = (x / 46.0) ** 2 + ((y + 22.0) / 46.0) ** 2 < 1.0
    canvas[head] = HAIR
    cheeks = _filled(_skull(marks, finer), canvas.shape)
    canvas[cheeks] = _skin_colour(x[cheeks], y[cheeks], float(seen[0]), skin)
    _draw_eyes(canvas, marks, finer[0])
    canvas[_filled(_curve(marks[OUTER_LIPS]), canvas.shape)] = LIP
    _draw_mouth(canvas, marks, finer[0])
    soft = gaussian_filter(canvas, (0.7 * FINE, 0.7 * FINE, 0.0))
    return soft.reshape(size, FINE, size, FINE, 3).mean(axis=(1, 3))


def _upper_face() -> np.ndarray:
    """Give what does not move with speech: brows, eyes, nose."""
    brow = np.array([[28.0, -26.0], [19.0, -30.0], [9.0, -27.0]])
    eye = np.array([[25.0, -15.0], [18.0, -19.0], [11.0, -15.0], [18.0, -12.0]])
    nose = np.array([[0.0, -14.0], [-8.0, 9.0], [0.0, 12.0], [8.0, 9.0]])
    mirror = np.array([-1.0, 1.0])
    return np.concatenate([brow * mirror, brow[::-1], eye * mirror, eye[[2, 1, 0, 3]], nose])


def _lips(jaw: np.ndarray, rounding: np.ndarray, closure: np.ndarray) -> np.ndarray:
    """Give eight landmarks around the lips and eight around their opening."""
    around = np.pi - np.arange(8) * np.pi / 4.0  # from the left corner over the top
    opening = (15.0 * jaw + 4.0 * rounding * (1.0 - jaw) + 1.0) * (1.0 - closure)
    width = 19.0 + 2.0 * jaw - 8.0 * rounding
    thick = (5.0 + 1.5 * rounding) * (1.0 - 0.4 * closure)
    upper, lower = 30.0 - 0.2 * opening, 30.0 + 0.8 * opening
    top = np.sin(around) > 0
    rise = np.abs(np.sin(around)) ** 0.8
    inner_y = 30.0 + np.where(top, (upper - 30.0) * rise, (lower - 30.0) * rise)
    outer_y = inner_y + np.where(top, -thick * rise, 1.2 * thick * rise)
    outer = np.stack([width * np.cos(around), outer_y], axis=-1)
    inner = np.stack([(width - 3.5) * np.cos(around), inner_y], axis=-1)
    return np.concatenate([outer, inner], axis=-2)


def _skull(marks: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Give the outline of the skin: the jaw's landmarks, and the forehead above them."""
    around = np.linspace(0.0, -np.pi, 12)[1:-1]
    forehead = moved(np.stack([40.0 * np.cos(around), -6.0 + 36.0 * np.sin(around)], axis=1), pose)
    return _curve(np.concatenate([marks[:JAW], forehead]))


def _skin_colour(x: np.ndarray, y: np.ndarray, jaw: float, skin: np.ndarray) -> np.ndarray:
    """Give the skin's colours at points of the face; below the mouth it is drawn out."""
    rest = np.where(y > 20.0, 20.0 + (y - 20.0) / (1.0 + 0.25 * jaw), y)
    places = np.stack([rest, x]) * SKIN_GRID / 128.0 + SKIN_GRID / 2.0
    shade = map_coordinates(skin, places, order=1, mode="grid-wrap")
    round_off = 22.0 * ((x / 40.0) ** 2 + ((y - 5.0) / 60.0) ** 2)
    nose = 14.0 * np.exp(-((x / 4.0) ** 2) - ((y - 2.0) / 14.0) ** 2)
    nose -= 16.0 * np.exp(-(((np.abs(x) - 5.0) / 2.5) ** 2) - ((y - 11.0) / 2.5) ** 2)
    return np.array(SKIN) + (shade + nose - round_off)[:, None]


def _draw_eyes(canvas: np.ndarray, marks: np.ndarray, scale: float) -> None:
    """Draw brows and eyes."""
    for side in (0, 1):
        brow = marks[JAW + 3 * side : JAW + 3 * side + 3]
        thickness = np.array([0.0, 3.0 * scale])
        canvas[_filled(np.concatenate([brow, brow[::-1] + thickness]), canvas.shape)] = BROW
        eye = marks[JAW + BROWS + 4 * side : JAW + BROWS + 4 * side + 4]
        canvas[_filled(_curve(eye), canvas.shape)] = WHITE
        around = np.linspace(0.0, 2 * np.pi, 16)[:-1]
        iris = eye.mean(axis=0) + 3.0 * scale * np.stack([np.cos(around), np.sin(around)], axis=1)
        canvas[_filled(iris, canvas.shape)] = IRIS


def _draw_mouth(canvas: np.ndarray, marks: np.ndarray, scale: float) -> None:
    """Draw the mouth's opening, with the upper teeth in it."""
    opening = _filled(_curve(marks[INNER_LIPS]), canvas.shape)
    canvas[opening] = MOUTH
    edge = _curve(marks[INNER_LIPS])
    top = edge[: len(edge) // 2]
    teeth = _filled(np.concatenate([top, top[::-1] + np.array([0.0, 4.0 * scale])]), canvas.shape)
    canvas[opening & teeth] = TEETH


def _curve(points: np.ndarray, fine: int = 6) -> np.ndarray:
    """Draw a smooth closed curve through points."""
    closed = np.concatenate([points, points[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    spline = CubicSpline(along, closed, bc_type="periodic")
    steps = [np.linspace(a, b, fine, endpoint=False) for a, b in itertools.pairwise(along)]
    return spline(np.concatenate(steps))


def _filled(outline: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Give the pixels inside an outline."""
    inside = np.zeros(shape[:2], dtype=bool)
    rows, columns = polygon(outline[:, 1], outline[:, 0], shape[:2])
    inside[rows, columns] = True
    return inside
