"""The commands keyposes, fit motion-tensor and recognize on small synthetic motions."""

import json

import numpy as np
import pytest
import xarray as xr

from bayesmotion.files import PROBABILITIES
from bayesmotion.models.keyposes.rule import score
from bayesmotion.motion import positions, read, save, split, write_bvh
from bayesmotion.motion.synthetic.dance import synthetic_dance


@pytest.fixture(scope="module")
def dance(tmp_path_factory):
    made = synthetic_dance(0, beats=10)
    folder = tmp_path_factory.mktemp("dance")
    save(made.motion, folder / "dance.nc")
    (folder / "beats.txt").write_text("\n".join(f"{beat:.4f}" for beat in made.beats))
    return folder, made


def test_keyposes_are_found_written_and_drawn(dance, tmp_path, run):
    folder, made = dance
    files = {end: tmp_path / f"out.{end}" for end in ("json", "png", "bvh")}
    result = run(
        "keyposes", folder / "dance.nc", "--beats", folder / "beats.txt", "--low", 0.33,
        "--json", files["json"], "--plot", files["png"], "--bvh", files["bvh"],
        "--dimensions", 3,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    content = json.loads(files["json"].read_text())
    frames = np.array([row["frame"] for row in content["keyposes"]])
    precision, recall = score(frames, made.keyposes, 6)
    assert precision >= 0.8
    assert recall >= 0.8
    assert f"{len(frames)} keyposes at 10 beats" in result.stdout
    assert files["png"].read_bytes().startswith(b"\x89PNG")
    assert read(files["bvh"]).sizes["frame"] == made.motion.sizes["frame"]


def test_tempo_offset_thresholds_and_weights_matter(dance, tmp_path, run):
    folder, _ = dance

    def found(*options: object) -> list[int]:
        path = tmp_path / "k.json"
        result = run("keyposes", folder / "dance.nc", *options, "--json", path)
        assert result.exit_code == 0, result.output
        return [row["frame"] for row in json.loads(path.read_text())["keyposes"]]

    # The dance has a beat every 0.6 s, the first after 0.3 s.
    plain = found("--beats", folder / "beats.txt")
    assert found("--tempo", 100, "--offset", 0.3) == plain
    assert len(found("--tempo", 100, "--offset", 0.3, "--low", -1, "--deep", 99)) == 0
    masses = found("--tempo", 100, "--offset", 0.3, "--weights", "masses", "--low", 0.1)
    assert masses != found("--tempo", 100, "--offset", 0.3, "--low", 0.1)


def test_a_table_says_which_joints_are_which(dance, tmp_path, run, refused):
    folder, _ = dance
    command = ("keyposes", folder / "dance.nc", "--tempo", 100, "--weights", "masses")
    table, energy = tmp_path / "joints.csv", []
    for joint in ("lowerneck", "thorax"):
        table.write_text(f"role,joint\nneck,{joint}\n")
        result = run(*command, "--joints", table)
        assert result.exit_code == 0, result.output
        energy.append(result.stdout)
    assert energy[0] == run(*command).stdout
    assert energy[0] != energy[1]
    table.write_text("role,joint\nneck,Nobody\n")
    assert "has no joint Nobody" in refused(run(*command, "--joints", table))


def test_bad_sources_of_beats_are_told(dance, run, refused):
    folder, _ = dance
    clip = folder / "dance.nc"
    assert "not one source" in refused(run("keyposes", clip))
    assert "not one source" in refused(
        run("keyposes", clip, "--tempo", 90, "--beats", folder / "beats.txt")
    )
    assert "no such weights" in refused(run("keyposes", clip, "--tempo", 90, "--weights", "x"))
    assert "without the other" in refused(run("keyposes", clip, "--tempo", 90, "--dimensions", 2))
    assert "no such file" in refused(run("keyposes", clip, "--music", folder / "song.mp3"))


@pytest.fixture(scope="module")
def clips(acted, tmp_path_factory):
    """Three repetitions of every cell; the last one is for recognising."""
    folder = tmp_path_factory.mktemp("clips")
    rows = ["clip,subject,task"]
    for clip, part in split(acted(("ann", "ben", "cat"), ("wave", "bow"), 3)).items():
        write_bvh(part, folder / f"{clip}.bvh")
        if not clip.endswith("2"):
            rows.append(f"{clip},{','.join(clip.split('-')[:2])}")
    (folder / "labels.csv").write_text("\n".join(rows))
    return folder


@pytest.fixture(scope="module")
def tensor(clips, run):
    files = sorted(clips.glob("*-[01].bvh"))
    out = clips / "tensor.nc"
    result = run(
        "fit", "motion-tensor", *files, "--labels", clips / "labels.csv",
        "--modes", "subject,task", "--segmenting", "segmenting:coefficients=4", "--out", out,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    return out


def test_new_repetitions_are_recognised(clips, tensor, tmp_path, run):
    probes = sorted(clips.glob("*-2.bvh"))
    out = tmp_path / "p.nc"
    result = run("recognize", tensor, *probes, "--json", tmp_path / "r.json", "--out", out)
    assert result.exit_code == 0, result.output
    assert xr.load_dataset(out)["p_task"].sum("task").values == pytest.approx(1.0)
    PROBABILITIES.check(out)
    told = json.loads((tmp_path / "r.json").read_text())["clips"]
    assert len(told) == len(probes) == 6
    for name, one in told.items():
        person, task, _ = name.split("-")
        assert one["subject"]["named"] == person
        assert one["task"]["named"] == task
        assert one["task"]["p"] + one["task"]["p_new"] <= 1.0 + 1e-9


def test_a_cell_is_made_and_other_commands_refuse_the_fit(tensor, tmp_path, run, refused):
    bvh = tmp_path / "cell.bvh"
    words = ["--subject", "ann", "--label", "task=bow", "--bvh", bvh]
    assert run("synthesize", tensor, *words).exit_code == 0
    assert read(bvh).sizes["frame"] == 36
    assert run("synthesize", tensor, *words, "--seconds", 2).exit_code == 0
    assert read(bvh).sizes["frame"] == 60
    assert "does not know it" in refused(run("synthesize", tensor, "--subject", "x", "--bvh", bvh))
    assert "does not predict the frames" in refused(run("forecast", tensor, bvh))


def test_bad_settings_of_the_tensor_are_told(clips, tmp_path, run, refused):
    files = [*sorted(clips.glob("*-[01].bvh")), "--labels", clips / "labels.csv"]
    command = ["fit", "motion-tensor", *files, "--out", tmp_path / "x.nc"]
    for setting in ("channels", "body", "pace"):
        line = refused(run(*command, "--segmenting", f"segmenting:{setting}=x"))
        assert f"{setting} x: there is no such" in line
    assert "two modes or more" in refused(run(*command, "--modes", "subject"))
    assert run(*command, "--dynamics", "gp").exit_code == 2


def test_a_motion_of_few_dimensions_is_the_clip_seen_through_its_keyposes(dance, tmp_path, run):
    folder, made = dance
    low = tmp_path / "low.bvh"
    result = run("keyposes", folder / "dance.nc", "--tempo", 100, "--offset", 0.3,
                 "--bvh", low, "--dimensions", 2)  # fmt: skip
    assert result.exit_code == 0, result.output
    seen, true = positions(read(low)), positions(made.motion)
    joints = [name for name in true["joint"].values.tolist() if name in seen["joint"].values]
    assert len(joints) > 15
    gap = np.abs(seen.sel(joint=joints).values - true.sel(joint=joints).values).max()
    assert 1e-3 < gap < 2.0
