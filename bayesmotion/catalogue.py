"""The models of the collection as a table, and an example of each."""

import pandas as pd
import xarray as xr

from .model import Model, model_class, model_names


def models() -> pd.DataFrame:
    """Return a table of all models: name, paper, recordings, methods, and verbs of their own.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> bm.models().loc["multifactor", "methods"]
    'map, nuts, ensemble'
    """
    rows = {}
    for name in model_names():
        kind = model_class(name)
        rows[name] = {
            "class": kind.__name__,
            "paper": kind.about.paper,
            "recordings": kind.about.recordings,
            "methods": ", ".join(kind.about.methods),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("model")


def example(name: str, seed: int = 0) -> tuple[Model, xr.Dataset]:
    """Return a small model and recordings made for it.

    Parameters
    ----------
    name
        Of the model; `models` lists them.
    seed
        Of the recordings.

    Raises
    ------
    InputError
        If there is no such model.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> model, recordings = bm.example("multifactor")
    """
    return model_class(name).example(seed)
