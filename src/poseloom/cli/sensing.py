"""`poseloom simulate`: virtual sensors on a motion, recorded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from poseloom.cli._motion_options import RestPose, SourceRate, Unit, Up, motion_choices, tell_conventions
from poseloom.errors import PoseloomError, SensorError

if TYPE_CHECKING:
    from poseloom.sensors import Recording
    from poseloom.skeleton.motion import Motion


def register(app: typer.Typer) -> None:
    """Adds `simulate` to the application."""
    app.command("simulate")(simulate)


_TRACKERS, _IMUS, _FLEX, _ALL = "Trackers", "IMUs", "Flex sensors", "All sensors"


def _option(panel: str, text: str) -> Any:
    return typer.Option(help=text, rich_help_panel=panel)


def simulate(
    clip: Annotated[str, typer.Argument(help="A motion file, or sample:NAME for a built-in sample motion.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording to write, an .mcap file.")],
    layout: Annotated[
        str,
        typer.Option(help="Which sensors are worn: six-trackers, right-foot-imu, left-shank+head-imu, flex-four ..."),
    ] = "six-trackers",
    rate: Annotated[float | None, typer.Option(help="Samples a second, where not the layout's own.")] = None,
    ideal: Annotated[bool, typer.Option("--ideal", help="No errors but those that other options ask for.")] = False,
    noise_mm: Annotated[
        float | None, _option(_TRACKERS, "Position noise, standard deviation an axis. Default: 3.")
    ] = None,
    noise_deg: Annotated[float | None, _option(_TRACKERS, "Orientation noise, degrees an axis. Default: 0.5.")] = None,
    bias_mm: Annotated[float | None, _option(_TRACKERS, "Constant position error. Default: 0.")] = None,
    bias_deg: Annotated[float | None, _option(_TRACKERS, "Constant orientation error. Default: 0.")] = None,
    drift_mm: Annotated[float | None, _option(_TRACKERS, "Slowly varying position error. Default: 0.")] = None,
    drift_deg: Annotated[float | None, _option(_TRACKERS, "Slowly varying orientation error. Default: 0.")] = None,
    outliers: Annotated[
        float | None, _option(_TRACKERS, "Share of samples that lie far off, 0 to 1. Default: 0.")
    ] = None,
    noise_m_s2: Annotated[float | None, _option(_IMUS, "Noise of the specific force, an axis. Default: 0.03.")] = None,
    noise_deg_s: Annotated[float | None, _option(_IMUS, "Noise of the angular rate, an axis. Default: 0.11.")] = None,
    bias_m_s2: Annotated[float | None, _option(_IMUS, "Constant error of the specific force. Default: 0.1.")] = None,
    bias_deg_s: Annotated[float | None, _option(_IMUS, "Constant error of the angular rate. Default: 0.5.")] = None,
    bandwidth_hz: Annotated[
        float | None, _option(_IMUS, "Where the sensor's filter passes one half. Default: 10.")
    ] = None,
    range_g: Annotated[float | None, _option(_IMUS, "End of the accelerometer's range. Default: 16.")] = None,
    range_deg_s: Annotated[float | None, _option(_IMUS, "End of the gyroscope's range. Default: 2000.")] = None,
    clock_ppm: Annotated[
        float | None, _option(_IMUS, "Error of each sensor's clock, a millionth. Default: 20.")
    ] = None,
    clock_offset_ms: Annotated[float | None, _option(_IMUS, "Constant lead or lag of each sensor. Default: 0.")] = None,
    minutes_of_use: Annotated[
        float | None, _option(_FLEX, "Minutes for which the sensors were worn before; they age. Default: 0.")
    ] = None,
    drop_outs: Annotated[
        float | None, _option(_ALL, "Share of single samples that are missing, 0 to 1. Default: 0.")
    ] = None,
    bursts: Annotated[float | None, _option(_ALL, "Longer drop-outs a second and sensor. Default: 0.")] = None,
    latency_ms: Annotated[float | None, _option(_ALL, "Delay from a sample's time to its arrival. Default: 0.")] = None,
    jitter_ms: Annotated[float | None, _option(_ALL, "Scale of a further random delay. Default: 0.")] = None,
    placement_error_mm: Annotated[
        float | None, _option(_ALL, "How far sensors sit from where they should. Default: trackers 0, IMUs 10.")
    ] = None,
    placement_error_deg: Annotated[
        float | None, _option(_ALL, "How far sensors are turned from how they should. Default: trackers 0, IMUs 5.")
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:SENSOR:START:STOP",
            help="A fault from START to STOP seconds: silent, stuck, outliers, noise or drift;"
            " or swap, with A+B as SENSOR; of flex sensors also saturated or replaced. May be repeated.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all that is drawn.")] = 0,
    start: Annotated[float, typer.Option(help="Second of the motion to begin at.")] = 0.0,
    stop: Annotated[float | None, typer.Option(help="Second of the motion to end at.")] = None,
    skeleton: Annotated[
        Path | None, typer.Option(help="The skeleton's file, where none stands beside the motion.")
    ] = None,
    unit: Unit = None,
    up: Up = None,
    source_rate: SourceRate = None,
    rest_pose: RestPose = "auto",
    name: Annotated[str | None, typer.Option(help="What to call the recording.")] = None,
    subject: Annotated[
        str | None,
        typer.Option(help="Who moves, as a motion library calls them; by the file's name if left out."),
    ] = None,
) -> None:
    """Let a body that moves as CLIP does wear virtual sensors, and record them.

    Example: poseloom simulate sample:walk -o walk.mcap --layout right-foot-imu --fault silent:rightFoot:2:3
    """
    given = {
        "noise_mm": noise_mm,
        "noise_deg": noise_deg,
        "bias_mm": bias_mm,
        "bias_deg": bias_deg,
        "drift_mm": drift_mm,
        "drift_deg": drift_deg,
        "outliers": outliers,
        "noise_m_s2": noise_m_s2,
        "noise_deg_s": noise_deg_s,
        "bias_m_s2": bias_m_s2,
        "bias_deg_s": bias_deg_s,
        "bandwidth_hz": bandwidth_hz,
        "range_g": range_g,
        "range_deg_s": range_deg_s,
        "clock_ppm": clock_ppm,
        "clock_offset_ms": clock_offset_ms,
        "minutes_of_use": minutes_of_use,
        "drop_outs": drop_outs,
        "bursts": bursts,
        "latency_ms": latency_ms,
        "jitter_ms": jitter_ms,
        "placement_error_mm": placement_error_mm,
        "placement_error_deg": placement_error_deg,
        "ideal": True if ideal else None,
    }
    from dataclasses import replace

    from poseloom.cli.virtual_sensors import simulate_worn
    from poseloom.formats.recording import write_recording
    from poseloom.library.sources import subject_of
    from poseloom.samples import read_clip
    from poseloom.sensors import layout as layout_by_name
    from poseloom.sensors import make_layout
    from poseloom.sensors.recording import SUBJECT
    from poseloom.skeleton.retarget import retarget
    from poseloom.synthesis import parse_fault

    _check_output(output)
    worn = layout_by_name(layout)
    if rate is not None:
        worn = make_layout(worn.name, worn.sensors, rate)
    faults = [parse_fault(text) for text in fault or ()]
    choices = motion_choices(unit, up, source_rate, rest_pose)
    on_body = retarget(read_clip(clip, skeleton, choices, human=True))
    tell_conventions(on_body)
    moving = _cut(on_body, start, stop)
    asked = {option: value for option, value in given.items() if value is not None}
    recording = simulate_worn(moving, worn, asked, faults, seed)
    who = subject or subject_of(clip)
    recording = replace(recording, settings={**recording.settings, SUBJECT: who})
    if name is not None:
        recording = replace(recording, name=name)
    write_recording(recording, output)
    show_recording(recording, output)


def _check_output(output: Path) -> None:
    if output.suffix.lower() != ".mcap":
        raise SensorError(
            f"a recording cannot be written as {output.suffix or 'a file without a suffix'}",
            remedy=f"Name an .mcap file, such as {output.with_suffix('.mcap')}",
            file=output,
        )


def _cut(motion: "Motion", start: float, stop: float | None) -> "Motion":
    """The part from `start` to `stop` seconds, both ends included."""
    if start == 0.0 and stop is None:
        return motion
    end = motion.duration if stop is None else stop
    if not 0.0 <= start <= min(end, motion.duration):
        raise PoseloomError(
            f"the motion {motion.name!r} has no part from {start:g} s to {end:g} s",
            cause=f"it lasts {motion.duration:.2f} s",
            remedy="Choose --start below --stop, and within the motion",
        )
    return motion.cut(round(start * motion.rate), round(min(end, motion.duration) * motion.rate) + 1)


def show_recording(recording: "Recording", output: Path) -> None:
    """Tells what was written: one line a fact."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from poseloom.sensors.summary import summarise

    table = Table(show_header=False, box=None, pad_edge=False)
    for label, text in [("recording", str(output)), *summarise(recording)]:
        table.add_row(label, Text(text))
    Console().print(table)
