"""Pinhole cameras: on a circle, or calibrated and read from a file.

A camera sees the point X (metres, y up) at the pixel (u, v) with

    s (u, v, 1) = K (R X + t),    s the depth, positive before the camera.

Pixel (0, 0) is the centre of the upper left one, u goes to the right, v down.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...errors import InputError
from ...files import write_json

WIDTH, HEIGHT = 640, 480
FIELD = 32.0  # degrees from the middle of the picture to its left or right edge


@dataclass(frozen=True, eq=False)
class Camera:
    """One calibrated camera.

    Parameters
    ----------
    name
        What it is called.
    width, height
        Size of its picture in pixels.
    intrinsic
        K (3, 3), upper triangular, in pixels.
    rotation
        R (3, 3) from the world to the camera.
    translation
        t (3,) in metres.

    Raises
    ------
    InputError
        If a number is not finite, K is not upper triangular with positive focal lengths, or R
        is no rotation.
    """

    name: str
    width: int
    height: int
    intrinsic: Float[np.ndarray, "3 3"]
    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, " 3"]

    def __post_init__(self) -> None:
        """Check the calibration once."""
        K, R, where = self.intrinsic, self.rotation, f"camera {self.name!r}"
        if not all(np.isfinite(part).all() for part in (K, R, self.translation)):
            raise InputError(where, "its K, R or t is not finite", "Mend its numbers")
        if np.any(np.tril(K, -1)) or not np.all(np.diag(K) > 0) or K[2, 2] != 1:
            raise InputError(
                where,
                "its K is not upper triangular with a last entry of 1",
                "Give focal lengths and centre in pixels",
            )
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise InputError(where, "its R is no rotation", "Give the rotation world to camera")
        if self.width < 1 or self.height < 1:
            raise InputError(where, "its picture has no pixels", "Give width and height")

    @cached_property
    def projection(self) -> Float[np.ndarray, "3 4"]:
        """K [R t]."""
        return self.intrinsic @ np.column_stack([self.rotation, self.translation])

    @cached_property
    def place(self) -> Float[np.ndarray, " 3"]:
        """Where it stands, in metres."""
        return -self.rotation.T @ self.translation

    def project(
        self, points: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """Give pixels (u, v) and depths in metres of points.

        Pixels of points behind the camera mean nothing; in its plane they are far out.
        """
        seen = points @ self.projection[:, :3].T + self.projection[:, 3]
        depth = np.where(np.abs(seen[:, 2]) < 1e-9, 1e-9, seen[:, 2])
        return seen[:, :2] / depth[:, None], depth


def circle(
    count: int,
    *,
    radius: float = 6.0,
    height: float = 1.6,
    first: float = 0.0,
    target: tuple[float, float, float] = (0.0, 1.0, 0.0),
    field: float = FIELD,
) -> list[Camera]:
    """Put cameras evenly on a circle, all looking at its middle.

    Parameters
    ----------
    count
        How many.
    radius, height
        Of the circle about the vertical through `target`, and above the floor, in metres.
    first
        Angle in degrees from +z to the first camera, seen from above towards +x.
    target
        Where they look, in metres.
    field
        Degrees from the middle of the picture to its left or right edge.

    Raises
    ------
    InputError
        If a number is not usable.
    """
    if count < 1 or radius <= 0 or not 0 < field < 80:
        raise InputError(
            "cameras", f"{count} at {radius} m, field {field}", "Give at least one, at a distance"
        )
    focal = WIDTH / 2 / np.tan(np.radians(field))
    K = np.array([[focal, 0.0, (WIDTH - 1) / 2], [0.0, focal, (HEIGHT - 1) / 2], [0.0, 0.0, 1.0]])
    cameras = []
    for index in range(count):
        angle = np.radians(first) + 2 * np.pi * index / count
        place = np.array([np.sin(angle) * radius + target[0], height, 0.0])
        place[2] = np.cos(angle) * radius + target[2]
        R = _looking(place, np.array(target))
        cameras.append(Camera(f"camera{index + 1}", WIDTH, HEIGHT, K, R, -R @ place))
    return cameras


def _looking(place: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Give the rotation of an upright camera: x to the right, y down, z ahead."""
    ahead = (target - place) / np.linalg.norm(target - place)
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def moved(cameras: Sequence[Camera], by: Float[np.ndarray, " 3"]) -> list[Camera]:
    """Move cameras by a vector in metres."""
    return [
        Camera(c.name, c.width, c.height, c.intrinsic, c.rotation, c.translation - c.rotation @ by)
        for c in cameras
    ]


def write_cameras(path: str | Path, cameras: Sequence[Camera]) -> None:
    """Write cameras as JSON: a list of name, width, height, K, R and t."""
    rows = [
        {
            "name": c.name,
            "width": c.width,
            "height": c.height,
            "K": c.intrinsic.tolist(),
            "R": c.rotation.tolist(),
            "t": c.translation.tolist(),
        }
        for c in cameras
    ]
    write_json(path, rows)


def read_cameras(path: str | Path) -> list[Camera]:
    """Read cameras that `write_cameras`, or somebody by hand, wrote.

    Raises
    ------
    InputError
        If the file is not there, is no such list, or a camera is not usable.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path")
    try:
        rows = json.loads(path.read_text(encoding="utf-8-sig"))
        cameras = [
            Camera(
                str(row["name"]),
                int(row["width"]),
                int(row["height"]),
                np.array(row["K"], dtype=float).reshape(3, 3),
                np.array(row["R"], dtype=float).reshape(3, 3),
                np.array(row["t"], dtype=float).reshape(3),
            )
            for row in rows
        ]
    except (KeyError, TypeError, RecursionError, json.JSONDecodeError) as error:
        raise InputError(
            path, f"it is no list of cameras ({error})", "Give name, width, height, K, R, t of each"
        ) from error
    except (OverflowError, ValueError) as error:
        raise InputError(path, f"a camera cannot be used ({error})", "Mend its numbers") from error
    if not cameras:
        raise InputError(path, "it holds no camera", "Give at least one")
    return cameras
