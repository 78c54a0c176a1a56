"""The gallery: its blocks run one after the other, and what they save are its pictures."""

import re
import shutil
import warnings
from pathlib import Path

import pytest

import bayesmotion as bm

PAGE = Path(__file__).parent.parent / "docs" / "gallery.md"
# Without pictures to be kept searches are short.
FEWER = {"max_steps=300": "max_steps=20", "sweeps=40": "sweeps=4", "draws=60": "draws=6",
         "warmup=200, draws=200, chains=4": "warmup=10, draws=20, chains=2",
         "initial=2": "initial=1"}  # fmt: skip


def blocks():
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.slow
def test_the_gallery_makes_its_pictures(tmp_path, monkeypatch, request):
    """With `--screenshots FOLDER` they are kept there, made with the page's own settings."""
    folder = request.config.getoption("--screenshots")
    folder = folder and folder.resolve()
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "gallery"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bm.MotionWarning)
        for block in blocks():
            code = block
            for usual, few in FEWER.items() if folder is None else ():
                code = code.replace(usual, few)
            exec(compile(code, "gallery", "exec"), names)
    made = {path.name for path in tmp_path.iterdir()}
    for path in tmp_path.iterdir():
        assert path.read_text(encoding="utf-8").startswith("<?xml")
        if folder is not None:
            shutil.copy(path, folder)
    assert made == set(re.findall(r"images/(gallery-[a-z]+\.svg)", PAGE.read_text("utf-8")))


def test_the_pictures_of_the_gallery_are_there_and_light():
    for picture in re.findall(r"\((images/[^)]+)\)", PAGE.read_text(encoding="utf-8")):
        assert 2e3 < (PAGE.parent / picture).stat().st_size < 4e5, picture
