"""The application, and the one place where errors become messages and exit codes."""

import traceback
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

from .. import __version__, console
from ..errors import InputError, NumericalError
from .fit_models import ModelCommands
from .interrupting import INTERRUPTED, ended_when_interrupted, tell_interrupted

FrameRate = Annotated[
    float | None,
    typer.Option(help="Frames a second of the recordings, where they do not say or are wrong."),
]
Body = Annotated[Path | None, typer.Option("--skeleton", help="The .asf file of .amc recordings.")]
Joints = Annotated[
    Path | None,
    typer.Option(help="A csv table role,joint of joints whose names do not tell what they are."),
]
BAD_INPUT, OURS = 2, 70
HELP = {"help_option_names": ["-h", "--help"]}


class _Group(TyperGroup):
    """Commands whose errors are told in one line, without a traceback."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; exit with 2 for bad input, 130 when interrupted, 70 for a fault of ours.

        No other exit code means the last: 1 is that of commands that found something.
        """
        try:
            with console.told_warnings(), ended_when_interrupted():
                return super().invoke(ctx)
        except (InputError, NumericalError) as reason:
            console.error(reason)
            raise typer.Exit(BAD_INPUT) from reason
        except OSError as reason:
            place = f"{reason.filename}: " if reason.filename else ""
            console.error(f"{place}{reason.strerror or reason}. Check the path and the disk.")
            raise typer.Exit(BAD_INPUT) from reason
        except KeyboardInterrupt as reason:
            tell_interrupted()
            raise typer.Exit(INTERRUPTED) from reason
        except MemoryError as reason:
            console.error("there is not enough memory. Give fewer frames, draws or clips.")
            raise typer.Exit(BAD_INPUT) from reason
        except (typer.Exit, typer.Abort, TyperException):
            raise
        except Exception as reason:  # the one place for what nobody thought of
            traceback.print_exception(reason)
            console.error(
                f"{type(reason).__name__}: this is a fault of bayesmotion, not of what it was "
                "given; files that were there are as they were. Please report it to its authors, "
                f"with the command, the lines above and the version, {__version__}."
            )
            raise typer.Exit(OURS) from reason


app = typer.Typer(
    name=console.NAME,
    cls=_Group,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings=HELP,
)


def _version(wanted: bool) -> bool:
    if wanted:
        console.say(f"{console.NAME} {__version__}")
        raise typer.Exit
    return wanted


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Tell the version."),
    ] = False,
) -> None:
    """Bayesian models of human motion: fit, forecast, synthesise.

    Start with: bayesmotion demo
    """


# The commands ``fit MODEL`` are made from the models' settings.
fits = typer.Typer(
    name="fit",
    cls=ModelCommands,
    no_args_is_help=True,
    help="Fit a model to recordings and save it.",
)


@fits.callback()
def _fit() -> None:
    """Fit a model to recordings and save it."""


def pairs(texts: list[str], option: str) -> dict[str, str]:
    """Read ``factor=level`` options.

    Raises
    ------
    InputError
        If one has no ``=`` or a factor stands twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not (sign and name and value) or name in found:
            what = "the factor stands twice" if name in found else "it is not factor=level"
            raise InputError(
                f"{option} {text!r}", what, f"Write {option} subject=02, once a factor"
            )
        found[name] = value
    return found


def refuse_silent(where: str, **options: Any) -> None:
    """Refuse options that were set and say nothing there; those that were not set are None."""
    for name, value in options.items():
        if value is not None:
            dashed = name.replace("_", "-")
            raise InputError(f"--{dashed}", f"it says nothing {where}", "Leave it out")
