"""`poseloom live` and `simulate-device`: sessions with real or simulated devices."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.errors import PoseloomError, SensorError, unknown_name

if TYPE_CHECKING:
    from poseloom.live.contract import Sink
    from poseloom.live.session_plan import SessionPlan, SessionSummary
    from poseloom.live.setup import LiveSettings

NOTHING_USABLE = 3
"""Exit code of a session without a single usable sample."""
_CLOSING_EVERY = 1.0
"""Seconds between lines on files that take long to finish."""
_DEVICES = ("vmc", "udp", "udp-binary", "serial")


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("live")(live)
    app.command("simulate-device")(simulate_device)


def live(
    source: Annotated[
        list[str] | None,
        typer.Option(
            "--source",
            "-s",
            metavar="SPEC",
            help="Where samples come from: vmc[:[HOST:]PORT], udp[:[HOST:]PORT], serial:DEVICE, replay:FILE,"
            " simulate:CLIP; options behind commas (docs/live.md). May be repeated.",
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option("--method", "-m", help="How; with a library local-filter, else inverse-kinematics."),
    ] = None,
    library: Annotated[str | None, typer.Option("--library", "-l", help="Folder of a motion library.")] = None,
    model: Annotated[str | None, typer.Option("--model", help="A fitted model, from `poseloom fit`.")] = None,
    calibration: Annotated[
        str | None, typer.Option("--calibration", "-c", help="Sizes and placements, from `poseloom calibrate`.")
    ] = None,
    layout: Annotated[str | None, typer.Option(help="Layout of all sources together.")] = None,
    view: Annotated[bool | None, typer.Option("--view", help="Show the figure in a browser.")] = None,
    port: Annotated[int | None, typer.Option(help="The viewer's port.", min=0, max=65535)] = None,
    record: Annotated[str | None, typer.Option("--record", "-r", help="File to record to (.mcap).")] = None,
    send: Annotated[
        list[str] | None, typer.Option("--send", metavar="vmc:HOST:PORT", help="Send poses there. May be repeated.")
    ] = None,
    export: Annotated[
        str | None, typer.Option("--export", help="File for the motion at the end: .bvh, .glb, .npz or .csv.")
    ] = None,
    bind: Annotated[
        str | None,
        typer.Option(
            help="Address on which the viewer listens; 127.0.0.1 unless given. A source's own stands in the source:"
            " vmc:0.0.0.0:39539."
        ),
    ] = None,
    token: Annotated[
        str | None,
        typer.Option(
            help="Secret that the viewer's visitors must know, on this machine too; 'new' draws one.", metavar="SECRET"
        ),
    ] = None,
    folder: Annotated[
        str | None, typer.Option(help="Where recordings and calibrations go that are asked for in the viewer.")
    ] = None,
    seconds: Annotated[float | None, typer.Option(help="End after so many seconds.", min=0.0)] = None,
    config: Annotated[Path | None, typer.Option("--config", help="TOML file with the same as keys; flags win.")] = None,
) -> None:
    """Turn what sensors say into a moving figure, now. Exit code 3: not a single usable sample arrived.

    Example: poseloom live -s vmc -l library --view --record session.mcap --send vmc:127.0.0.1:39540
    """  # fmt: skip
    from poseloom.live.setup import make_settings, read_settings

    flags = {
        "source": None if source is None else tuple(source),
        "method": method,
        "library": library,
        "model": model,
        "calibration": calibration,
        "layout": layout,
        "view": view,
        "port": port,
        "record": record,
        "send": None if send is None else tuple(send),
        "export": export,
        "bind": bind,
        "token": token,
        "folder": folder,
        "seconds": seconds,
    }
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
    device: Annotated[str, typer.Argument(help=f"One of {', '.join(_DEVICES)}.", metavar="KIND")],
    clip: Annotated[str, typer.Argument(help="A motion file, or sample:NAME.")] = "sample:walk",
    to: Annotated[str, typer.Option(help="HOST:PORT to send to; for serial the name to give the line.")] = "",
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

    Example: poseloom simulate-device vmc sample:walk --to 127.0.0.1:39539
    """
    from dataclasses import replace

    from poseloom.live.devices import LineSpeaker, play, pseudo_terminal
    from poseloom.live.virtual import virtual_recording
    from poseloom.sensors import layout as layout_by_name
    from poseloom.synthesis import parse_fault

    if device not in _DEVICES:
        raise unknown_name("device", device, _DEVICES, SensorError)
    worn = layout_by_name(layout or ("flex-four" if device == "serial" else "six-trackers"))
    worn = replace(worn, rate=rate or (worn.rate if device == "serial" else 60.0))
    recording = virtual_recording(clip, worn, [parse_fault(text) for text in fault or ()], seed)
    try:
        if device == "serial":
            with pseudo_terminal(Path(to) if to else None) as (write, name):
                typer.echo(f"serial line {name}{f' as {to}' if to else ''}: {worn.rate:g} lines a second")
                play(recording, LineSpeaker(write), seconds)
        else:
            _send(device, to, recording, seconds)
    except KeyboardInterrupt:
        typer.echo("Ended.")


def _send(device: str, to: str, recording: object, seconds: float | None) -> None:
    from poseloom.live.devices import DatagramSpeaker, binary_datagram, json_datagram, play, vmc_datagram
    from poseloom.live.vmc import VMC_PORT
    from poseloom.live.wire import WIRE_PORT
    from poseloom.sensors import Recording

    assert isinstance(recording, Recording)
    encode = {"vmc": vmc_datagram, "udp": json_datagram, "udp-binary": binary_datagram}[device]
    host, _, port = (to or f"127.0.0.1:{VMC_PORT if device == 'vmc' else WIRE_PORT}").rpartition(":")
    if not host or not port.isdigit():
        raise PoseloomError(f"{to!r} is no HOST:PORT", remedy="Write --to 127.0.0.1:39539")
    typer.echo(f"{device} to {host}:{port}: {recording.layout.rate:g} samples a second")
    with DatagramSpeaker(host, int(port), encode) as speaker:
        play(recording, speaker, seconds)
        typer.echo(f"sent {speaker.sent} datagrams")
