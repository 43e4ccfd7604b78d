"""A headless Chromium that draws WebGL in software, and a page in it that notes its faults."""

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
NAMES = ("chromium", "chromium-browser", "google-chrome")
PATIENCE = 120_000.0  # ms: software WebGL on a machine that others load
# a screenshot of software WebGL is slow, which Chromium finds worth a warning
SOFTWARE = "ReadPixels"


@contextmanager
def chromium() -> Iterator[Any]:
    """The browser; skips, with the reason, where there is none."""
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    api = pytest.importorskip(
        "playwright.sync_api", reason="playwright is not installed: pip install -e '.[test]'"
    )
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


class Tab:
    """A page of its own, with all that it said and asked for."""

    def __init__(
        self, browser: Any, address: str, size: tuple[int, int], *, script: str = "", **context: Any
    ):
        settings = {"reduced_motion": "reduce", "color_scheme": "light"} | context
        self.context = browser.new_context(
            viewport={"width": size[0], "height": size[1]}, **settings
        )
        self.page = self.context.new_page()
        self.page.set_default_timeout(PATIENCE)
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda message: self._note(message.type, message.text))
        self.page.on("pageerror", lambda error: self.said.append(f"error: {error}"))
        self.page.on(
            "dialog",
            lambda dialog: (self.said.append(f"dialog: {dialog.message}"), dialog.dismiss()),
        )
        self.page.on("request", lambda request: self.asked.append(request.url))
        if script:
            self.page.add_init_script(script)
        self.page.goto(address)

    def run(self, body: str, argument: Any = None) -> Any:
        """The value of a JavaScript function body; `it` is the argument, `replay` the page's."""
        replay = "const replay = document.querySelector('#replay, [id^=dronecombat]').replay;"
        return self.page.evaluate(f"(it) => {{ {replay} {body} }}", argument)

    def wait(self, body: str, seconds: float = 60.0) -> None:
        """Until the function body is true. Playwright's own waiting evaluates text: forbidden."""
        deadline = time.monotonic() + seconds
        while not self.run(body):
            assert time.monotonic() < deadline, body
            time.sleep(0.05)

    def settle(self) -> None:
        """Wait until a picture has been drawn after all that was asked for."""
        self.page.evaluate(
            "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    def close(self) -> None:
        """End the page; it must have asked for nothing but itself, and have complained of nothing."""
        self.context.close()
        assert [url for url in self.asked[1:] if not url.startswith("data:")] == []
        assert self.said == [], self.said

    def _note(self, kind: str, text: str) -> None:
        if kind in ("error", "warning") and SOFTWARE not in text:
            self.said.append(f"{kind}: {text}")
