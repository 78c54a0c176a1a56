"""What the pages say is what the results' files hold."""

import json
from pathlib import Path

import pytest

from bayesmotion.studies import multifactor_report, posterior_report

ROOT = Path(__file__).parent.parent
PAGES = {
    "multifactor": ("README.md", multifactor_report),
    "posterior": ("docs/posterior.md", posterior_report),
}


@pytest.mark.parametrize("study", PAGES)
def test_a_page_shows_the_landed_results(study):
    page, report = PAGES[study]
    results = json.loads((ROOT / f"docs/results/{study}.json").read_text(encoding="utf-8"))
    assert report.markdown(results) in (ROOT / page).read_text(encoding="utf-8")
