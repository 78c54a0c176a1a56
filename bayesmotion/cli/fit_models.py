"""The commands ``fit MODEL``: made from the settings of the models and methods themselves."""

import inspect
import json
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from .. import console
from ..errors import InputError
from ..files import FIT, write_json
from ..seeds import MAX_SEED
from .outputs import Json, checked, tell_saved

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit

LOOKED_AT = 400  # draws, before a fit is saved

Files = Annotated[list[Path], typer.Argument(help="Recordings.")]
Out = Annotated[Path, typer.Option(help="Where the fit is saved (netCDF)."), FIT]
Seed = Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Of everything that is random.")]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        help="Go on with a run that was interrupted, or a search that has not converged.",
    ),
]


class ModelCommands(TyperGroup):
    """One command a model, made when it is asked for."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all models."""
        from ..registry import model_names

        return [name.replace("_", "-") for name in model_names()]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a model, None where there is no such model."""
        from ..registry import model_names

        name = cmd_name.replace("-", "_")
        if name not in model_names():
            return None
        app = typer.Typer(add_completion=False)
        app.command(cmd_name)(checked(_command(name)))
        return typer.main.get_command(app)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the model's command; refuse what is no model."""
        if args and self.get_command(ctx, args[0]) is None:
            known = ", ".join(self.list_commands(ctx))
            raise InputError(repr(args[0]), "there is no such model", f"Use {known}")
        return super().resolve_command(ctx, args)


def _command(name: str) -> Any:
    """Return the function ``fit MODEL`` with its options."""
    from ..inference.methods import METHODS
    from ..registry import model_class
    from .settings import option, options_of, parameter_words, with_options

    kind: Any = model_class(name)
    read = _reader(kind)
    methods = {method: METHODS[method] for method in kind.about.methods}
    own = options_of(kind)
    words = parameter_words(read)
    reading = [
        option(p.name, p.annotation, p.default, words.get(p.name, ""))
        for p in list(inspect.signature(read).parameters.values())[1:]
    ]
    steering = _method_options(methods)
    names = [p.name for p in (*own, *reading, *steering)]
    assert len(set(names)) == len(names), f"{name}: options of one name in {names}"

    def run(**given: Any) -> None:
        files, out, seed = given.pop("files"), given.pop("out"), given.pop("seed")
        method, resume = given.pop("method"), given.pop("resume")
        json_file = given.pop("json_file")
        parts = [{p.name: given[p.name] for p in part} for part in (own, reading, steering)]
        found = _fit(kind, files, out, method, seed, resume, *parts)
        tell_fit(found, out)
        if json_file is not None:
            write_json(json_file, {**figures_of(found), "file": str(out)})
        tell_saved(out, json_file)

    run.__doc__ = f"{_summary(kind)}\n\nRecordings: {kind.about.recordings}."
    run.__name__ = f"fit_{name}"
    keyword = inspect.Parameter.KEYWORD_ONLY
    usual = [
        inspect.Parameter("files", keyword, annotation=Files),
        inspect.Parameter("out", keyword, annotation=Out),
        inspect.Parameter("method", keyword, default=next(iter(methods)), annotation=Annotated[
            str, typer.Option(help=f"One of {', '.join(methods)}.")]),
        inspect.Parameter("seed", keyword, default=0, annotation=Seed),
        inspect.Parameter("resume", keyword, default=False, annotation=Resume),
        inspect.Parameter("json_file", keyword, default=None, annotation=Json),
    ]  # fmt: skip
    return with_options(run, [*usual, *reading, *own, *steering])


def _reader(kind: Any) -> Any:
    """Return what reads a model's recordings: its own, or else that of stored data sets."""
    from ..model import ReadsFiles

    reads: object = kind
    return kind.read if isinstance(reads, ReadsFiles) else read_dataset


def read_dataset(files: Sequence[Path]) -> "xr.Dataset":
    """Read recordings that are stored as a netCDF file, as `xarray.Dataset.to_netcdf` does.

    Raises
    ------
    InputError
        If there are several files, or one that is not netCDF.
    """
    from ..netcdf import read_netcdf

    mend = "Give one netCDF file of the data set that the model explains"
    if len(files) != 1:
        raise InputError(", ".join(map(str, files)), "these are several files", mend)
    return read_netcdf(files[0], mend).to_dataset()


def _summary(kind: Any) -> str:
    return (inspect.getdoc(kind) or kind.__name__).split("\n\n")[0].replace("\n", " ")


def _method_options(methods: dict[str, Any]) -> list[inspect.Parameter]:
    """Return one option for every setting of any method, which says whose it is."""
    from .settings import option, parameter_words, written

    found: dict[str, tuple[Any, list[str], str]] = {}
    for name, method in methods.items():
        words = parameter_words(method)
        for field in fields(method):
            hint, told, said = found.get(field.name, (field.type, [], words.get(field.name, "")))
            found[field.name] = hint, [*told, f"{name} {written(field.default)}"], said
    return [
        option(name, hint, None, f"{said} By default: {'; '.join(told)}.".strip())
        for name, (hint, told, said) in found.items()
    ]


