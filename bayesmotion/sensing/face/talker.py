"""A synthetic talker: what she says and how her mouth moves, with the truth known.

Phones follow each other at random. Each has targets for what is seen (the jaw's opening,
the lips' rounding and closure) and for what is only heard (tongue, voice, hiss), and each
articulator follows the targets by dominance (Cohen and Massaro 1993),

    a(t) = sum_i D_i(t) T_i / sum_i D_i(t),   D_i(t) = A_i exp(-|t - t_i| / tau)

so that a phone's mouth depends on its neighbours: coarticulation. The sound follows from the
articulators alone: harmonics of a voice and noise, shaped by resonances (Fant 1960),

    F1 = 250 + 550 jaw,   F2 = (900 + 1400 tongue)(1 - 0.3 rounding),   F3 = 2900 - 500 rounding

in Hz. Lips damp the voice as they close, so all that moves the face is heard.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from ...errors import InputError
from .talker_face import draw_face, face_landmarks, skin_of

RATE = 16000  # samples of sound a second
CONTROL = 200  # articulator values a second, from which all others are interpolated
ARTICULATORS = ("jaw", "rounding", "closure", "tongue", "voice", "hiss")
SEEN = 3  # the first ones move the face
# Targets between 0 and 1, in the order above, then seconds.
PHONES = {
    "sil": (0.05, 0.2, 0.3, 0.5, 0.0, 0.0, 0.20),
    "a": (1.00, 0.1, 0.0, 0.3, 1.0, 0.0, 0.16),
    "e": (0.55, 0.1, 0.0, 0.8, 1.0, 0.0, 0.14),
    "i": (0.20, 0.0, 0.0, 1.0, 1.0, 0.0, 0.14),
    "o": (0.60, 0.8, 0.0, 0.2, 1.0, 0.0, 0.15),
    "u": (0.25, 1.0, 0.1, 0.0, 1.0, 0.0, 0.15),
    "m": (0.15, 0.3, 1.0, 0.3, 0.6, 0.0, 0.10),
    "b": (0.15, 0.2, 1.0, 0.3, 0.1, 0.0, 0.09),
    "f": (0.20, 0.2, 0.6, 0.5, 0.0, 0.5, 0.11),
    "s": (0.10, 0.1, 0.0, 0.9, 0.0, 1.0, 0.12),
    "sh": (0.15, 0.7, 0.0, 0.7, 0.0, 1.0, 0.12),
}
VOWELS = ("a", "e", "i", "o", "u")
# Seconds over which dominance falls to 1/e, and how strongly a closed mouth is held.
TAU = (0.060, 0.070, 0.030, 0.050, 0.020, 0.020)
HELD = 4.0


@dataclass(frozen=True)
class Utterance:
    """A sentence of the synthetic talker.

    wave
        (n,) sound at `RATE` samples a second.
    frames
        (T, size, size, 3) pictures, 0 to 255.
    landmarks
        (T, L, 2) x, y in pixels, exact.
    articulators
        (T, 6) at the middle of every frame; columns as `ARTICULATORS`.
    phones
        What is said, with the times in seconds of the phones' middles.
    frame_rate
        Pictures a second.
    """

    wave: Float[np.ndarray, " n"]
    frames: UInt8[np.ndarray, "t h w 3"]
    landmarks: Float[np.ndarray, "t l 2"]
    articulators: Float[np.ndarray, "t 6"]
    phones: tuple[tuple[str, float], ...]
    frame_rate: float


def synthetic_talker(
    seed: int,
    *,
    utterances: int = 8,
    seconds: float = 3.0,
    frame_rate: float = 25.0,
    size: int = 96,
    sway: float = 1.5,
    noise: float = 2.0,
) -> list[Utterance]:
    """Make sentences of a talker: sound, pictures, landmarks and articulators.

    Parameters
    ----------
    seed
        Of what is said, the skin, the head's sway and the noise.
    utterances
        How many.
    seconds
        Length of each.
    frame_rate
        Pictures a second.
    size
        Height and width of the pictures in pixels.
    sway
        Standard deviation in pixels of where the head is.
    noise
        Standard deviation in grey levels of the camera's noise.

    Raises
    ------
    InputError
        If a number is out of its range.
    """
    if utterances < 1 or seconds < 1.0 or not 1 <= frame_rate <= CONTROL or size < 48:
        raise InputError(
            "synthetic talker",
            f"{utterances} utterances of {seconds} s, {frame_rate} frames a second, size {size}",
            "Ask for one or more of at least 1 s, 1 to 200 frames a second, 48 pixels or more",
        )
    if sway < 0 or noise < 0:
        raise InputError("synthetic talker", "sway or noise is negative", "Give zero or more")
    streams = np.random.default_rng(seed).spawn(utterances + 1)
    skin = skin_of(streams[0])
    return [_utter(one, seconds, frame_rate, size, sway, noise, skin) for one in streams[1:]]


def _utter(
    random: np.random.Generator,
    seconds: float,
    frame_rate: float,
    size: int,
    sway: float,
    noise: float,
    skin: np.ndarray,
) -> Utterance:
    """Make one sentence."""
    phones = _sentence(random, seconds)
    control = (np.arange(int(seconds * CONTROL) + 1)) / CONTROL
    moving = articulate(phones, control)
    wave = sound_of(random, moving, seconds)
    middle = (np.arange(int(seconds * frame_rate)) + 0.5) / frame_rate
    seen = np.stack([np.interp(middle, control, column) for column in moving.T], axis=1)
    poses = _sway(random, len(middle), frame_rate, sway, size)
    landmarks = face_landmarks(seen[:, :SEEN], poses)
    frames = [
        draw_face(one, pose, size, skin) for one, pose in zip(seen[:, :SEEN], poses, strict=True)
    ]
    noisy = np.stack(frames) + noise * random.normal(size=(len(frames), size, size, 3))
    pictures = np.clip(np.round(noisy), 0, 255).astype(np.uint8)
    return Utterance(wave, pictures, landmarks, seen, phones, frame_rate)


def _sentence(random: np.random.Generator, seconds: float) -> tuple[tuple[str, float], ...]:
    """Say syllables of a consonant and a vowel between silences."""
    said, begin = [("sil", PHONES["sil"][-1] / 2)], PHONES["sil"][-1]
    consonants = [name for name in PHONES if name not in (*VOWELS, "sil")]
    end = seconds - PHONES["sil"][-1]
    while True:
        names = [str(random.choice(consonants)), str(random.choice(VOWELS))]
        if random.random() < 0.15:
            names.append("sil")
        lengths = [PHONES[name][-1] * random.uniform(0.8, 1.25) for name in names]
        if begin + sum(lengths) > end:
            return (*said, ("sil", (begin + seconds) / 2), ("sil", seconds))
        for name, length in zip(names, lengths, strict=True):
            said.append((name, begin + length / 2))
            begin += length


def articulate(
    phones: tuple[tuple[str, float], ...], times: Float[np.ndarray, " t"]
) -> Float[np.ndarray, "t 6"]:
    """Give the articulators at times in seconds."""
    targets = np.array([PHONES[name][:-1] for name, _ in phones])
    far = np.abs(times[:, None] - np.array([time for _, time in phones]))
    closed = np.where(targets[:, 2] > 0.5, HELD, 1.0)
    columns = []
    for index, tau in enumerate(TAU):
        dominance = np.exp(-far / tau) * (closed if index == 2 else 1.0)
        columns.append(dominance @ targets[:, index] / dominance.sum(axis=1))
    return np.stack(columns, axis=1)


def sound_of(
    random: np.random.Generator, moving: Float[np.ndarray, "t 6"], seconds: float
) -> Float[np.ndarray, " n"]:
    """Give the sound of articulators, which come `CONTROL` times a second."""
    count = int(seconds * RATE)
    time, control = np.arange(count) / RATE, np.arange(len(moving)) / CONTROL
    pitch = 115.0 * (1.0 - 0.06 * control) * (1.0 + 0.01 * np.sin(2 * np.pi * 5.0 * control))
    harmonics = np.arange(1, 56)
    strength = _resonance(moving, harmonics * pitch[:, None]) / harmonics
    voice, closure = moving[:, 4], moving[:, 2]
    strength *= (voice * (1.0 - 0.85 * closure) * (0.4 + 0.6 * moving[:, 0]))[:, None]
    angle = 2 * np.pi * np.cumsum(np.interp(time, control, pitch)) / RATE
    wave = np.zeros(count)
    for k, column in zip(harmonics, strength.T, strict=True):
        wave += np.interp(time, control, column) * np.sin(k * angle)
    wave += _hiss(random, moving, count)
    return 0.5 * wave / np.abs(wave).max() + 1e-4 * random.normal(size=count)


def _resonance(moving: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Give how strongly the mouth lets frequencies through."""
    jaw, rounding, _, tongue = moving[:, :4].T
    formants = (
        250.0 + 550.0 * jaw,
        (900.0 + 1400.0 * tongue) * (1.0 - 0.3 * rounding),
        2900.0 - 500.0 * rounding,
        np.full_like(jaw, 3700.0),
    )
    out = np.ones_like(frequency)
    for number, formant in enumerate(formants):
        ratio = frequency / formant[:, None]
        width = (60.0 + 30.0 * number) / formant[:, None]
        out /= np.sqrt((1.0 - ratio**2) ** 2 + (width * ratio) ** 2)
    return out


