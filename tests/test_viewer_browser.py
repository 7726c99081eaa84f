"""The viewer in a real browser: a live session fed from another process, and recordings played."""

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from browsing import Visit, chromium, open_browser
from poseloom.formats.recording import read_recording
from poseloom.live.contract import Stop
from poseloom.live.readings import Packet, Reading
from poseloom.live.session import Session, SessionPlan
from poseloom.live.sources_network import DatagramSource
from poseloom.live.wire import encode_json
from poseloom.methods import make_method
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, layout
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_trackers
from poseloom.viewer.player import Player
from poseloom.viewer.session import SessionViewer
from poseloom.viewer.tracks import Take, track_of

pytestmark = pytest.mark.xdist_group("viewer in a browser")
"""The tests share one browser and go on from one to the next."""

RATE, DESK = 40.0, (720, 420)

TRACKERS = """
import socket, sys, time
port, lines = int(sys.argv[1]), open(sys.argv[2], "rb").read().splitlines(True)
sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
begin, count = time.monotonic(), 0
while True:
    text = lines[count % len(lines)].replace(b'"time": 0.0', b'"time": %.4f' % (count / 40.0))
    sender.sendto(text, ("127.0.0.1", port))
    count += 1
    time.sleep(max(0.0, begin + count / 40.0 - time.monotonic()))
"""
"""Trackers that know nothing of poseloom: they send lines of text to a port, 40 a second, over and over."""


@pytest.fixture(scope="module")
def dance() -> Recording:
    return simulate_trackers(resample(sample_motions()["kick"], RATE), layout("six-trackers"), seed=3)


def spoken(recording: Recording) -> bytes:
    """A recording as lines that trackers send, there and back so that it can be repeated without a jump."""
    lines = []
    for index in [*range(len(recording)), *range(len(recording) - 1, -1, -1)]:
        sample = recording.sample(index)
        readings = {
            name: Reading(tuple(map(float, sample.positions[i])), tuple(map(float, sample.quats_wxyz[i])))
            for i, name in enumerate(recording.layout.names)
        }
        lines.append(encode_json(Packet(readings, 0.0)))
    return b"".join(lines)


class Live:
    """A session with a viewer, and trackers in another process."""

    def __init__(self, recording: Recording, folder: Path) -> None:
        source = DatagramSource(recording.layout, port=0)
        self.viewer = SessionViewer(port=0, frame_rate=6.0)  # the browser draws without a graphics card
        self.viewer._stage.shadows(False)
        plan = SessionPlan(
            sources=(source,),
            layout=recording.layout,
            skeleton=recording.skeleton,
            placements=recording.placements,
            method="inverse-kinematics",
            make=lambda _name: make_method("inverse-kinematics", recording.layout),
            sinks=(self.viewer,),
            methods=("inverse-kinematics", "the same again"),
            folder=folder,
        )
        self.session = Session(plan)
        self.thread = threading.Thread(target=self.session.run, daemon=True)
        self.thread.start()
        deadline = time.monotonic() + 120.0
        while source.port == 0 and self.thread.is_alive() and time.monotonic() < deadline:
            time.sleep(0.01)
        assert source.port, "the session has not begun"
        text = folder / "trackers.txt"
        text.write_bytes(spoken(recording))
        self.trackers = subprocess.Popen([sys.executable, "-c", TRACKERS, str(source.port), str(text)])

    def close(self) -> None:
        self.trackers.kill()
        self.trackers.wait()
        self.session.post(Stop())
        self.thread.join(10)