def _fit(
    kind: Any, files: list[Path], out: Path, method: str, seed: int, resume: bool,
    own: dict[str, Any], reading: dict[str, Any], steering: dict[str, Any],
) -> "Fit":  # fmt: skip
    """Read, fit and save."""
    from ..evaluate.diagnostics import diagnose
    from ..inference.checkpoint import part_of
    from ..inference.methods import METHODS, fit
    from .settings import parsed, settings_from

    if method not in kind.about.methods:
        raise InputError(
            repr(method), "there is no such method", f"Use {', '.join(kind.about.methods)}"
        )
    samples = method in ("nuts", "ensemble")
    chosen: Any = METHODS[method]
    mine = {field.name for field in fields(chosen)}
    for name, value in steering.items():
        if value is not None and name not in mine:
            known = ", ".join("--" + own.replace("_", "-") for own in sorted(mine))
            flag = f"--{name.replace('_', '-')}"
            raise InputError(flag, f"it says nothing to the method {method}", f"It has {known}")
    how = chosen(**settings_from(chosen, {n: v for n, v in steering.items() if n in mine}))
    read = _reader(kind)
    signature = inspect.signature(read).parameters
    options = {
        name: parsed(signature[name].annotation, value, f"--{name.replace('_', '-')} {value}")
        for name, value in reading.items()
        if value is not None
    }
    settings = settings_from(kind, own)
    recordings = read(files, **options)
    usual = kind.settings_for(recordings) if hasattr(kind, "settings_for") else {}
    model = kind(**{**usual, **settings})
    part = part_of(out)
    # A search begins anew where it is not said to go on: what it had is no draw that is lost.
    if samples and part.exists() and not resume:
        raise InputError(
            part, "a run was interrupted here", "Go on with --resume, or delete the file"
        )
    if resume and not part.exists():
        console.note(f"there is no state {part} to go on from: the run begins anew")
    total = getattr(how, "max_steps", 0) or getattr(how, "sweeps", 0)
    total = total or how.warmup + getattr(how, "steps", how.draws)
    try:
        with console.progress(method, total) as progress:
            found = fit(model, recordings, method=how, seed=seed, checkpoint=part, resume=resume,
                        progress=progress)  # fmt: skip
    except KeyboardInterrupt:
        if part.exists():
            what = "mode and the draws" if samples else "search"
            console.note(f"{part} has the {what} so far; --resume goes on from there")
        raise
    found.tree.attrs["reading"] = json.dumps(
        {name: str(value) if isinstance(value, Path) else value for name, value in options.items()}
    )
    if samples:
        # What the identified quantities say is kept with the fit, for those who use it.
        told = [*found.warnings, *diagnose(found, LOOKED_AT).problems]
        found.tree.attrs["warnings"] = json.dumps(list(dict.fromkeys(told)))
    found.save(out)
    if samples or bool(found.tree["sample_stats"].ds["converged"].all()):
        part.unlink(missing_ok=True)
    return found


def figures_of(fit: "Fit") -> dict[str, Any]:
    """Return how a fit went, as plain values."""
    stats, sizes = fit.tree["sample_stats"].ds, fit.tree["posterior"].sizes
    figures = {
        "model": fit.model.name, "method": str(fit.tree.attrs["inference"]),
        "chains": sizes["chain"], "draws": sizes["draw"],
        "log_density": float(stats["lp"].values.max()),
        "seconds": float(fit.tree.attrs["seconds"]), "warnings": list(fit.warnings),
    }  # fmt: skip
    if fit.point_estimate:
        figures["converged"] = bool(stats["converged"].values.all())
        figures["steps"] = int(stats["steps"].values.max())
    return figures


def tell_fit(fit: "Fit", out: Path) -> None:
    """Say in one line how the fit went, and what to know before trusting it."""
    stats = fit.tree["sample_stats"].ds
    seconds, best = float(fit.tree.attrs["seconds"]), float(stats["lp"].values.max())
    if fit.point_estimate:
        steps = int(stats["steps"].values.max())
        end = "converged" if stats["converged"].values.all() else "not converged"
        console.say(f"{end} after {steps} steps and {seconds:.1f} seconds, log density {best:.2f}")
        if end != "converged":
            console.note("the same command with --resume goes on from there")
        return
    chains, draws = stats.sizes["chain"], stats.sizes["draw"]
    many = f"{chains} chains of {draws} draws" if chains > 1 else f"{draws} draws"
    console.say(f"{many} in {seconds:.1f} seconds, best log density {best:.2f}")
    for warning in fit.warnings:
        console.note(f"warning: {warning}")
    if fit.warnings:
        console.say(f"not to be trusted as it is; bayesmotion diagnose {out} tells more")
