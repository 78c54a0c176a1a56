"""Sound: read from any file, and described by cepstral coefficients frame by frame.

Frame k of a video of F frames a second is shown from k/F to (k+1)/F seconds. Its sound is
what a Hann window w, centred on (k + 1/2)/F, lets through:

    P_k(f) = |sum_n w_n s_n exp(-2 pi i f n / rate)|^2 / (rate sum_n w_n^2)    per Hz
    m_kj   = 10 log10 max(mean of P_k over the j-th mel band, floor)           dB
    c_k    = orthonormal discrete cosine transform of m_k, the first coefficients

(Davis and Mermelstein 1980). Being densities a Hz over a fixed range of frequencies, the
coefficients do not depend on the rate the sound was sampled at; the floor is a constant, so
a frame's coefficients depend on the sound around it alone.
"""

import math
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.fft import dct

from ...errors import InputError, MotionWarning
from ...extras import required

BANDS = 40  # mel bands
HIGHEST = 8000.0  # Hz, end of the last band: all of speech, and in every usual sampling rate
FLOOR = 1e-13  # full scale^2 / Hz: about the rounding noise of 16 bits
FULL = 0.999  # of full scale, from which a sample counts as clipped
CLIPPED = 1e-3  # share of clipped samples that is told
CANCELLED = 1e-3  # share of the louder channel's power below which channels cancel out


def read_audio(path: str | Path) -> tuple[Float[np.ndarray, " n"], int]:
    """Read the sound of a file as one channel.

    Files with pictures are read too: the sound then begins with the first picture, so that
    sample n belongs to the picture shown n / rate seconds after the first.

    Returns
    -------
    The samples (full scale is 1; the mean of the channels), and how many there are a second.

    Raises
    ------
    InputError
        If there is no such file, it cannot be read, or it has no sound or only silence.

    Warns
    -----
    MotionWarning
        If samples are clipped, or the channels cancel each other out and one is taken.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path of the sound")
    channels, rate = _decoded(path)
    if len(channels) == 0:
        raise InputError(path, "there is no sound in it", "Give a recording that is not empty")
    if not np.isfinite(channels).all():
        raise InputError(path, "some of its samples are no numbers", "Export the sound again")
    power = np.mean(channels**2, axis=0)
    if not power.any():
        raise InputError(path, "it is silent from end to end", "Give a recording with sound")
    clipped = np.mean(np.abs(channels) >= FULL)
    if clipped > CLIPPED:
        _warn(path, f"{100 * clipped:.1f} % of its samples are clipped")
    wave = channels.mean(axis=1)
    if np.mean(wave**2) < CANCELLED * power.max():
        _warn(path, "its channels cancel each other out; the louder one is taken")
        wave = channels[:, int(power.argmax())]
    return wave, rate


def mfcc(
    wave: Float[np.ndarray, " n"],
    rate: float | int,
    frame_rate: float | int = 25.0,
    n_coefficients: int = 13,
    deltas: bool = False,
    *,
    window: float | None = None,
) -> Float[np.ndarray, "t c"]:
    """Describe sound by mel-frequency cepstral coefficients at the frames of a video.

    Parameters
    ----------
    wave
        One channel, as `read_audio` gives it; beyond its ends is silence.
    rate
        Samples a second, 16,000 or more.
    frame_rate
        Frames a second of the video.
    n_coefficients
        How many coefficients, the first of which tells loudness; at most 40.
    deltas
        Whether their slopes (a frame; from five frames) follow them, which doubles c.
    window
        Length of the window in seconds; by default twice a frame, so that windows overlap
        by half and every sample counts as much as any other.

    Returns
    -------
    (t, c) coefficients in dB; t is the number of frames begun before the sound ends.

    Raises
    ------
    InputError
        If the sound is empty or no numbers, or a setting is out of its range.
    """
    length = 2.0 / frame_rate if window is None and frame_rate > 0 else window
    _check(wave, rate, frame_rate, n_coefficients, length)
    assert length is not None
    size = round(length * rate)
    # A product such as 1.16 x 25 may come out a hair above the whole number it is.
    total = math.ceil(len(wave) * frame_rate / rate - 1e-9)
    middle = (np.arange(total) + 0.5) * rate / frame_rate
    first = np.round(middle - size / 2).astype(int)
    padded = np.pad(wave, (size, size + math.ceil(rate / frame_rate)))
    shape = _hann(size)
    # Bins closer than 20 Hz, so that the narrowest band, some 70 Hz wide, holds several.
    bins = 2 ** math.ceil(math.log2(max(size, rate / 20.0)))
    bands = _mel_bands(rate, bins)
    power = np.empty((total, len(bands)))
    for k, start in enumerate(first + size):
        spectrum = np.abs(np.fft.rfft(padded[start : start + size] * shape, n=bins)) ** 2
        power[k] = bands @ spectrum
    density = power / (bins * np.sum(shape**2))  # bands are a Hz, bins are rate / bins Hz wide
    level = 10.0 * np.log10(np.maximum(density, FLOOR))
    found = np.asarray(dct(level, type=2, norm="ortho", axis=1))[:, :n_coefficients]
    return np.hstack([found, slopes(found)]) if deltas else found


def slopes(track: Float[np.ndarray, "t d"]) -> Float[np.ndarray, "t d"]:
    """Give the slope a frame of every column: the line through five frames, edges repeated."""
    total = len(track)
    at = np.arange(total)
    out = np.zeros_like(track)
    for step in (1, 2):
        ahead, behind = np.minimum(at + step, total - 1), np.maximum(at - step, 0)
        out += step * (track[ahead] - track[behind])
    return out / 10.0


def _mel_bands(rate: float | int, bins: int) -> Float[np.ndarray, "b f"]:
    """Give the weights of frequencies in mel bands; each band's sum times rate / bins is 1."""
    import librosa

    bands = librosa.filters.mel(
        sr=rate, n_fft=bins, n_mels=BANDS, fmax=HIGHEST, norm=None, dtype=np.float64
    )
    return bands / (bands.sum(axis=1, keepdims=True) * rate / bins)