@pytest.fixture(scope="module")
def live(dance: Recording, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    chromium()
    session = Live(dance, tmp_path_factory.mktemp("session"))
    yield session
    session.close()


@pytest.fixture(scope="module")
def visit(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visit]:
    chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = open_browser(playwright, tmp_path_factory.mktemp("profile"), *DESK)
        yield Visit(browser.pages[0])
        browser.close()


def skin(pixels: np.ndarray) -> np.ndarray:
    """Where the blue of the figure is."""
    return (pixels[..., 2] > pixels[..., 0] + 70) & (pixels[..., 2] > 90)


def bounds(mask: np.ndarray) -> tuple[int, int, int, int]:
    """First and last row and column of a figure; the thin line of its trail does not count."""
    rows, columns = np.flatnonzero(mask.sum(axis=1) > 4), np.flatnonzero(mask.sum(axis=0) > 9)
    return int(rows[0]), int(rows[-1]), int(columns[0]), int(columns[-1])


def stands_well(seen: np.ndarray) -> bool:
    """Whether the figure is upright, whole, large and in the middle."""
    mask = skin(seen)
    if mask.sum() < 3000:
        return False
    top, bottom, left, right = bounds(mask)
    rows, columns = mask.shape
    whole = top > 0 and bottom < rows - 1 and left > 0 and right < columns - 1
    upright = bottom - top > max(0.5 * rows, 1.2 * (right - left))
    return whole and upright and abs(0.5 * (left + right) - 0.5 * columns) < 0.15 * columns


def test_trackers_in_another_process_move_the_figure(live: Live, visit: Visit):
    visit.open(live.viewer.url, "Reset heading")
    # The figure all in its own colour, and nothing else of that colour.
    visit.page.get_by_role("tab", name="View").click()
    visit.page.get_by_role("checkbox", name="Doubt as colour").click()
    visit.page.get_by_role("checkbox", name="Trail").click()
    visit.until(lambda: stands_well(visit.scene()))
    first = visit.scene()
    top, bottom, left, right = bounds(skin(first))
    visit.until(lambda: (np.abs(visit.scene() - first)[top:bottom, left:right].sum(axis=-1) > 60).mean() > 0.02)
    assert visit.page.get_by_text("samples/s").count() == 1
    assert visit.complaints == []


def test_buttons_reach_the_session(live: Live, visit: Visit):
    page, session = visit.page, live.session
    page.get_by_role("button", name="Record").click()
    visit.until(lambda: session.facts.recording is not None)
    recorded = session.facts.recording
    page.get_by_role("button", name="Reset heading").click()
    visit.until(lambda: any("heading reset" in notice.text for notice in session.notices))
    page.get_by_role("button", name="Stop recording").click()
    visit.until(lambda: session.facts.recording is None)
    page.get_by_role("button", name="Record", exact=True).wait_for()
    assert recorded is not None
    assert len(read_recording(recorded)) > 5
    page.get_by_role("button", name="Eight poses").click()
    page.get_by_text("Pose 1 of 8").wait_for()
    page.get_by_text("Stand straight, arms straight out to the sides").wait_for()
    visit.until(lambda: greenish(visit.scene()).sum() > 500)
    page.get_by_role("button", name="Cancel calibration").click()
    page.get_by_role("button", name="Reset heading").wait_for()
    visit.until(lambda: greenish(visit.scene()).sum() < 300)
    assert visit.complaints == []


def greenish(pixels: np.ndarray) -> np.ndarray:
    """Where the green of the guide is."""
    return (pixels[..., 1] > pixels[..., 0] + 50) & (pixels[..., 1] > pixels[..., 2] + 10)


def test_another_method_can_be_chosen(live: Live, visit: Visit):
    page = visit.page
    page.get_by_role("tab", name="Session").click()
    page.get_by_role("combobox", name="Method").or_(page.locator("input[value='inverse-kinematics']")).first.click()
    page.get_by_role("option", name="the same again").click()
    visit.until(lambda: live.session.facts.method == "the same again")
    page.get_by_role("tab", name="Signals").click()
    page.get_by_text("latency, ms").wait_for()
    assert visit.complaints == []


def test_on_a_phone_the_panel_does_not_cover_the_figure(live: Live, visit: Visit):
    visit.page.set_viewport_size({"width": 390, "height": 844})

    def is_free() -> bool:
        seen, top = visit.pixels(), visit.panel()[1]
        mask = skin(seen[:top])
        if top < 300 or mask.sum() < 800:
            return False
        first, last, left, right = bounds(mask)
        return first > 2 and last < top - 10 and left > 2 and right < 387 and last - first > 150

    try:
        visit.until(is_free)
    finally:
        visit.page.set_viewport_size(dict(zip(("width", "height"), DESK, strict=True)))
    visit.page.get_by_role("tab", name="View").wait_for()
    assert visit.complaints == []


def test_reloading_leaves_nobody_behind(live: Live, visit: Visit):
    server = live.viewer._server.viser
    visit.open(live.viewer.url, "Reset heading")
    visit.until(lambda: len(server._websock_server._client_state_from_id) == 1 and len(server.get_clients()) == 1)
    assert len(server._websock_server._broadcast_buffer.generator_cursors) <= 1
    assert [text for text in visit.complaints if "WebSocket" not in text] == []


def test_the_session_ends_when_it_is_asked_to(live: Live, visit: Visit):
    page = visit.page
    page.get_by_role("tab", name="Session").click()
    page.get_by_role("button", name="End session").click()
    page.get_by_role("button", name="Go on").click()
    assert live.thread.is_alive()
    page.get_by_role("button", name="End session").click()
    page.get_by_role("button", name="End it").click()
    visit.until(lambda: not live.thread.is_alive())


def test_a_take_is_played_and_scrubbed(visit: Visit):
    walk = sample_motions()["walk"]
    tracks = (track_of("walk", (138, 143, 156), walk), track_of("ahead", (0, 114, 178), walk.cut(18, len(walk))))
    player = Player(Take("two", tracks, False, None, walk.duration), port=0)
    player._stage.shadows(False)
    try:
        page = visit.page
        page.goto("about:blank")
        visit.complaints.clear()
        visit.open(player.url, "Play")
        visit.until(lambda: skin(visit.scene()).sum() > 1000)
        scene = visit.scene()
        # Side by side: the second figure stands in the right half.
        assert np.median(np.nonzero(skin(scene))[1]) > 0.58 * scene.shape[1]
        page.get_by_text("0.25 ×").click()  # slow, so that it does not end on a slow machine before it is paused
        page.get_by_role("button", name="Play").click()
        visit.until(lambda: player.moment > 0.1)
        page.get_by_role("button", name="Pause").click()
        page.get_by_role("button", name="Play").wait_for()
        stopped = player.moment
        number = page.locator(".mantine-NumberInput-input").first
        number.fill("0.5")
        number.press("Enter")
        visit.until(lambda: player.moment == pytest.approx(0.5))
        assert player.moment != stopped
        page.wait_for_timeout(400)
        before = visit.scene()
        number.fill("0.9")
        number.press("Enter")
        visit.until(lambda: (np.abs(visit.scene() - before).sum(axis=-1) > 60).mean() > 0.005)
        page.get_by_role("tab", name="View").click()
        page.get_by_role("checkbox", name="Side by side").click()
        visit.until(lambda: np.median(np.nonzero(skin(visit.scene()))[1]) < 0.55 * scene.shape[1])
        assert visit.complaints == []
    finally:
        player.close()
