"""Whether the draws of a fit are to be trusted, told in words.

Looked at are the identified quantities of the model (`identified`) and the log density:

    R-hat           rank-normalised and folded, split chains        (Vehtari et al. 2021)
    bulk, tail ESS  how many independent draws they are worth       (Vehtari et al. 2021)
    MCSE            standard error of the mean that is left
    divergences     steps at which the integrator left the energy surface
    E-BFMI          how well the momentum refreshes the energy      (Betancourt 2016)
    tree depth      how often a trajectory was cut short

The walkers of an ensemble depend on each other and are one chain: there is no R-hat
over them, and their effective sample size comes from the autocorrelation time of the
ensemble (Goodman and Weare 2010). A point estimate, by whatever method, is one draw and has
none of these.
"""

import json
from dataclasses import dataclass, field
from html import escape
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from arviz_stats.sampling_diagnostics import bfmi, ess, mcse, rhat

from ..fit import Fit
from .identified import identified

R_HAT, ESS_PER_CHAIN, E_BFMI = 1.01, 100, 0.3
ESS = 400  # of an ensemble, as of four chains
TAILS = (0.05, 0.95)
SHOWN = 8


class Quantity(NamedTuple):
    """What one identified quantity's draws are worth; R-hat is None over walkers."""

    name: str
    mean: float
    sd: float
    r_hat: float | None
    ess_bulk: float
    ess_tail: float | None
    mcse: float


@dataclass(frozen=True, repr=False)
class Diagnosis:
    """What is to be said of a fit; printed, it reads as ``bayesmotion diagnose`` does.

    inference
        Name of the method the fit was made by.
    quantities
        Those that vary, worst first; none for a point estimate.
    figures
        Numbers of the run as a whole: max_r_hat, min_ess_bulk, min_ess_tail,
        divergences, min_e_bfmi, tree_depth_hits, as far as there are such.
    sentences
        What was found.
    problems
        Why it is not to be trusted; empty if it is.
    """

    inference: str
    quantities: tuple[Quantity, ...] = ()
    figures: dict[str, float] = field(default_factory=dict)
    sentences: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def trusted(self) -> bool:
        """Whether nothing speaks against the fit."""
        return not self.problems

    def table(self, most: int | None = None) -> pd.DataFrame:
        """Return the quantities, worst first: R-hat, effective sample sizes, mean, sd, MCSE.

        Parameters
        ----------
        most
            At most so many; all where None.
        """
        head = ["R-hat", "bulk ESS", "tail ESS", "mean", "sd", "MCSE"]
        rows = [
            (q.r_hat, round(q.ess_bulk), None if q.ess_tail is None else round(q.ess_tail),
             q.mean, q.sd, q.mcse)
            for q in self.quantities[:most]
        ]  # fmt: skip
        names = pd.Index([q.name for q in self.quantities[:most]], name="quantity")
        return pd.DataFrame(rows, index=names, columns=head, dtype=object)

    def __repr__(self) -> str:
        """Return sentences, the worst quantities, and what speaks against the fit."""
        lines = list(self.sentences)
        if self.quantities:
            shown = self.table(SHOWN).to_string(formatters=[_cell] * 6)
            lines += ["", "The worst", shown, ""]
        return "\n".join([*lines, *_conclusion(self.problems)])

    def _repr_html_(self) -> str:
        """Return the same as notebooks show it."""
        said = "".join(f"<p>{escape(text)}</p>" for text in self.sentences)
        rows = self.table(SHOWN).to_html(formatters=[_cell] * 6) if self.quantities else ""
        head, *problems = _conclusion(self.problems)
        listed = "".join(f"<li>{escape(text.removeprefix('- '))}</li>" for text in problems)
        return f"{said}{rows}<p><b>{escape(head)}</b></p>" + (listed and f"<ul>{listed}</ul>")

    def to_dict(self) -> dict[str, object]:
        """Return all of it as plain values, for a JSON file."""
        return {
            "inference": self.inference,
            "trusted": self.trusted,
            "figures": self.figures,
            "quantities": [q._asdict() for q in self.quantities],
            "sentences": list(self.sentences),
            "problems": list(self.problems),
        }


def _conclusion(problems: tuple[str, ...]) -> list[str]:
    if not problems:
        return ["Nothing speaks against this fit."]
    return ["This fit is not to be trusted:", *(f"- {text}" for text in problems)]


def _cell(value: object) -> str:
    """Write a value of the table; nothing known is a dash."""
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def diagnose(fit: Fit, most: int | None = None) -> Diagnosis:
    """Say whether a fit's draws are to be trusted.

    Parameters
    ----------
    fit
        A fit by any method.
    most
        Look at so many draws at most, evenly spread; at all where None.
    """
    if fit.point_estimate:
        return _of_point(fit)
    moving, problems = varying(watched(fit, most))
    # Walkers bring their autocorrelation times along; chains are judged by themselves.
    if "autocorrelation" in fit.tree.attrs:
        return _of_ensemble(fit, moving, problems)
    return _of_chains(fit, moving, problems)


