"""What is measured is measured, once, and told as the file has it."""

import json

import pytest
from typer.testing import CliRunner

from bayesmotion.benchmarks import bench as bench_module
from bayesmotion.benchmarks.report import markdown
from bayesmotion.cli import app


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(bench_module, "DENSE", {"A": (30, 3)})
    monkeypatch.setattr(bench_module, "STARTS", {"nothing": ("-c", "pass")})
    # What it takes to compile is that of a test of its own.
    monkeypatch.setattr(bench_module, "FOLLOWED", {})


def test_a_bench_is_measured_once_and_told(small, tmp_path):
    out, said = tmp_path / "bench.json", []
    found = bench_module.bench(out, repeats=2, say=said.append)
    one = found["value_and_grad"]["A"]
    assert one["floor"] > 0.0
    assert one["bayesmotion"] > 0.0
    assert 0.0 < found["startup"]["nothing"] < 60.0
    assert json.loads(out.read_text()) == found
    assert f"| A: 30 x 3 | {one['ratio']:.2f} |" in markdown(found)
    again = bench_module.bench(out, repeats=2, say=said.append)
    assert again == found
    assert len(said) == 3


def test_an_unknown_part_is_refused(tmp_path):
    words = ["bench", "--out", str(tmp_path / "b.json"), "--part", "nothing"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert not (tmp_path / "b.json").exists()
