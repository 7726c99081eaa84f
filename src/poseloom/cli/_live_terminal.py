"""The session in the terminal: one line that goes on, and what a person should know above it."""

import time
from collections.abc import Iterable

from rich.console import Console
from rich.live import Live
from rich.text import Text

from poseloom.live.contract import Level, Notice, Post, SessionFacts, Update

_EVERY = 0.25
"""Seconds between lines: reading them costs the eye, and writing them the session."""
_EVERY_WITHOUT_TERMINAL = 5.0
_STYLES = {Level.NOTE: "", Level.WARNING: "yellow", Level.ERROR: "bold red"}


class TerminalSink:
    """Shows a session on a console.

    Args:
        console: Where to.
    """

    name = "terminal"
    capacity = 1

    def __init__(self, console: Console) -> None:
        self._console = console
        self._told = 0
        self._shown = float("-inf")
        self._live: Live | None = None

    def open(self, facts: SessionFacts, post: Post) -> None:
        """See `Sink`."""
        self._facts = facts
        self._console.print(
            f"{facts.method} on {facts.layout.name} at {facts.layout.rate:g} Hz, from {'; '.join(facts.sources)}. "
            "Ctrl-C ends it.",
            highlight=False,
            soft_wrap=True,
        )
        if self._console.is_terminal:
            self._live = Live(Text("waiting for samples"), console=self._console, auto_refresh=False)
            self._live.start()

    def changed(self, facts: SessionFacts) -> None:
        """See `Sink`."""
        self._facts = facts
        self._tell(facts.notices)

    def show(self, update: Update) -> None:
        """See `Sink`."""
        self._tell(update.notices)
        now = time.monotonic()
        if now - self._shown < (_EVERY if self._live else _EVERY_WITHOUT_TERMINAL):
            return
        self._shown = now
        line = status_line(update, self._facts)
        if self._live is None:
            self._console.print(line, soft_wrap=True)
        else:
            self._live.update(line, refresh=True)

    def _tell(self, notices: Iterable[Notice]) -> None:
        for notice in notices:
            if notice.number > self._told:
                self._told = notice.number
                self._console.print(Text(notice.text, style=_STYLES[notice.level]), soft_wrap=True)

    def close(self) -> None:
        """See `Sink`."""
        if self._live is not None:
            self._live.stop()


def status_line(update: Update, facts: SessionFacts) -> Text:
    """The session's state in one line."""
    counters, latency, frame = update.counters, update.latency, update.frame
    line = Text()
    health = "no pose yet" if frame is None else frame.health.state.value
    line.append(f"{health:<9}", style="green" if health == "ok" else "yellow")
    line.append(f" {counters.rate:5.1f} Hz, {latency.p50:.1f} ms (p95 {latency.p95:.1f})")
    dropped = counters.dropped + counters.lost
    if dropped:
        line.append(f", {dropped} dropped", style="yellow")
    if counters.malformed or counters.stale:
        line.append(f", {counters.malformed} malformed, {counters.stale} late")
    if facts.recording is not None:
        line.append(f", recording {facts.recording.name}", style="red")
    progress = update.calibration
    if progress is not None:
        line.append(f" | {progress.phase}: {progress.title}, {progress.remaining:.0f} s", style="bold cyan")
    for finding in update.findings:
        line.append(f" | {finding.sensor} {finding.trouble.value}", style="bold yellow")
    return line