def _hiss(random: np.random.Generator, moving: np.ndarray, count: int) -> np.ndarray:
    """Give the noise of fricatives: a band that lies higher as the lips are spread."""
    size = 2 * RATE // CONTROL
    frequency = np.fft.rfftfreq(size, 1.0 / RATE)
    centre = 2000.0 + 4000.0 * moving[:, 3] - 2500.0 * moving[:, 1] - 1500.0 * moving[:, 2]
    shape = np.exp(-(((frequency - centre[:, None]) / 1200.0) ** 2)) * moving[:, 5, None]
    window = np.hanning(size + 1)[:-1]
    out = np.zeros(count + 2 * size)
    for k, band in enumerate(shape):
        piece = np.fft.irfft(np.fft.rfft(random.normal(size=size)) * band, n=size)
        begin = k * RATE // CONTROL
        out[begin : begin + size] += window * piece
    return 2.0 * out[size // 2 : size // 2 + count]


def _sway(
    random: np.random.Generator, count: int, frame_rate: float, sway: float, size: int
) -> Float[np.ndarray, "t 4"]:
    """Give the head's poses in the picture: slow waves of place, turn and size."""
    time = np.arange(count) / frame_rate
    speed = random.uniform(0.15, 0.5, size=(4, 3))
    phase = random.uniform(0.0, 2 * np.pi, size=(4, 3))
    waves = np.sin(2 * np.pi * speed * time[:, None, None] + phase).sum(axis=-1)
    waves *= np.sqrt(2.0 / 3.0)  # a standard deviation of one
    scale = size / 128.0 * (1.0 + 0.01 * sway * waves[:, 0])
    turn = 0.015 * sway * waves[:, 1]
    middle = np.array([size / 2.0, 0.47 * size]) + sway * waves[:, 2:]
    return np.stack([scale * np.cos(turn), scale * np.sin(turn), *middle.T], axis=1)
