"""A real browser, and what is watched in it."""

import shutil
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import bayesmotion as bm

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
# Drawing without a graphics card.
FLAGS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox",
         "--autoplay-policy=no-user-gesture-required"]  # fmt: skip


@dataclass
class Seen:
    """A page in a browser.

    page
        As Playwright has it.
    errors
        What its console complained of.
    requests
        What it asked the network for: all but itself, and data that it holds.
    """

    page: object
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def picture(self, of: str = "#scene") -> np.ndarray:
        """Return (height, width, 3) pixels of a part of the page."""
        taken = self.page.locator(of).screenshot()
        return np.asarray(Image.open(BytesIO(taken)).convert("RGB")).astype(int)

    def state(self, name: str) -> object:
        """Return a value of the player's state."""
        return self.page.evaluate("name => window.player.state()[name]", name)

    def run(self, script: str) -> object:
        """Run a script, and wait until it is drawn."""
        found = self.page.evaluate(script)
        self.page.evaluate(
            "() => new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))"
        )
        return found


@pytest.fixture(scope="session")
def browser() -> Iterator[object]:
    """A Chromium without a window: Playwright's own, or one that is installed."""
    reason = "a browser is needed: apt install chromium-headless-shell, or playwright install"
    playwright = pytest.importorskip("playwright.sync_api", reason=reason)
    with playwright.sync_playwright() as driver:
        own = Path(driver.chromium.executable_path)
        found = str(own) if own.exists() else next(filter(None, map(shutil.which, NAMES)), None)
        if found is None:
            pytest.skip(reason)
        browser = driver.chromium.launch(executable_path=found, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def see(browser) -> Iterator[Callable[..., Seen]]:
    """Open files in the browser, each in a page of its own."""
    contexts = []

    def opened(path: Path, width: int = 800, height: int = 600, scheme: str = "light") -> Seen:
        context = browser.new_context(
            viewport={"width": width, "height": height}, color_scheme=scheme
        )
        contexts.append(context)
        seen = Seen(context.new_page())
        seen.page.on("console", lambda m: m.type == "error" and seen.errors.append(m.text))
        seen.page.on("pageerror", lambda error: seen.errors.append(str(error)))

        def asked(request) -> None:
            if not request.url.startswith(("file:", "data:", "blob:", "about:")):
                seen.requests.append(request.url)

        seen.page.on("request", asked)
        seen.page.goto(path.as_uri())
        return seen

    yield opened
    for context in contexts:
        context.close()


@pytest.fixture
def play(see) -> Callable[..., Seen]:
    """Open a player, and wait until it has unpacked what it shows."""

    def ready(path: Path, **how: object) -> Seen:
        seen = see(path, **how)
        seen.page.wait_for_function("document.documentElement.dataset.ready")
        assert seen.page.evaluate("document.documentElement.dataset.ready") == "yes"
        return seen

    return ready


@pytest.fixture
def shot(request) -> Callable[[Seen, str], None]:
    """Keep a picture of a page for the documentation, with `--screenshots FOLDER`."""
    folder = request.config.getoption("--screenshots")

    def keep(seen: Seen, name: str) -> None:
        if folder is not None:
            seen.page.screenshot(path=folder / f"{name}.png")

    return keep


@pytest.fixture(scope="session")
def walks():
    """Two people in two gaits."""
    return bm.synthetic_walkers(("ann", "ben"), ("walk", "run"), seconds=1.2, frame_rate=15.0)


@pytest.fixture(scope="session")
def fit(walks, pytestconfig):
    """A search of all clips but one; whether it converged is shown on pictures alone."""
    steps = 100 if pytestconfig.getoption("--screenshots") is None else 1000
    known = walks.isel(frame=walks["clip"].values != "ben-run")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bm.MotionWarning)
        return bm.fit(
            bm.Multifactor(unknown_draws=0),
            known,
            method=bm.MAP(max_steps=steps, initial=1),
            seed=0,
        )


@pytest.fixture(scope="session")
def future(fit, walks):
    """A forecast of the other one, with draws."""
    clip = bm.split(walks)["ben-run"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bm.MotionWarning)
        return bm.forecast(fit, clip, context=8, horizon=10, samples=12)
