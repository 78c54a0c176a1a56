"""Refusing what is no density, before it is sampled, calibrated or compared."""

from typing import Any

from numpyro import distributions as dist

from ..errors import InputError
from ..gp.unnormalised import NoDensity
from .density import sites_of


def require_densities(program: Any, data: tuple) -> None:
    """Refuse a program whose log density has no finite integral that is known.

    Parameters
    ----------
    program
        A function, or a NumPyro handler of one, with a value for every site: seeded or
        substituted.
    data
        Its arguments.

    Raises
    ------
    InputError
        If a prior is improper, or a part is a bound or a product without a known constant
        that depends on a site which is not fixed (`gp.unnormalised`).
    """
    sites = {n: s for n, s in sites_of(program, data).items() if s["type"] == "sample"}
    unknown = {name for name, site in sites.items() if not site["is_observed"]}
    for name, site in sites.items():
        if isinstance(site["fn"], dist.ImproperUniform):
            raise InputError(
                f"site {name!r}", "its prior is improper", "Use proper priors, or method map"
            )
        mark: NoDensity | None = getattr(site["fn"], "no_density", None)
        if mark is not None and (not mark.depends_on or unknown & {*mark.depends_on}):
            raise InputError(f"site {name!r}", mark.what, mark.what_to_do)
