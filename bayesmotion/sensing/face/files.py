"""An appearance model in a file, with a picture to paint its faces onto."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from ...errors import InputError
from ...files import PORTRAIT, replacing
from ...npz import read_arrays
from .appearance import AppearanceModel
from .mesh import Mesh
from .video import write_video

MESH = ("reference", "triangles", "pixels", "corners", "weights")
PICTURE = ("picture", "pose", "frame_rate")
MEND = "Write one with `bayesmotion portrait`"


@dataclass(frozen=True)
class Portrait:
    """A person's appearance model, and a picture of hers.

    model
        Of the person.
    picture
        (height, width, 3) that faces are painted onto.
    pose
        (4,) where her head is in it.
    frame_rate
        Frames a second of her parameters.
    """

    model: AppearanceModel
    picture: UInt8[np.ndarray, "h w 3"]
    pose: Float[np.ndarray, " 4"]
    frame_rate: float

    @property
    def names(self) -> list[str]:
        """Name the parameters."""
        return [f"face{number}" for number in range(self.model.basis.shape[1])]

    def film(self, parameters: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t h w 3"]:
        """Paint faces onto the picture.

        Raises
        ------
        InputError
            If there are not as many parameters as the model has.
        """
        if parameters.shape[1] != len(self.names):
            raise InputError(
                "face parameters",
                f"there are {parameters.shape[1]} and the portrait has {len(self.names)}",
                "Give the portrait the fit was trained with",
            )
        return self.model.render(parameters, self.pose, self.picture)

    def write_film(
        self,
        path: str | Path,
        parameters: Float[np.ndarray, "t k"],
        wave: Float[np.ndarray, " n"],
        rate: float | int,
    ) -> Path:
        """Write the faces of parameters as a video with sound.

        Raises
        ------
        InputError
            As `film`, or if the name does not end in ``.mp4``.
        """
        return write_video(path, self.film(parameters), self.frame_rate, wave, rate)

    def save(self, path: str | Path) -> Path:
        """Write it to an ``.npz``; an older file stays until the new one is whole.

        Raises
        ------
        InputError
            If the name has another suffix.
        """
        path = Path(path)
        PORTRAIT.check(path)
        own = {f.name: getattr(self.model, f.name) for f in fields(self.model) if f.name != "mesh"}
        mesh = {f"mesh_{name}": getattr(self.model.mesh, name) for name in MESH}
        rest = {name: getattr(self, name) for name in PICTURE}
        with replacing(path) as temporary:
            np.savez_compressed(temporary, **own, **mesh, **rest)
        return path


def load_portrait(path: str | Path) -> Portrait:
    """Read a portrait back; it paints exactly as before it was saved.

    Raises
    ------
    InputError
        If the file is not there or is no portrait.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path of the portrait")
    kept = read_arrays(path, "a portrait", MEND)
    try:
        mesh = Mesh(**{name: kept.pop(f"mesh_{name}") for name in MESH})
        picture, pose, rate = (kept.pop(name) for name in PICTURE)
        weight, (shape, texture, both) = float(kept.pop("weight")), kept.pop("kept").tolist()
        model = AppearanceModel(mesh=mesh, weight=weight, kept=(shape, texture, both), **kept)
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(path, f"it is no portrait ({error})", MEND) from error
    return Portrait(model, picture, pose, float(rate))
