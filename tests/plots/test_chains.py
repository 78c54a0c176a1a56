import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.plots import chains_plot


def draws() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(4, 200))


def outside(figure) -> int:
    """Count the bins of chains outside the band in the first quantity's panel of ranks."""
    ax = figure.axes[1]
    band = ax.patches[0].get_y(), ax.patches[0].get_y() + ax.patches[0].get_height()
    counts = np.concatenate([stairs.get_data().values for stairs in ax.patches[1:]])
    return int(np.sum((counts < band[0]) | (counts > band[1])))


def test_chains_that_agree_stay_in_the_band_and_others_leave_it():
    good = draws()
    assert outside(chains_plot({"gamma": good})) <= 4
    apart = good + np.array([[0.0], [0.0], [0.0], [2.0]])
    assert outside(chains_plot({"gamma": apart})) > 10


def test_every_quantity_has_a_row_with_its_name():
    figure = chains_plot({"gamma": draws(), "step[a]": draws()})
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["gamma", "", "step[a]", ""]


def test_nothing_to_draw_is_refused():
    with pytest.raises(InputError, match="there are none"):
        chains_plot({})
    with pytest.raises(InputError, match="fewer than four"):
        chains_plot({"gamma": np.zeros((2, 3))})
