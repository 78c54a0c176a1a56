"""From videos to a portrait, to a fit, to a talking face, on the command line."""

import pytest

from bayesmotion.sensing.audio.cepstra import read_audio
from bayesmotion.sensing.face.landmarks import write_landmarks
from bayesmotion.sensing.face.talker import RATE, synthetic_talker
from bayesmotion.sensing.face.video import read_video, write_video


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three videos of the synthetic talker; of two there are landmarks."""
    path = tmp_path_factory.mktemp("talk")
    for number, one in enumerate(synthetic_talker(6, utterances=3, seconds=1.6, size=64)):
        write_video(path / f"clip{number}.mp4", one.frames, 25.0, one.wave, RATE)
        write_landmarks(path / f"clip{number}.landmarks.csv", one.landmarks)
    return path


@pytest.fixture(scope="module")
def portrait(folder, run):
    out = folder / "her.npz"
    result = run("portrait", folder / "clip0.mp4", folder / "clip1.mp4", "--out", out)
    assert result.exit_code == 0, result.output
    assert "keep 9" in result.output
    return out


@pytest.mark.thorough
@pytest.mark.slow
def test_a_face_is_made_of_the_sound_of_a_video(folder, portrait, run):
    videos = [folder / "clip0.mp4", folder / "clip1.mp4"]
    fit, film = folder / "fit.nc", folder / "film.mp4"
    fitted = run("fit", "voice-puppetry", *videos, "--out", fit, "--max-steps", 5)
    assert fitted.exit_code == 0, fitted.output
    spoken = run("speak", fit, folder / "clip2.mp4", "--out", film, "--portrait", portrait)
    assert spoken.exit_code == 0, spoken.output
    assert read_video(film).frames.shape == (40, 64, 64, 3)
    assert len(read_audio(film)[0]) == pytest.approx(1.6 * RATE, abs=2048)
    lines = (folder / "film.csv").read_text().splitlines()
    assert len(lines) == 41
    assert lines[0].startswith("time,face0,")
    only = run("speak", fit, folder / "clip2.mp4", "--tracks", folder / "only.csv")
    assert only.exit_code == 0
    assert (folder / "only.csv").read_text().splitlines() == lines
    other = folder / "other.npz"
    made = run("portrait", folder / "clip0.mp4", "--out", other, "--keep", 0.5)
    assert made.exit_code == 0
    refused = run("speak", fit, folder / "clip2.mp4", "--out", film, "--portrait", other)
    assert refused.exit_code == 2
    assert "not its parameters" in refused.output


def test_what_cannot_be_spoken_is_told(folder, portrait, run):
    for words, message in (
        ((), "nothing to write"),
        (("--out", folder / "x.mp4"), "needs a face"),
        (("--tracks", folder / "x.csv", "--start", "C"), "no such start"),
        (("--out", folder / "x.mp4", "--portrait", folder / "none.npz"), "no such file"),
    ):
        result = run("speak", folder / "fit.nc", folder / "clip2.mp4", *words)
        assert result.exit_code == 2
        assert message in result.output


def test_a_table_that_is_not_ours_is_not_written_over(tmp_path, run):
    table = tmp_path / "clip.csv"
    table.write_text("open,wide\n1,2\n", encoding="utf-8")
    refused = run("portrait", tmp_path / "clip.mp4", "--out", tmp_path / "her.npz")
    assert refused.exit_code == 2
    assert "holds no table of a face's parameters" in refused.output
    assert table.read_text(encoding="utf-8") == "open,wide\n1,2\n"
