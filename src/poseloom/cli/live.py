"""`poseloom live` and `simulate-device`: sessions with real or simulated devices."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._settings_options import with_settings

if TYPE_CHECKING:
    from poseloom.live.contract import Sink
    from poseloom.live.session_plan import SessionPlan, SessionSummary
    from poseloom.live.settings import LiveSettings

NOTHING_USABLE = 3
"""Exit code of a session without a single usable sample."""
_CLOSING_EVERY = 1.0
"""Seconds between lines on files that take long to finish."""


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("live")(live)
    app.command("simulate-device")(simulate_device)


@with_settings
def live(
    config: Annotated[
        Path | None, typer.Option("--config", help="TOML file with the same as keys; options win.", metavar="FILE")
    ] = None,
    **flags: object,
) -> None:
    """Turn what sensors say into a moving figure, now. Exit code 3: not a single usable sample arrived.

    Example: poseloom live -s vmc://:39539 -l library --view --record session.mcap --send vmc://127.0.0.1:39540
    """  # fmt: skip
    from poseloom.live.settings import make_settings, read_settings

    summary = run_live(make_settings(flags) if config is None else read_settings(config, flags))
    if summary.counters.usable == 0:
        raise typer.Exit(NOTHING_USABLE)


def run_live(settings: "LiveSettings") -> "SessionSummary":
    """Runs a session with its terminal and, if asked for, its viewer, until it ends or Ctrl-C is pressed."""
    from rich.console import Console

    from poseloom.cli._live_terminal import TerminalSink
    from poseloom.live.setup import plan_session

    console = Console()
    sinks: list[Sink] = []
    if settings.view:
        from poseloom.viewer.session import SessionViewer

        viewer = SessionViewer(settings.bind, settings.port or None, token=settings.token)
        console.print(f"Open {viewer.url} in a browser.", highlight=False, soft_wrap=True)
        if viewer.exposure:
            console.print(viewer.exposure, style="yellow", highlight=False, soft_wrap=True)
        sinks.append(viewer)
    console.print("Getting ready ...", highlight=False)
    summary = _run(plan_session(settings, (*sinks, TerminalSink(console))), console)
    with contextlib.suppress(OSError):  # a terminal that was closed
        _tell(console, summary)
    if summary.failures:
        raise typer.Exit(1)
    return summary


def _run(plan: "SessionPlan", console: object) -> "SessionSummary":
    """Runs a plan; Ctrl-C ends it in order, a second one at once, and so does what ends a program from outside."""
    import signal

    from poseloom.live.responsiveness import responsive_process
    from poseloom.live.session import Session

    session = Session(plan)

    def end(number: int, frame: object) -> None:
        if number == signal.SIGINT:
            signal.signal(number, before[number])
        session.stop()

    # A terminal that is closed says so by SIGHUP, maybe several times; a system without a signal has no name for it.
    # Who runs this with nohup has asked that a closed terminal end nothing.
    known = {name: getattr(signal, name, None) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")}
    if known["SIGHUP"] is not None and signal.getsignal(known["SIGHUP"]) is signal.SIG_IGN:
        del known["SIGHUP"]
    before = {int(number): signal.signal(number, end) for number in known.values() if number is not None}
    try:
        with responsive_process():
            return session.run(_Closing(console))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Closing:
    """Says how far files are that take long to finish."""

    def __init__(self, console: object) -> None:
        self._console = console
        self._told = 0.0

    def __call__(self, what: str, waiting: int) -> None:
        import time

        from rich.console import Console

        assert isinstance(self._console, Console)
        now = time.monotonic()
        if now - self._told >= _CLOSING_EVERY:
            self._told = now
            left = f", {waiting:,} to go" if waiting else ""
            self._console.print(f"Finishing: {what}{left} ...", highlight=False, soft_wrap=True)


def _tell(console: object, summary: "SessionSummary") -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    assert isinstance(console, Console)
    counters = summary.counters
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("samples", f"{counters.samples:,} in {summary.seconds:.1f} s, {counters.filled:,} of them empty")
    table.add_row("poses", f"{counters.frames:,}")
    lost = (
        f"{counters.dropped} passed over for newer ones, {counters.superseded} beyond the rate, {counters.lost} lost, "
        f"{counters.stale} late or twice, {counters.malformed} malformed"
    )
    table.add_row("not used", lost)
    for reason, count in summary.refused.items():
        table.add_row("", Text(f"{count:,} times {reason}"))
    p50, p95, p99 = summary.latency
    table.add_row("arrival to pose sent", f"p50 {p50:.1f}, p95 {p95:.1f}, p99 {p99:.1f} ms")
    for path in summary.recordings:
        table.add_row("recorded", str(path))
    for path in summary.exports:
        table.add_row("exported", str(path))
    console.print(table)
    if counters.usable == 0:
        console.print(
            f"Not a single usable sample has arrived: {summary.arrivals}.",
            style="bold red",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
    for text in summary.failures:
        console.print(f"NOT KEPT: {text}", style="bold red", highlight=False, soft_wrap=True, markup=False)


def simulate_device(
    to: Annotated[
        str,
        typer.Argument(
            help="Whom to speak to, and how: vmc://HOST:PORT, udp://HOST:PORT (?binary=1 for the binary form), or"
            " serial:///PATH, a name for the line; serial:// leaves it unnamed.",
            metavar="URL",
        ),
    ],
    clip: Annotated[str, typer.Argument(help="A motion file, or sample:NAME.")] = "sample:walk",
    layout: Annotated[str | None, typer.Option(help="Which sensors are worn.")] = None,
    rate: Annotated[float | None, typer.Option(help="Samples a second.", min=1.0)] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="KIND:SENSOR:START:STOP", help="A fault, each time the clip is played. May be repeated."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all that is drawn.", min=0)] = 0,
    seconds: Annotated[float | None, typer.Option(help="End after so many seconds.")] = None,
) -> None:
    """Stand in for a device: speak its protocol to a session in another process, over and over.

    Example: poseloom simulate-device vmc://127.0.0.1:39539 sample:walk
    """
    from dataclasses import replace

    from poseloom.live.device_addresses import open_device
    from poseloom.live.devices import play
    from poseloom.live.virtual import virtual_recording
    from poseloom.sensors import layout as layout_by_name
    from poseloom.synthesis import parse_fault

    device = open_device(to)
    worn = layout_by_name(layout or device.layout)
    worn = replace(worn, rate=rate or device.rate or worn.rate)
    recording = virtual_recording(clip, worn, [parse_fault(text) for text in fault or ()], seed)
    try:
        with device.speaker() as (speaker, told):
            typer.echo(f"{told}: {worn.rate:g} samples a second")
            said = play(recording, speaker, seconds)
            typer.echo(f"sent {said} samples")
    except KeyboardInterrupt:
        typer.echo("Ended.")
