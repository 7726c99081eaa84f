"""Measures what the viewer costs a live session, and whether twenty reloads of the page leave anything behind.

python scripts/measure_viewer.py [--seconds 20] [--reloads 20]

Needs Chromium and the extra dev (playwright). Six simulated trackers at 60 Hz, inverse kinematics, one visitor.
"""

import argparse
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from photograph_viewer import DESK, opened_page
from playwright.sync_api import sync_playwright

from poseloom.benchmark.memory import resident_memory
from poseloom.live.contract import Post, SessionFacts, Stop, Update
from poseloom.live.session import Session, SessionPlan
from poseloom.live.source_replay import ReplaySource
from poseloom.methods import make_method
from poseloom.samples import sample_motions
from poseloom.sensors import layout
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_trackers
from poseloom.viewer.session import SessionViewer

RATE = 60.0


@dataclass
class Timed:
    """A viewer whose work is timed.

    Attributes:
        viewer: The viewer.
        spent: Processor time of each call that drew, seconds.
        kept: Of each that did not.
    """

    viewer: SessionViewer
    spent: list[float] = field(default_factory=list[float])
    kept: list[float] = field(default_factory=list[float])
    name: str = "viewer"
    capacity: int = 1

    def open(self, facts: SessionFacts, post: Post) -> None:
        """See `Sink`."""
        self.viewer.open(facts, post)

    def changed(self, facts: SessionFacts) -> None:
        """See `Sink`."""
        self.viewer.changed(facts)

    def show(self, update: Update) -> None:
        """See `Sink`."""
        drawn, begin = self.viewer.frames, time.thread_time()
        self.viewer.show(update)
        (self.spent if self.viewer.frames > drawn else self.kept).append(time.thread_time() - begin)

    def close(self) -> None:
        """See `Sink`."""
        self.viewer.close()


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--reloads", type=int, default=20)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        alone = with_session(lambda _sink, _session: time.sleep(asked.seconds), viewed=False)
        print(f"without a viewer: a pose after {alone} ms (median, 95 %, 99 %)")

        def look(sink: Timed, session: Session) -> None:
            page = opened_page(playwright, Path(folder), sink.viewer.url, DESK, "Record")
            time.sleep(asked.seconds)
            cost, idle = np.percentile(1e3 * np.array(sink.spent), [50, 95, 99]), np.median(1e3 * np.array(sink.kept))
            print(
                f"a drawn pose: {cost.round(2)} ms of one core (median, 95 %, 99 %); one that is not drawn: {idle:.3f}"
            )
            reload_often(page, sink, asked.reloads)

        print(f"with the viewer: a pose after {with_session(look)} ms")


def reload_often(page: object, sink: Timed, reloads: int) -> None:
    """Loads the page again and again, and tells what of each visit is left."""
    before = resident_memory()
    for turn in range(reloads):
        page.reload()  # type: ignore[attr-defined]
        page.get_by_role("button", name="Record").first.wait_for()  # type: ignore[attr-defined]
        if turn + 1 in (1, reloads // 2, reloads):
            time.sleep(1.0)
            server = sink.viewer._server.viser
            print(
                f"after {turn + 1} reloads: {resident_memory() - before:+.1f} MB, {threading.active_count()} threads, "
                f"{len(server.get_clients())} visitor, "
                f"{len(server._websock_server._broadcast_buffer.message_from_id)} messages kept"
            )


def with_session(during: Callable[[Timed, Session], None], viewed: bool = True) -> np.ndarray:
    """Runs a session while something is done; returns its latency, milliseconds."""
    recording = simulate_trackers(
        resample(sample_motions()["dance_a"], RATE), replace(layout("six-trackers"), rate=RATE), seed=2
    )
    sink = Timed(SessionViewer(port=0))
    plan = SessionPlan(
        sources=(ReplaySource(recording, "simulated trackers", loop=True),),
        layout=recording.layout,
        skeleton=recording.skeleton,
        placements=recording.placements,
        method="inverse-kinematics",
        make=lambda name: make_method(name, recording.layout),
        sinks=(sink,) if viewed else (),
    )
    session, found = Session(plan), []
    thread = threading.Thread(target=lambda: found.append(session.run()))
    thread.start()
    try:
        during(sink, session)
    finally:
        session.post(Stop())
        thread.join()
        if not viewed:
            sink.close()
    return np.round(found[0].latency, 2)


if __name__ == "__main__":
    main()
