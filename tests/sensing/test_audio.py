"""Reading sound, and its coefficients: aligned with frames, independent of the rate."""

import av
import numpy as np
import pytest
import soundfile

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.sensing.audio.cepstra import mfcc, read_audio, slopes

RATE = 48000


def tone(seconds=1.0, rate=RATE, frequency=300.0, strength=0.3):
    return strength * np.sin(2 * np.pi * frequency * np.arange(int(seconds * rate)) / rate)


def click(at, seconds=1.0, rate=RATE):
    """Silence but for one sample."""
    wave = np.zeros(int(seconds * rate))
    wave[at] = 0.9
    return wave


@pytest.mark.parametrize("rate", [16000, 44100, 48000])
@pytest.mark.parametrize("frame_rate", [25.0, 29.97])
@pytest.mark.parametrize("frame", [0, 7, 23])
def test_a_click_in_frame_k_lands_in_frame_k(rate, frame_rate, frame):
    begin, end = frame * rate / frame_rate, (frame + 1) * rate / frame_rate
    for at in (begin + 2, (begin + end) / 2, end - 2):
        loudness = mfcc(click(round(at), rate=rate), rate, frame_rate)[:, 0]
        assert loudness.argmax() == frame


def test_a_click_on_the_border_counts_the_same_in_both_frames():
    hop = RATE // 25
    loudness = mfcc(click(5 * hop), RATE)[:, 0]
    before = mfcc(click(5 * hop - 1), RATE)[:, 0]
    assert loudness[5] > loudness[4]
    # Mirrored about the border, sample 5 hop is sample 5 hop - 1.
    np.testing.assert_allclose(before[4], loudness[5], rtol=1e-9)
    np.testing.assert_allclose(before[5], loudness[4], rtol=1e-9)


def test_frames_last_as_long_as_the_sound():
    assert len(mfcc(tone(1.0), RATE)) == 25
    assert len(mfcc(tone(1.16), RATE)) == 29
    assert len(mfcc(tone(1.0)[: RATE - 10], RATE)) == 25
    assert len(mfcc(tone(0.001), RATE)) == 1
    assert len(mfcc(tone(0.001), RATE, window=0.01)) == 1
    assert len(mfcc(tone(1.001), RATE, window=0.01)) == 26


def test_coefficients_do_not_depend_on_the_sampling_rate():
    random = np.random.default_rng(0)
    frequencies, phases = random.uniform(100, 7000, 60), random.uniform(0, 6, 60)

    def sound(rate):
        time = np.arange(rate)[:, None] / rate
        return 0.02 * np.sin(2 * np.pi * frequencies * time + phases).sum(axis=1)

    one, other = mfcc(sound(16000), 16000), mfcc(sound(48000), 48000)
    spread = np.abs(one - one.mean(axis=0)).max()
    # Edges differ: half a window of silence against a sharp start.
    np.testing.assert_allclose(one[1:-1], other[1:-1], atol=0.1 * max(spread, 20.0))


def test_twice_the_amplitude_moves_only_the_loudness_by_six_decibels():
    random = np.random.default_rng(1)
    noise = 0.1 * random.normal(size=RATE)
    change = mfcc(2 * noise, RATE) - mfcc(noise, RATE)
    np.testing.assert_allclose(change[:, 0], 20 * np.log10(2) * np.sqrt(40), rtol=1e-6)
    np.testing.assert_allclose(change[:, 1:], 0.0, atol=1e-8)


def test_a_frame_depends_on_the_sound_around_it_alone():
    wave = tone(2.0)
    louder = wave.copy()
    louder[RATE:] *= 3.0
    same = np.isclose(mfcc(wave, RATE), mfcc(louder, RATE)).all(axis=1)
    assert same[:24].all()
    assert not same[25:].any()


def test_silence_has_coefficients_too():
    found = mfcc(np.zeros(RATE), RATE)
    assert np.isfinite(found).all()
    assert np.ptp(found, axis=0).max() == 0


def test_vowels_differ_more_than_moments_of_one():
    low, high = tone(frequency=300.0), tone(frequency=2500.0)
    within = np.abs(np.diff(mfcc(low, RATE)[1:-1], axis=0)).max()
    between = np.abs(mfcc(low, RATE)[1:-1] - mfcc(high, RATE)[1:-1]).max()
    assert between > 20 * within