def _hann(size: int) -> Float[np.ndarray, " n"]:
    """Give a periodic Hann window: copies half a window apart add up to one."""
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(size) + 0.5) / size)


def _check(
    wave: np.ndarray,
    rate: float | int,
    frame_rate: float | int,
    n_coefficients: int,
    window: float | None,
) -> None:
    """Refuse what no coefficients can be computed from."""
    if len(wave) == 0 or not np.isfinite(wave).all():
        raise InputError("sound", "it is empty or some samples are no numbers", "Give its samples")
    if not rate >= 2 * HIGHEST:
        raise InputError(
            f"a rate of {rate} Hz",
            f"speech needs the frequencies up to {HIGHEST:.0f} Hz",
            f"Record at {2 * HIGHEST:.0f} Hz or more",
        )
    if not (0 < frame_rate < rate / 2):
        raise InputError(
            f"{frame_rate} frames a second", "no video has so many", "Give the video's frame rate"
        )
    if not 1 <= n_coefficients <= BANDS:
        raise InputError(
            f"{n_coefficients} coefficients", f"there are 1 to {BANDS}", "Ask for fewer or more"
        )
    if window is None or not 0.01 <= window <= 1.0:
        raise InputError(
            f"a window of {window} s", "it must last 0.01 to 1 s", "Give the window in seconds"
        )


def _decoded(path: Path) -> tuple[Float[np.ndarray, "n c"], int]:
    """Read all channels: plain sound files through libsndfile, all others through FFmpeg."""
    soundfile = required("soundfile", "sound")

    try:
        sound, rate = soundfile.read(path, dtype="float64", always_2d=True)
    except soundfile.LibsndfileError as error:
        return _from_container(path, str(error))
    return sound, int(rate)


def _from_container(path: Path, otherwise: str) -> tuple[Float[np.ndarray, "n c"], int]:
    """Read all channels of a file with pictures, from the first picture on."""
    av, FFmpegError = required("av", "sound"), required("av.error", "sound").FFmpegError

    try:
        with av.open(str(path)) as container:
            if not container.streams.audio:
                raise InputError(path, "there is no sound in it", "Give a file with sound")
            stream = container.streams.audio[0]
            begin = _first_picture(container)
            planes = av.AudioResampler(format="fltp", layout=stream.layout, rate=stream.rate)
            pieces: list[np.ndarray] = []
            start = 0.0
            for frame in container.decode(stream):
                if not pieces:
                    start = float(frame.time or 0.0)
                pieces += [part.to_ndarray() for part in planes.resample(frame)]
            pieces += [part.to_ndarray() for part in planes.resample(None)]
            rate = int(stream.rate)
    except FFmpegError as error:
        raise InputError(
            path,
            f"it cannot be read as sound ({error.strerror or otherwise})",
            "Give a wav, flac, ogg, mp3 or video file",
        ) from error
    if not pieces:
        return np.empty((0, 1)), rate
    sound = np.concatenate(pieces, axis=1).T.astype(float)
    late = 0 if begin is None else round((start - begin) * rate)
    return (np.pad(sound, ((late, 0), (0, 0))) if late >= 0 else sound[-late:]), rate


def _first_picture(container) -> float | None:
    """Give the time of the first picture in seconds; None where there are none."""
    for stream in container.streams.video:
        if stream.start_time is not None and stream.time_base is not None:
            return float(stream.start_time * stream.time_base)
    return None


def _warn(path: Path, what: str) -> None:
    warnings.warn(f"{path}: {what}", MotionWarning, stacklevel=3)
