"""A search that is killed goes on as if it had not been, to the last bit."""

import numpy as np
import pytest

import bayesmotion as bm
from bayesmotion import search_state

SEARCHES = {
    "mixture_ppca": bm.EM(max_steps=8, tolerance=0.0),
    "voice_puppetry": bm.EM(max_steps=6, tolerance=0.0),
    "voxel_pose": bm.EM(max_steps=6, tolerance=0.0),
    "relevance_vectors": bm.FastMarginal(),
    "gait_pose": bm.LocalLearning(sweeps=200),
}


class Killed(Exception):
    """The process is gone."""


@pytest.mark.parametrize("name", list(SEARCHES))
def test_a_killed_search_goes_on(name, tmp_path, monkeypatch):
    model, recordings = bm.example(name)
    if name == "gait_pose":
        model = type(model)(surface=bm.Torus())
    monkeypatch.setattr(search_state, "SECONDS", 0.0)
    whole = bm.fit(model, recordings, method=SEARCHES[name], seed=1)
    told, part = [], tmp_path / "part"

    def stop(done: int, best: float) -> None:
        told.append(done)
        if len(told) == 2:
            raise Killed

    with pytest.raises(Killed):
        bm.fit(model, recordings, method=SEARCHES[name], seed=1, checkpoint=part, progress=stop)
    resumed = bm.fit(
        model, recordings, method=SEARCHES[name], seed=1, checkpoint=part, resume=True,
        progress=lambda done, best: told.append(done),
    )  # fmt: skip
    assert told[2] >= told[1] > 0
    for group in ("posterior", "sample_stats"):
        for site, values in whole.tree[group].data_vars.items():
            np.testing.assert_array_equal(resumed.tree[group][site].values, values.values)
    with pytest.raises(bm.InputError, match="belongs to a run with other data"):
        bm.fit(model, recordings, method=SEARCHES[name], seed=2, checkpoint=part, resume=True)


def test_a_search_that_came_to_its_limit_goes_on_further(tmp_path):
    model, recordings = bm.example("mixture_ppca")
    part = tmp_path / "part"
    how = bm.EM(max_steps=4, tolerance=0.0)
    bm.fit(model, recordings, method=how, seed=1, checkpoint=part)
    more = bm.fit(model, recordings, method=how, seed=1, checkpoint=part, resume=True)
    whole = bm.fit(model, recordings, method=bm.EM(max_steps=8, tolerance=0.0), seed=1)
    assert more.stats() == whole.stats()