def test_deltas_are_the_slopes():
    random = np.random.default_rng(2)
    wave = random.normal(size=RATE) * np.linspace(0, 0.2, RATE)
    found = mfcc(wave, RATE, deltas=True)
    assert found.shape == (25, 26)
    np.testing.assert_allclose(found[:, 13:], slopes(found[:, :13]))
    ramp = np.arange(10.0)[:, None] * [1.0, -3.0]
    np.testing.assert_allclose(slopes(ramp)[2:-2], np.tile([1.0, -3.0], (6, 1)))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"rate": 8000}, "frequencies up to"),
        ({"frame_rate": 0.0}, "no video has"),
        ({"n_coefficients": 41}, "1 to 40"),
        ({"window": 3.0}, "0.01 to 1"),
        ({"wave": np.empty(0)}, "empty"),
        ({"wave": np.array([0.1, np.nan])}, "no numbers"),
    ],
)
def test_settings_out_of_range_are_told(changed, message):
    with pytest.raises(InputError, match=message):
        mfcc(**{"wave": tone(), "rate": RATE, **changed})


def test_the_window_changes_the_coefficients():
    random = np.random.default_rng(3)
    wave = random.normal(size=RATE) * 0.1
    assert np.abs(mfcc(wave, RATE) - mfcc(wave, RATE, window=0.025)).max() > 0.1


def test_channels_are_averaged(tmp_path):
    path = tmp_path / "stereo.wav"
    left, right = tone(), tone(frequency=700.0)
    soundfile.write(path, np.stack([left, right], axis=1), RATE, subtype="FLOAT")
    wave, rate = read_audio(path)
    assert rate == RATE
    np.testing.assert_allclose(wave, (left + right) / 2, atol=1e-6)


def test_channels_that_cancel_out_are_not_averaged(tmp_path):
    path = tmp_path / "phase.wav"
    soundfile.write(path, np.stack([tone(), -tone()], axis=1), RATE)
    with pytest.warns(MotionWarning, match="cancel"):
        wave, _ = read_audio(path)
    assert np.abs(wave).max() > 0.2


def test_clipping_is_told(tmp_path):
    path = tmp_path / "clipped.wav"
    soundfile.write(path, np.clip(tone(strength=2.0), -1, 1), RATE)
    with pytest.warns(MotionWarning, match="clipped"):
        read_audio(path)


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.zeros(RATE), "silent"),
        (np.empty(0), "no sound"),
        (np.array([0.1, np.nan, 0.2]), "no numbers"),
    ],
)
def test_files_without_sound_are_told(tmp_path, samples, message):
    path = tmp_path / "bad.wav"
    soundfile.write(path, samples, RATE, subtype="FLOAT")
    with pytest.raises(InputError, match=message):
        read_audio(path)


def test_missing_and_corrupt_files_are_told(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_audio(tmp_path / "none.wav")
    path = tmp_path / "bad.wav"
    path.write_bytes(b"RIFF no sound at all")
    with pytest.raises(InputError, match="cannot be read as sound"):
        read_audio(path)


@pytest.mark.parametrize("late", [0, 1500, -700])
def test_sound_of_a_container_begins_with_the_first_picture(tmp_path, late):
    """A click keeps its time against the pictures where the sound starts late or early."""
    path = tmp_path / "clip.mkv"
    wave = click(9000, seconds=0.5)
    with av.open(str(path), "w") as container:
        pictures = container.add_stream("mpeg4", rate=25)
        pictures.width, pictures.height, pictures.pix_fmt = 32, 32, "yuv420p"
        sound = container.add_stream("pcm_s16le", rate=RATE, layout="mono")
        for k in range(12):
            frame = av.VideoFrame.from_ndarray(np.zeros((32, 32, 3), np.uint8), format="rgb24")
            frame.pts = k + 1  # from 40 ms on, so that sound can start before
            container.mux(pictures.encode(frame))
        container.mux(pictures.encode())
        samples = np.round(wave * 32767).astype(np.int16)[None]
        piece = av.AudioFrame.from_ndarray(samples, format="s16", layout="mono")
        piece.sample_rate, piece.pts = RATE, RATE // 25 + late
        container.mux(sound.encode(piece))
        container.mux(sound.encode())
    found, rate = read_audio(path)
    assert rate == RATE
    # The container keeps times in milliseconds.
    assert abs(np.abs(found).argmax() - (9000 + late)) <= RATE // 1000


def test_a_video_without_sound_is_told(tmp_path):
    path = tmp_path / "mute.mp4"
    with av.open(str(path), "w") as container:
        pictures = container.add_stream("mpeg4", rate=25)
        pictures.width, pictures.height, pictures.pix_fmt = 32, 32, "yuv420p"
        frame = av.VideoFrame.from_ndarray(np.zeros((32, 32, 3), np.uint8), format="rgb24")
        container.mux(pictures.encode(frame))
        container.mux(pictures.encode())
    with pytest.raises(InputError, match="no sound"):
        read_audio(path)


@pytest.mark.real_data
def test_a_grid_clip_has_as_many_frames_of_sound_as_pictures(data_root):
    wave, rate = read_audio(data_root / "grid" / "bbaf2n.mpg")
    assert rate == 44100
    assert mfcc(wave, rate).shape == (75, 13)
