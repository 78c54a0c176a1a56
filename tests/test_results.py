"""What the pages say is what the results' files hold."""

import json
from pathlib import Path

from bayesmotion.studies.multifactor_report import markdown

ROOT = Path(__file__).parent.parent


def test_the_readme_shows_the_landed_results():
    results = json.loads((ROOT / "docs/results/multifactor.json").read_text(encoding="utf-8"))
    assert markdown(results) in (ROOT / "README.md").read_text(encoding="utf-8")
