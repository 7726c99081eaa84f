"""Takes the pictures of the viewer for the documents, in a real browser, into docs/images.

python scripts/photograph_viewer.py [--only live|take|phone]

Needs Chromium and the extra dev (playwright). Trackers are simulated on the built-in motions.
"""

import argparse
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, Playwright, sync_playwright

from poseloom.formats.recording import write_recording
from poseloom.library import build_library, open_library
from poseloom.live.contract import Stop
from poseloom.live.session import Session, SessionPlan
from poseloom.live.source_replay import ReplaySource
from poseloom.methods import make_method
from poseloom.samples import sample_motions
from poseloom.sensors import layout
from poseloom.skeleton.motion import make_motion
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_trackers
from poseloom.viewer.player import Player
from poseloom.viewer.session import SessionViewer
from poseloom.viewer.tracks import Wanted, load_take

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
sys.path.append(str(ROOT / "tests"))
from browsing import FLAGS, chromium  # noqa: E402  (the tests' own browser)

DESK, PHONE = (1280, 800), (390, 844)


@dataclass(frozen=True)
class Shot:
    """A picture to take.

    Attributes:
        name: Of the file in docs/images, without suffix.
        size: Of the window.
        button: That is there once the page is connected.
        tab: To be opened.
        seconds: To wait before.
    """

    name: str
    size: tuple[int, int]
    button: str
    tab: str = ""
    seconds: float = 6.0


def main() -> None:
    """Takes the pictures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", choices=("live", "take", "phone"))
    only = parser.parse_args().only
    with tempfile.TemporaryDirectory() as folder:
        if only in (None, "live"):
            photograph_session([Shot("viewer", DESK, "Record", "Signals")], Path(folder))
        if only in (None, "take", "phone"):
            shots = [
                Shot("viewer-take", DESK, "Play"),
                Shot("viewer-phone", PHONE, "Play"),
            ]
            wanted = {"take": shots[:1], "phone": shots[1:]}.get(only or "", shots)
            photograph_take(wanted, Path(folder))


def photograph_session(shots: list[Shot], folder: Path) -> None:
    """A live session on simulated trackers."""
    dance = resample(sample_motions()["dance_a"], 120.0)
    # There and back, for it is repeated and trackers that jump would be disbelieved; and slowly, for a browser that
    # draws without a graphics card leaves the method little time.
    motion = make_motion(dance.skeleton, np.concatenate([dance.q, dance.q[::-1]]), 40.0, "dance_a")
    recording = simulate_trackers(motion, layout("six-trackers"), seed=2)
    library = built_library(folder)
    viewer = SessionViewer(port=0, frame_rate=4.0)  # the browser draws without a graphics card
    plan = SessionPlan(
        sources=(ReplaySource(recording, "simulated trackers", loop=True),),
        layout=recording.layout,
        skeleton=recording.skeleton,
        placements=recording.placements,
        method="local-filter",
        make=lambda name: make_method(name, recording.layout, library),
        sinks=(viewer,),
        methods=("local-filter", "inverse-kinematics"),
        calibrated=True,
        folder=folder,
    )
    session = Session(plan)
    thread = threading.Thread(target=session.run)
    thread.start()
    try:
        for shot in shots:
            photograph(viewer.url, shot)
    finally:
        session.post(Stop())
        thread.join()


def photograph_take(shots: list[Shot], folder: Path) -> None:
    """A recording with its truth and two methods, at a moment of it."""
    motion = resample(sample_motions()["dance_a"], 40.0)
    recording = simulate_trackers(motion, layout("six-trackers"), seed=2)
    write_recording(recording, folder / "dance_a.mcap")
    built_library(folder)
    methods = ("local-filter", "inverse-kinematics")
    take = load_take([folder / "dance_a.mcap"], Wanted(methods, folder / "library"))
    player = Player(take, port=0)
    player.seek(3.1)
    try:
        for shot in shots:
            photograph(player.url, shot)
    finally:
        player.close()


def built_library(folder: Path):
    """A library of the built-in motions without the one that is shown."""
    if not (folder / "library").exists():
        build_library(["samples"], folder / "library", mirror=True, exclude=("*dance_a*",))
    return open_library(folder / "library")


def photograph(url: str, shot: Shot) -> None:
    """Opens the page in a new browser and keeps what is seen."""
    with tempfile.TemporaryDirectory() as profile, sync_playwright() as playwright:
        page = opened_page(playwright, Path(profile), url, shot.size, shot.button)
        if shot.tab:
            page.get_by_role("tab", name=shot.tab).click()
        page.wait_for_timeout(1000 * shot.seconds)
        page.screenshot(path=IMAGES / f"{shot.name}.png")
        page.context.close()


def opened_page(playwright: Playwright, profile: Path, url: str, size: tuple[int, int], button: str) -> Page:
    """The viewer's page in a new browser, once a button of this name is there."""
    browser = playwright.chromium.launch_persistent_context(
        profile,
        executable_path=chromium(),
        args=FLAGS,
        viewport={"width": size[0], "height": size[1]},
    )
    page = browser.pages[0]
    page.set_default_timeout(120_000)
    page.goto(url)
    page.get_by_role("button", name=button).first.wait_for()
    page.locator("#webgl-software-rendering button").click()
    return page


if __name__ == "__main__":
    main()
