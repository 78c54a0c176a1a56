"""The contract of all models, and of one that a user writes from the page on adding a model."""

import bayesmotion as bm


def test_a_model_from_the_page_keeps_the_contract(mean_cycle):
    assert bm.check_model(mean_cycle)


def test_the_page_runs(mean_cycle, page_blocks):
    names = {"bm": bm, "MeanCycle": mean_cycle}
    for block in page_blocks[1:]:
        exec(block, names)
    assert names["fit"].model == mean_cycle()
