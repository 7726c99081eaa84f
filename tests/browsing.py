"""A real browser for tests: Chromium on the software renderer, and what it showed and complained of."""

import importlib.util
import io
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def chromium() -> str:
    """A Chromium on this machine; skips where there is none."""
    if importlib.util.find_spec("playwright") is None:
        pytest.skip("playwright is not installed (the extra dev has it)")
    for name in ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable"):
        if found := shutil.which(name):
            return found
    pytest.skip("no chromium on this machine")


class Visit:
    """A page of the viewer's.

    Args:
        page: Playwright's.
    """

    def __init__(self, page: Any) -> None:
        self.page = page
        page.set_default_timeout(90_000)  # of a machine on which much else runs
        self.complaints: list[str] = []
        page.on("console", lambda m: self.complaints.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))

    def open(self, url: str, button: str) -> None:
        """Goes to the page and waits until it is connected: a button of that name is there."""
        self.page.goto(url)
        self.page.get_by_role("button", name=button).first.wait_for()
        warning = self.page.locator("#webgl-software-rendering button")
        if warning.count():
            warning.click()

    def pixels(self) -> np.ndarray:
        """What is seen, as (rows, columns, 3) numbers."""
        from PIL import Image

        picture = Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")
        return np.asarray(picture).astype(np.int64)

    def scene(self) -> np.ndarray:
        """What is seen of the scene: the page less its panel."""
        left, top = self.panel()
        pixels = self.pixels()
        return pixels[:top] if top > 0 else pixels[:, :left]

    def panel(self) -> tuple[int, int]:
        """Left and upper edge of the panel: beside the scene its upper edge is the page's."""
        box = self.page.evaluate(
            """() => {
                const scene = document.querySelector("canvas");
                if (!scene) return [window.innerWidth, 0];  // the page is being laid out anew
                const canvas = scene.getBoundingClientRect();
                if (canvas.width < window.innerWidth) return [canvas.right, 0];
                let node = [...document.querySelectorAll("button")].at(-1);
                while (node && getComputedStyle(node).position !== "fixed") node = node.parentElement;
                if (!node) return [window.innerWidth, 0];
                const panel = node.getBoundingClientRect();
                return [panel.left, panel.top];
            }"""
        )
        return round(box[0]), round(box[1])

    def until(self, what: Callable[[], bool], seconds: float = 90.0) -> None:
        """Waits for something, on a slow machine for long; fails if it does not come.

        A failure leaves what was seen in the folder POSELOOM_PICTURES, if that is set.
        """
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if what():
                return
            self.page.wait_for_timeout(100)
        if folder := os.environ.get("POSELOOM_PICTURES"):
            self.page.screenshot(path=Path(folder) / f"failed-{time.time():.0f}.png")
        raise AssertionError("what was waited for has not come")


def open_browser(playwright: Any, profile: Path, width: int, height: int) -> Any:
    """A browser with a profile of its own; its one page is `pages[0]`."""
    return playwright.chromium.launch_persistent_context(
        profile, executable_path=chromium(), args=FLAGS, headless=True, viewport={"width": width, "height": height}
    )
