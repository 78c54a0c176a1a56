"""Options made from settings, and settings from options."""

from dataclasses import dataclass
from typing import Literal

import pytest

from bayesmotion.cli.settings import options_of, parameter_words, parsed, settings_from, written
from bayesmotion.errors import InputError


@dataclass(frozen=True)
class Ring:
    """A ring."""


@dataclass(frozen=True)
class Path:
    """A path.

    Parameters
    ----------
    size
        Dimensions.
    """

    size: int = 3
    noise: float = 0.1


@dataclass(frozen=True)
class Named:
    """Something with a name."""

    name: str
    size: int = 3


@dataclass(frozen=True)
class Model:
    """A model.

    Parameters
    ----------
    content
        What moves.
    factors
        Who moves, and how.
    priors
        Which priors.

    Raises
    ------
    ValueError
        Never.
    """

    content: Ring | Path = Ring()
    factors: tuple[Named, ...] = (Named("subject"), Named("gait"))
    priors: Literal["proper", "paper"] = "proper"
    df: float | None = None
    keep: bool = True


@pytest.mark.parametrize(
    ("given", "setting"),
    [
        ({"content": "path:size=2,noise=0.5"}, {"content": Path(2, 0.5)}),
        ({"content": "ring"}, {"content": Ring()}),
        ({"factors": "subject:size=2;task"}, {"factors": (Named("subject", 2), Named("task"))}),
        ({"factors": "subject,task"}, {"factors": (Named("subject"), Named("task"))}),
        ({"factors": "none"}, {"factors": ()}),
        ({"priors": "paper", "df": None}, {"priors": "paper"}),
        ({"df": 4.0, "keep": False}, {"df": 4.0, "keep": False}),
    ],
)
def test_texts_become_settings(given, setting):
    assert settings_from(Model, given) == setting


def test_what_is_written_is_read_back():
    model = Model(Path(2), (Named("a", 5), Named("b")), "paper", 3.5, keep=False)
    hints = Model.__dataclass_fields__
    for name, field in hints.items():
        value = getattr(model, name)
        assert parsed(field.type, written(value), name) == value


def test_every_setting_has_its_option_with_its_words():
    found = {p.name: p.annotation.__metadata__[0].help for p in options_of(Model)}
    assert list(found) == list(Model.__dataclass_fields__)
    assert found["content"] == "What moves. One of ring, path[:size=,noise=]. By default ring."
    assert found["priors"] == "Which priors. One of proper, paper. By default proper."
    assert parameter_words(Model)["factors"] == "Who moves, and how."


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"content": "loop"}, "'loop' is none. Use ring, path"),
        ({"content": "path:colour=2"}, "'colour=2' is no setting of path"),
        ({"content": "path:size=big"}, "it is no int"),
        ({"priors": "none"}, "Use proper, paper"),
    ],
)
def test_what_no_setting_can_be_is_refused(given, told):
    with pytest.raises(InputError, match=told.replace("[", r"\[")):
        settings_from(Model, given)
