"""Videos: their pictures and times read, and pictures written with their sound."""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped, UInt8

from ...errors import InputError
from ...extras import required
from ...files import VIDEO, replacing

CRF = 18  # constant rate factor of H.264: hardly to be told from the original


@dataclass(frozen=True)
class Video:
    """The pictures of a video.

    frames
        (T, height, width, 3) red, green and blue, 0 to 255.
    times
        (T,) seconds since the first picture.
    frame_rate
        Pictures a second.
    """

    frames: UInt8[np.ndarray, "t h w 3"]
    times: Float[np.ndarray, " t"]
    frame_rate: float


def read_video(path: str | Path) -> Video:
    """Read all pictures of a video; `bayesmotion.sensing.audio.cepstra.read_audio` reads its sound.

    Raises
    ------
    InputError
        If there is no such file, it cannot be read, it has no pictures, or pictures do not
        follow each other evenly (models need an even frame rate).
    """
    av, FFmpegError = required("av", "sound"), required("av.error", "sound").FFmpegError

    path = Path(path)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path of the video")
    frames, times = [], []
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise InputError(path, "there are no pictures in it", "Give a video")
            stream = container.streams.video[0]
            rate = stream.average_rate or stream.guessed_rate
            for frame in container.decode(stream):
                frames.append(frame.to_ndarray(format="rgb24"))
                times.append(frame.time)
    except FFmpegError as error:
        raise InputError(
            path, f"it cannot be read as a video ({error.strerror})", "Give a video file"
        ) from error
    if not frames or rate is None:
        raise InputError(path, "there are no pictures in it", "Give a video that is not empty")
    if any(time is None for time in times):
        raise InputError(path, "its pictures carry no times", "Convert it to mp4")
    seconds = np.array(times, dtype=float) - times[0]
    expected = np.arange(len(seconds)) / float(rate)
    if np.abs(seconds - expected).max() > 0.5 / float(rate):
        raise InputError(
            path,
            f"its pictures do not follow each other evenly at {float(rate):.2f} a second",
            "Convert it to a constant frame rate",
        )
    return Video(np.stack(frames), seconds, float(rate))


def write_video(
    path: str | Path,
    frames: Shaped[np.ndarray, "t h w 3"],
    frame_rate: float | int,
    wave: Float[np.ndarray, " n"] | None = None,
    rate: float | int | None = None,
) -> Path:
    """Write pictures, and sound that begins with the first, as mp4 (H.264 and AAC).

    Parameters
    ----------
    path
        Ends in ``.mp4``; an older file stays until the new one is whole.
    frames
        Red, green and blue, 0 to 255; odd heights and widths lose their last row or column,
        since the format's colours are stored for blocks of 2 x 2.
    frame_rate
        Pictures a second.
    wave
        One channel of sound, full scale 1.
    rate
        Samples a second of the sound.

    Raises
    ------
    InputError
        If there are no pictures, they are no numbers, the name is no mp4, or sound comes
        without a rate.
    """
    path = Path(path)
    VIDEO.check(path)
    if len(frames) == 0 or min(frames.shape[1:3]) < 2 or not np.isfinite(frames).all():
        raise InputError(path, "there are no pictures to write", "Give at least one whole picture")
    if (wave is None) != (rate is None):
        raise InputError(path, "sound needs its samples and their rate", "Give both or none")
    height, width = frames.shape[1] // 2 * 2, frames.shape[2] // 2 * 2
    pictures = np.clip(np.round(frames[:, :height, :width]), 0, 255).astype(np.uint8)
    with replacing(path) as temporary:
        _encode(temporary, pictures, frame_rate, wave, rate)
    return path


def _encode(
    path: Path,
    pictures: np.ndarray,
    frame_rate: float | int,
    wave: np.ndarray | None,
    rate: float | int | None,
) -> None:
    """Write both streams into one file."""
    av = required("av", "sound")

    with av.open(str(path), "w") as container:
        container.metadata["comment"] = "bayesmotion"  # by which `files.VIDEO` knows it again
        shown = container.add_stream(
            "libx264", rate=Fraction(frame_rate).limit_denominator(1001), options={"crf": str(CRF)}
        )
        shown.height, shown.width, shown.pix_fmt = *pictures.shape[1:3], "yuv420p"
        heard = None
        if wave is not None and rate is not None:
            heard = container.add_stream("aac", rate=int(rate), layout="mono")
        for k, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts = k
            container.mux(shown.encode(frame))
        container.mux(shown.encode())
        if heard is not None and wave is not None and rate is not None:
            samples = np.clip(wave, -1.0, 1.0).astype(np.float32)[None]
            sound = av.AudioFrame.from_ndarray(samples, format="fltp", layout="mono")
            sound.sample_rate, sound.pts = int(rate), 0
            container.mux(heard.encode(sound))
            container.mux(heard.encode())
