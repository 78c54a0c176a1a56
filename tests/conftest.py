"""Strict tests: shapes are checked at run time, real data is found or its absence explained."""

import atexit
import contextlib
import gc
import importlib.util
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from jaxtyping import install_import_hook
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

# Before anything of the package is imported, so that every annotated function is checked.
# The hook works from this call on; it would end if it were used as a context manager.
assert "bayesmotion" not in sys.modules
install_import_hook("bayesmotion", "beartype.beartype")

# Tracing makes millions of objects that are freed as they are left; looking through all that are
# kept, time and again, takes a twentieth of the tests' time.
gc.set_threshold(100_000, 20, 50)

CONTRACT = "tests/test_contract.py"

# What one process compiled serves all of them, and serves again once it is forgotten there.
# Most programs of tests are small.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    compiled = tempfile.mkdtemp(prefix="bayesmotion-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = compiled
    # Workers are given it by the process that starts them, which ends last.
    atexit.register(shutil.rmtree, compiled, ignore_errors=True)
# Not so for librosa's programs: processes that fill one cache of numba's at the same time
# read halves of different programs and crash (numba/numba#10128).
own = tempfile.mkdtemp(prefix="bayesmotion-numba-")
os.environ["NUMBA_CACHE_DIR"] = own
atexit.register(shutil.rmtree, own, ignore_errors=True)
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
# Tests run little of what they compile: LLVM's optimisations take longer than they save.
os.environ["XLA_FLAGS"] = f"--xla_backend_optimization_level=0 {os.environ.get('XLA_FLAGS', '')}"