def watched(fit: Fit, most: int | None = None) -> xr.Dataset:
    """Give the identified quantities and the sampler's log density, draw by draw."""
    quantities = identified(fit, most)
    stats = fit.tree["sample_stats"].to_dataset()
    if "lp" in stats and dict(stats.sizes) == {n: quantities.sizes[n] for n in stats.sizes}:
        quantities["log_density"] = stats["lp"].drop_vars(stats["lp"].coords)
    return quantities


def scalars(quantities: xr.Dataset, sample: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """Take data apart into single quantities, called as in ``step[ann-walk]``.

    Parameters
    ----------
    quantities
        Any data set.
    sample
        Dimensions that stay, in this order.
    """
    out = {}
    for name, array in quantities.data_vars.items():
        rest = [dim for dim in array.dims if dim not in sample]
        array = array.transpose(*rest, *sample)
        for index in np.ndindex(*(array.sizes[dim] for dim in rest)):
            labels = [str(array[d].values[i]) for d, i in zip(rest, index, strict=True)]
            out[f"{name}[{'; '.join(labels)}]" if labels else str(name)] = np.asarray(
                array.values[index]
            )
    return out


def r_hat(draws: xr.Dataset) -> dict[str, float]:
    """Give the rank-normalised split R-hat of every scalar that varies."""
    moving, _ = varying(draws)
    return {name: split_r_hat(value) for name, value in moving.items()}


def split_r_hat(draws: np.ndarray) -> float:
    """Return the rank-normalised split R-hat of draws (chain, draw).

    It is infinite where halves of chains stand still at different values.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        found = float(rhat(draws))
    return found if np.isfinite(found) else float("inf")


def varying(quantities: xr.Dataset) -> tuple[dict[str, np.ndarray], list[str]]:
    """Give the scalars that vary (chain, draw), and what is wrong where nothing moves."""
    every = scalars(quantities, ("chain", "draw"))
    broken = [name for name, value in every.items() if not np.all(np.isfinite(value))]
    sound = {name: value for name, value in every.items() if name not in broken}
    # Some are fixed by definition, as the first level's length is.
    moving = {n: v for n, v in sound.items() if np.ptp(v) > 1e-10 * max(np.abs(v).max(), 1.0)}
    problems = []
    if broken:
        problems.append(f"{len(broken)} quantities are not finite, {broken[0]} among them")
    chains = range(quantities.sizes["chain"])
    still = [c for c in chains if all(np.ptp(v[c]) == 0.0 for v in moving.values())]
    if still:
        names = ", ".join(str(c) for c in still)
        problems.append(f"nothing moves in chain {names}: every draw is the same")
    return moving, problems


def _of_point(fit: Fit) -> Diagnosis:
    stats, method = fit.stats(), str(fit.tree.attrs["inference"])
    said = [
        f"A point estimate by {method}: one draw, so there is no R-hat and no effective "
        "sample size.",
        "It is where what was maximised is highest and does not say how wide the posterior is; "
        "intervals from it take the parameters for known and are too narrow.",
    ]
    values = fit.tree["posterior"].to_dataset().data_vars.items()
    broken = [str(name) for name, value in values if not np.all(np.isfinite(value.values))]
    problems = [f"{name} is not finite" for name in broken]
    if stats.get("converged") == 1.0:
        said.append("The search converged.")
    elif "converged" in stats:
        steps = int(stats["steps"])
        problems.append(f"the search stopped after {steps} steps and has not converged")
    # That it has not converged is told already.
    said += [f"Noted when it was fitted: {text}." for text in _warnings(fit)
             if "converged" not in text]  # fmt: skip
    return Diagnosis(method, sentences=tuple(said), problems=tuple(problems))


def _of_chains(fit: Fit, moving: dict[str, np.ndarray], problems: list[str]) -> Diagnosis:
    inference = str(fit.tree.attrs["inference"])
    rows = [_row(name, value, split_r_hat(value)) for name, value in moving.items()]
    rows.sort(key=lambda row: -(row.r_hat if row.r_hat is not None else 0.0))
    chains, draws = next(iter(moving.values())).shape if moving else (0, 0)
    said = [f"{chains} chains of {draws} draws by {inference}, {len(rows)} identified quantities."]
    figures: dict[str, float] = {}
    if rows:
        figures = {
            "max_r_hat": max(row.r_hat or 0.0 for row in rows),
            "min_ess_bulk": min(row.ess_bulk for row in rows),
            "min_ess_tail": min(row.ess_tail or 0.0 for row in rows),
        }
        _judge_mixing(rows, figures, chains, said, problems)
    if chains == 1:
        problems.append("there is one chain only: nothing shows that another would agree")
    _judge_sampler(fit, figures, said, problems)
    said += [f"Noted when it was fitted: {text}." for text in _warnings(fit)]
    return Diagnosis(inference, tuple(rows), figures, tuple(said), tuple(problems))


def _row(name: str, value: np.ndarray, r_hat: float) -> Quantity:
    bulk = float(ess(value, method="bulk"))
    tail = float(ess(value, method="tail", prob=TAILS))
    error = float(mcse(value, method="mean"))
    return Quantity(name, float(value.mean()), float(value.std()), r_hat, bulk, tail, error)


def _judge_mixing(
    rows: list[Quantity],
    figures: dict[str, float],
    chains: int,
    said: list[str],
    problems: list[str],
) -> None:
    worst = rows[0]
    if figures["max_r_hat"] <= R_HAT:
        said.append(
            f"The chains agree: R-hat is at most {figures['max_r_hat']:.3f} ({worst.name})."
        )
    else:
        count = sum((row.r_hat or 0.0) > R_HAT for row in rows)
        problems.append(
            f"the chains disagree: R-hat is above {R_HAT} for {count} of {len(rows)} "
            f"quantities, {figures['max_r_hat']:.3f} for {worst.name}"
        )
    enough = ESS_PER_CHAIN * chains
    for kind, low in (("bulk", figures["min_ess_bulk"]), ("tail", figures["min_ess_tail"])):
        name = min(rows, key=lambda row: getattr(row, f"ess_{kind}")).name
        text = f"the {kind} effective sample size of {name} is {low:.0f}"
        if low >= enough:
            said.append(f"Enough draws: {text}, the lowest.")
        else:
            problems.append(f"{text}, below {enough} ({ESS_PER_CHAIN} a chain)")
    least = max(rows, key=lambda row: row.mcse / row.sd)
    said.append(
        f"The mean of {least.name} is known worst: to {least.mcse / least.sd:.1%} of its "
        "posterior standard deviation."
    )


def _judge_sampler(
    fit: Fit, figures: dict[str, float], said: list[str], problems: list[str]
) -> None:
    stats = fit.tree["sample_stats"].to_dataset()
    if "diverging" in stats:
        count = int(stats["diverging"].sum())
        figures["divergences"] = count
        if count:
            share = count / stats["diverging"].size
            problems.append(f"{count} steps diverged ({share:.1%}): draws there are missing")
        else:
            said.append("No step diverged.")
    if "energy" in stats:
        low = float(np.min(bfmi(stats["energy"].transpose("chain", "draw").values)))
        figures["min_e_bfmi"] = low
        if low < E_BFMI:
            problems.append(f"E-BFMI is {low:.2f}, below {E_BFMI}: the energy hardly moves")
        else:
            said.append(f"E-BFMI is at least {low:.2f}.")
    if "reached_max_treedepth" in stats:
        hits = int(stats["reached_max_treedepth"].sum())
        figures["tree_depth_hits"] = hits
        if hits:
            said.append(
                f"{hits} trajectories were cut short at the greatest tree depth: slow, not wrong."
            )


def _of_ensemble(fit: Fit, moving: dict[str, np.ndarray], problems: list[str]) -> Diagnosis:
    """Judge walkers: one chain, worth (walkers x steps) / autocorrelation time draws."""
    attrs = fit.tree.attrs
    tau, worth = (json.loads(str(attrs[name])) for name in ("autocorrelation", "ess"))
    slowest = max(tau, key=tau.__getitem__)
    least = min(worth[slowest], *(value.size for value in moving.values()))
    rows = []
    for name, value in moving.items():
        sd = float(value.std())
        error = sd / np.sqrt(least) if least > 0 else float("inf")
        rows.append(Quantity(name, float(value.mean()), sd, None, least, None, error))
    said = [
        f"An ensemble of walkers, {len(rows)} identified quantities. Walkers depend on each "
        "other: there is no R-hat over them.",
        f"{float(attrs['acceptance']):.0%} of the moves were accepted. The longest "
        f"autocorrelation time is {tau[slowest]:.1f} steps ({slowest}).",
    ]
    text = f"what was kept is worth {least:.0f} independent draws"
    if least < ESS:
        problems.append(f"{text}, below {ESS}")
    else:
        said.append(f"Enough draws: {text}.")
    problems += _warnings(fit)
    figures = {"autocorrelation_time": tau[slowest], "min_ess_bulk": least}
    inference = str(fit.tree.attrs["inference"])
    return Diagnosis(inference, tuple(rows), figures, tuple(said), tuple(problems))


def _warnings(fit: Fit) -> list[str]:
    return [text.rstrip(".") for text in fit.warnings]
