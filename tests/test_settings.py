"""Settings survive the way through plain values."""

import json
from dataclasses import dataclass

import pytest

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
