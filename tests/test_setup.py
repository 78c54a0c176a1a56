"""What an installation is bound to."""

import tomllib
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import bayesmotion
from bayesmotion.errors import InputError
from bayesmotion.extras import required

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_requirement_is_bound_to_a_version_that_it_allows(project):
    bound = [Requirement(line) for line in project["tool"]["uv"]["constraint-dependencies"]]
    versions = {one.name: str(one.specifier).removeprefix("==") for one in bound}
    assert len(versions) == len(bound)
    extras = project["project"]["optional-dependencies"].values()
    lists = [project["project"]["dependencies"], project["dependency-groups"]["dev"], *extras]
    for line in chain.from_iterable(lists):
        wanted = Requirement(line)
        assert wanted.specifier.contains(versions[wanted.name]), line


def test_the_python_that_uv_takes_is_allowed(project):
    chosen = (ROOT / ".python-version").read_text().strip()
    allowed = Requirement(f"python{project['project']['requires-python']}").specifier
    assert allowed.contains(chosen)
    assert not allowed.contains("3.11.9")
    assert not allowed.contains("3.15.0")


def test_tests_are_no_part_of_what_a_user_installs(project):
    names = {Requirement(line).name for line in project["project"]["dependencies"]}
    assert not names & {"pytest", "pytest-xdist", "beartype"}


def test_the_package_says_that_it_is_typed():
    assert (Path(bayesmotion.__file__).parent / "py.typed").exists()


def test_what_an_extra_brings_is_named_where_it_is_missing():
    told = r"'no_such_package': it is not installed. Install bayesmotion\[sound\]"
    with pytest.raises(InputError, match=told):
        required("no_such_package.part", "sound")
    assert required("json", "sound").dumps