class InGroups(LoadScopeScheduling):
    """Give workers whole groups of tests, one after the other.

    The marks of `--dist=loadgroup` do nothing any more: pytest-xdist 3.8 writes them to what
    pytest 9.2 does not read, and every test goes to any worker, which makes all fixtures anew.
    """

    def _split_scope(self, nodeid: str) -> str:
        """Return the group of a test."""
        return group_of(nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> InGroups:
    """Share the tests out by groups."""
    return InGroups(config, log)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave thorough tests out unless they are asked for, or named; put what takes longest first.

    Workers that begin with the longest groups end together.
    """
    named = any("::" in one for one in config.args)
    if not (named or config.getoption("--thorough")):
        left_out = [item for item in items if item.get_closest_marker("thorough")]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("thorough")]
    slow = {group_of(item.nodeid) for item in items if item.get_closest_marker("slow")}
    groups = dict.fromkeys(group_of(item.nodeid) for item in items)
    order = {name: at for at, name in enumerate(sorted(groups, key=lambda name: name not in slow))}
    items.sort(key=lambda item: order[group_of(item.nodeid)])


def group_of(nodeid: str) -> str:
    """Return what is run by one worker: files, which share fits; the contract model by model."""
    file, _, test = nodeid.partition("::")
    return f"{file}[{test.partition('[')[2]}" if file == CONTRACT else file


@pytest.fixture(autouse=True, scope="module")
def few_programs() -> None:
    """Begin every file with room for the programs that it compiles, as `bm.fit` does."""
    from bayesmotion.programs import forget_programs

    forget_programs()


@pytest.fixture(autouse=True, scope="module")
def one_worker(request: pytest.FixtureRequest, tmp_path_factory, testrun_uid, worker_id) -> None:
    """Make sure that workers are given whole files: nothing else would tell, but the time."""
    file = request.node.nodeid
    if file == CONTRACT or worker_id == "master":
        return
    # The folder above those of the workers is one for all of them.
    seen = tmp_path_factory.getbasetemp().parent / f"{testrun_uid}-{file.replace('/', '-')}"
    with contextlib.suppress(FileExistsError), seen.open("x") as written:
        written.write(worker_id)
    assert seen.read_text() == worker_id, f"tests of {file} are run by several workers"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let users say how many damaged files and killed runs are tried, and where pictures go."""
    parser.addoption("--mutations", type=int, default=6, help="damaged files of each kind")
    parser.addoption("--thorough", action="store_true", help="what takes long and seldom fails")
    parser.addoption("--exhaustive", action="store_true", help="every convention in every task")
    parser.addoption("--kills", type=int, default=1, help="kills of each run (test_killed)")
    parser.addoption("--screenshots", type=Path, help="folder for pictures of pages")


@pytest.fixture(scope="session")
def mutations(request: pytest.FixtureRequest) -> int:
    """How many damaged files of each kind are tried."""
    return request.config.getoption("--mutations")


@pytest.fixture(scope="session")
def exhaustive(request: pytest.FixtureRequest) -> bool:
    """Whether what is alike is tried in all its forms."""
    return request.config.getoption("--exhaustive")


@pytest.fixture(scope="session")
def kills(request: pytest.FixtureRequest) -> int:
    """How often each run is killed."""
    return request.config.getoption("--kills")


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder of the public recordings; tests that use it carry the marker `real_data`."""
    root = os.environ.get("BAYESMOTION_DATA")
    if not root or not Path(root).is_dir():
        pytest.skip("real recordings are needed: set BAYESMOTION_DATA to their folder")
    return Path(root)


@pytest.fixture(scope="session")
def page_blocks() -> list[str]:
    """Code blocks of the page on adding a model: the model, its registration, use, contract."""
    page = Path(__file__).parents[1] / "docs" / "adding-a-model.md"
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(scope="session")
def mean_cycle_module(page_blocks, tmp_path_factory) -> ModuleType:
    """The model of that page, from a file in a folder of its own, and registered."""
    import bayesmotion as bm

    path = tmp_path_factory.mktemp("package") / "mean_cycle.py"
    path.write_text(page_blocks[0], encoding="utf-8")
    spec = importlib.util.spec_from_file_location("mean_cycle", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    bm.register(module.MeanCycle)
    return module


@pytest.fixture(scope="session")
def mean_cycle(mean_cycle_module) -> type:
    """Its class."""
    return mean_cycle_module.MeanCycle


@pytest.fixture(scope="session")
def cycle_mode(mean_cycle):
    """A point estimate of it."""
    import bayesmotion as bm

    model, recordings = mean_cycle.example()
    return bm.fit(model, recordings, method=bm.MAP(), seed=0)


@pytest.fixture(scope="session")
def cycle_draws(mean_cycle):
    """Draws of it, from recordings some of whose entries are missing."""
    import bayesmotion as bm

    model, recordings = mean_cycle.example()
    recordings = recordings.copy(deep=True)
    recordings["y"][20:24, 1] = float("nan")
    recordings["y"][41] = float("nan")
    method = bm.NUTS(draws=200, warmup=200, chains=4, max_tree_depth=6)
    return bm.fit(model, recordings, method=method, seed=0)


@pytest.fixture(scope="session")
def run() -> Callable:
    """Run the command line with words that may be of any kind."""
    from typer.testing import CliRunner

    from bayesmotion.cli import app

    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="session")
def refused() -> Callable:
    """Give the line in which a command told why it refused; notes may stand before it."""

    def told(result) -> str:
        assert result.exit_code == 2
        assert "Traceback" not in result.output
        lines = result.stderr.splitlines()
        assert all(line.startswith("bayesmotion: ") for line in lines)
        return lines[-1]

    return told


@pytest.fixture(scope="session")
def acted() -> Callable:
    """Make clips of people who do tasks: a posture of each person and a movement of each task.

    Their angles add up, all clips begin at the same moment of the movement, and repetitions
    differ by a little noise. Clips are called person-task-repetition.
    """
    from bayesmotion.motion import make_motion
    from bayesmotion.motion.joining import concat
    from bayesmotion.motion.segments import LEAVE_OUT
    from bayesmotion.motion.synthetic.anthropometry import adult_skeleton

    def make(people, tasks, repetitions=1, frames=36, label="task", seed=0):
        random = np.random.default_rng(seed)
        skeleton = adult_skeleton("body", 1.7)
        dofs = len(skeleton.dofs)
        # Joints that segments leave out stay at rest.
        moves = np.array([not any(w in dof for w in LEAVE_OUT) for dof in skeleton.dofs], float)
        phase = np.linspace(0.0, np.pi, frames)[:, None]
        posture = {person: 0.15 * random.normal(size=dofs) for person in people}
        movement = {task: 0.3 * random.normal(size=dofs) * np.sin(phase) for task in tasks}
        for task in tasks:
            movement[task] += 0.2 * random.normal(size=dofs) * np.cos(phase)
        clips = []
        for person in people:
            for task in tasks:
                for repetition in range(repetitions):
                    angle = posture[person] + movement[task]
                    angle = angle + 0.03 * random.normal(size=dofs)
                    clips.append(
                        make_motion(
                            skeleton, angle * moves, np.zeros((frames, 3)), frame_rate=30.0,
                            clip=f"{person}-{task}-{repetition}",
                            labels={"subject": person, label: task},
                        )
                    )  # fmt: skip
        return concat(clips)

    return make
