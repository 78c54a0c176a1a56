"""Settings survive the way through plain values."""

import json
from dataclasses import dataclass

import pytest

import bayesmotion as bm
from bayesmotion.registry import build_model, describe_model
from bayesmotion.settings import plain, restored_class


@dataclass(frozen=True)
class Ring:
    """A ring."""


@dataclass(frozen=True)
class Path:
    """A path."""

    size: int = 3


@dataclass(frozen=True)
class Part:
    """A part."""

    name: str
    shape: Ring | Path = Ring()


@dataclass(frozen=True)
class Whole:
    """The whole."""

    parts: tuple[Part, ...] = ()
    shape: Ring | Path | None = None
    sizes: tuple[float, ...] | None = None


@pytest.mark.parametrize(
    "whole",
    [
        Whole(),
        Whole((Part("a"), Part("b", Path(2))), Path(), (0.5, 1.0)),
        Whole(shape=Ring(), sizes=()),
    ],
)
def test_settings_come_back_as_they_were(whole):
    through = json.loads(json.dumps(plain(whole)))
    assert through.pop("type") == "Whole"
    assert restored_class(Whole, through) == whole


@pytest.mark.parametrize("wrong", [{"colour": 1}, {"shape": {"type": "Cube"}}])
def test_what_is_no_setting_is_refused(wrong):
    with pytest.raises((KeyError, TypeError)):
        restored_class(Whole, wrong)


def test_fits_saved_before_a_setting_was_there_load_as_they_were():
    model = bm.Multifactor()
    assert model.lengths == "body"
    described = describe_model(model)
    assert described["lengths"] == "body"
    del described["lengths"]
    before = build_model(described, "a file")
    assert before.lengths == "file"
    assert describe_model(before) == described
