"""What pages of models say of priors, drawn from the programs, and which model costs how much.

``python -m bayesmotion.model_pages docs`` fills every block ``priors-MODEL`` of the pages with the
model's sites, their priors and what data can tell, draws a prior predictive check of each into
``docs/images``, and fills the table of the page that helps to choose.
"""

import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jax
import numpy as np
import typer
import xarray as xr
from numpyro import distributions as dist
from numpyro import handlers

from .catalogue import example, models
from .evaluate.checks import predictive_check, predictive_groups
from .evaluate.identified import identified
from .fit import Fit
from .inference.methods import MAP, fit
from .models_page import own
from .plots.checks import checks_plot
from .plots.style import save
from .registry import model_class
from .studies.costs import training_costs
from .studies.tables import table, write_block

DRAWS, SHOWN = 400, 24
WRAPPERS = (dist.Independent, dist.ExpandedDistribution, dist.MaskedDistribution)


def choice(results: Path) -> str:
    """Return the table of models by recordings, tasks, methods and what training took.

    Parameters
    ----------
    results
        Folder of the studies' JSON files.
    """
    found, costs = models(), training_costs(results)
    rows = []
    for name in (str(one) for one in found.index):
        if not own(model_class(name)):
            continue
        row = found.loc[name]
        tasks = ", ".join(f"`bm.{task}`" for task in row["tasks"].split(", ") if task)
        link = f"[`{name}`](models.md#{row['class'].lower()})"
        rows.append(
            [link, row["recordings"], tasks or "`bm.predict`", row["methods"], costs.get(name, "")]
        )
    head = ["model", "what you have", "what it answers", "methods", "training in its study"]
    return table(head, rows)


@cache
def programs_sites(name: str) -> dict[str, dist.Distribution]:
    """Return the priors of the unobserved sites of a model's example, nothing computed."""
    model, recordings = example(name)
    data = model.prepare(recordings).data[0]
    sites: dict[str, dist.Distribution] = {}

    def run(key: jax.Array) -> int:
        trace = handlers.trace(handlers.seed(model.program, key)).get_trace(data)
        for site, told in trace.items():
            hidden = told["type"] == "sample" and not told["is_observed"]
            if hidden and not isinstance(told["fn"], dist.Unit):
                sites[site] = told["fn"]
        return 0

    run(jax.random.key(0))
    return sites


def family(prior: Any) -> str:
    """Return a distribution in words: its name, and parameters that all entries share."""
    while isinstance(prior, WRAPPERS):
        prior = prior.base_dist
    told = []
    for part in getattr(prior, "arg_constraints", {}):
        value = getattr(prior, part, None)
        if not isinstance(value, np.ndarray | jax.Array | float | int):
            continue
        numbers = np.unique(np.round(np.asarray(value, float), 6))
        if numbers.size == 1:
            told.append(f"{numbers[0]:.3g}")
        elif np.ndim(value) == 1 and np.size(value) <= 5:
            told.append("[" + ", ".join(f"{one:.3g}" for one in np.asarray(value)) + "]")
    return type(prior).__name__ + (f"({', '.join(told)})" if told else "")


def priors(name: str, units: Mapping[str, str], draws: xr.Dataset, known: xr.Dataset) -> str:
    """Return the table of a model's priors, and what data can tell.

    Parameters
    ----------
    name
        Of the model.
    units
        Of its sites.
    draws
        Of the prior.
    known
        The identified quantities of a fit.
    """
    rows = []
    for site, prior in programs_sites(name).items():
        values = draws[site].values
        low, mid, high = np.quantile(values, (0.05, 0.5, 0.95))
        dims = ", ".join(str(dim) for dim in draws[site].dims[2:]) or "one number"
        numbers = [f"{one:.2g}" for one in (low, mid, high)]
        rows.append([f"`{site}`", dims, family(prior), *numbers, units.get(site, "")])
    head = ["site", "one for each", "prior", "5 %", "median", "95 %", "unit"]
    told = ", ".join(f"`{one}`" for one in sorted(map(str, known.data_vars)))
    image = f"![Prior predictive check of {name}](images/prior-{name}.svg)"
    return "\n\n".join(
        [
            f'Priors of the example of `{name}` (`bm.example("{name}")`); quantiles are of '
            f"{draws.sizes['draw']} draws of all entries. [Notation](notation.md#{name}) says what "
            "each site is.",
            table(head, rows),
            f"What data can tell, and what R-hat is judged on (`bm.identified`): {told}.",
            "Outcomes drawn from the prior, measured as the recorded ones are, on the example. "
            "Blue: what was recorded lies in the central 90 % of the draws; vermilion: outside.",
            image,
        ]
    )


def units_of(page: str) -> dict[str, dict[str, str]]:
    """Return by model the unit of every site that the page of notation tells."""
    found: dict[str, dict[str, str]] = {}
    for part in page.split("\n## ")[1:]:
        title, *lines = part.splitlines()
        for line in lines:
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            named = len(cells) == 4 and "`" in cells[1]
            for site in cells[1].split(",") if named else ():
                found.setdefault(title, {})[site.strip(" `")] = cells[2]
    return found


def picture(checked: Fit, path: Path) -> None:
    """Draw the prior predictive check of a model, ranges of joints thinned out."""
    check = predictive_check(checked, "prior", draws=DRAWS // 4, seed=0)
    drawn = check.drawn.mean("clip").transpose("draw", "statistic")
    names = [str(one) for one in drawn["statistic"].values]
    every = max(1, -(-sum("range" in one for one in names) // SHOWN))
    kept = [i for i, one in enumerate(names) if "range" not in one or i % every == 0]
    recorded = check.recorded.mean("clip").values
    save(checks_plot(drawn.values[:, kept], recorded[kept], [names[i] for i in kept]), path)


def point(name: str) -> Fit:
    """Return a fit of a model's example of one step: its values do not matter."""
    model, recordings = example(name)
    return fit(model, recordings, method=MAP(initial=1, keep=1, max_steps=1), seed=0)


def main(docs: Path) -> None:
    """Fill the blocks of the pages, and draw the pictures."""
    units = units_of((docs / "notation.md").read_text(encoding="utf-8"))
    write_block(docs / "which-model.md", "which-model", choice(docs / "results"))
    for name in map(str, models().index):
        mark = f"<!-- results:priors-{name} -->"
        pages = [p for p in docs.glob("*.md") if mark in p.read_text(encoding="utf-8")]
        if not pages:
            continue
        fitted = point(name)
        draws = predictive_groups(fitted, ("prior",), draws=DRAWS)["prior"].to_dataset()
        text = priors(name, units.get(name, {}), draws, identified(fitted))
        picture(fitted, docs / "images" / f"prior-{name}.svg")
        write_block(pages[0], f"priors-{name}", text)


if __name__ == "__main__":
    sys.exit(typer.run(main))
