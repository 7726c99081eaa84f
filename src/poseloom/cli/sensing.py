"""`poseloom simulate`: virtual trackers on a motion, recorded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.errors import PoseloomError, SensorError, unknown_name

if TYPE_CHECKING:
    from poseloom.sensors import Recording
    from poseloom.skeleton.motion import Motion
    from poseloom.synthesis import Fault

SAMPLE_PREFIX = "sample:"
"""What stands before the name of a built-in sample motion where a file could stand."""


def register(app: typer.Typer) -> None:
    """Adds `simulate` to the application."""
    app.command("simulate")(simulate)


def simulate(
    clip: Annotated[str, typer.Argument(help="A motion file, or sample:NAME for a built-in sample motion.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording to write, an .mcap file.")],
    layout: Annotated[str, typer.Option(help="Which trackers are worn.")] = "six-trackers",
    noise_mm: Annotated[float, typer.Option(help="Standard deviation of position noise, millimetres an axis.")] = 3.0,
    noise_deg: Annotated[float, typer.Option(help="Standard deviation of orientation noise, degrees an axis.")] = 0.5,
    bias_mm: Annotated[float, typer.Option(help="Standard deviation of a constant position error.")] = 0.0,
    bias_deg: Annotated[float, typer.Option(help="Standard deviation of a constant orientation error.")] = 0.0,
    drift_mm: Annotated[float, typer.Option(help="Standard deviation of a slowly varying position error.")] = 0.0,
    drift_deg: Annotated[float, typer.Option(help="Standard deviation of a slowly varying orientation error.")] = 0.0,
    outliers: Annotated[float, typer.Option(help="Share of samples that lie far off, 0 to 1.")] = 0.0,
    drop_outs: Annotated[float, typer.Option(help="Share of single samples that are missing, 0 to 1.")] = 0.0,
    bursts: Annotated[float, typer.Option(help="Longer drop-outs a second and sensor.")] = 0.0,
    latency_ms: Annotated[float, typer.Option(help="Delay from a sample's time to its arrival.")] = 0.0,
    jitter_ms: Annotated[float, typer.Option(help="Scale of a further random delay.")] = 0.0,
    placement_error_mm: Annotated[float, typer.Option(help="How far sensors sit from where they should.")] = 0.0,
    placement_error_deg: Annotated[float, typer.Option(help="How far sensors are turned from how they should.")] = 0.0,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:SENSOR:START:STOP",
            help="A fault from START to STOP seconds: silent, stuck, outliers, noise or drift;"
            " or swap, with A+B as SENSOR. May be repeated.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of all that is drawn.")] = 0,
    start: Annotated[float, typer.Option(help="Second of the motion to begin at.")] = 0.0,
    stop: Annotated[float | None, typer.Option(help="Second of the motion to end at.")] = None,
    skeleton: Annotated[
        Path | None, typer.Option(help="The skeleton's file, where none stands beside the motion.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="What to call the recording.")] = None,
) -> None:
    """Let a body that moves as CLIP does wear virtual trackers, and record them.

    Example: poseloom simulate sample:walk -o walk.mcap --fault silent:leftHand:2:3
    """
    from dataclasses import replace
    from math import radians

    from poseloom.formats.recording import write_recording
    from poseloom.sensors import layout as layout_by_name
    from poseloom.skeleton.retarget import retarget
    from poseloom.synthesis import TrackerNoise, simulate_trackers

    _check_output(output)
    worn = layout_by_name(layout)
    faults = [_parse_fault(text) for text in fault or ()]
    moving = _cut(retarget(_load(clip, skeleton)), start, stop)
    noise = TrackerNoise(
        position_m=noise_mm / 1e3,
        orientation_rad=radians(noise_deg),
        bias_m=bias_mm / 1e3,
        bias_rad=radians(bias_deg),
        drift_m=drift_mm / 1e3,
        drift_rad=radians(drift_deg),
        outlier_probability=outliers,
        drop_out_probability=drop_outs,
        burst_rate_hz=bursts,
        latency_s=latency_ms / 1e3,
        jitter_s=jitter_ms / 1e3,
        placement_m=placement_error_mm / 1e3,
        placement_rad=radians(placement_error_deg),
    )
    recording = simulate_trackers(moving, worn, noise, faults, seed)
    if name is not None:
        recording = replace(recording, name=name)
    write_recording(recording, output)
    _show(recording, output)


def _check_output(output: Path) -> None:
    if output.suffix.lower() != ".mcap":
        raise SensorError(
            f"a recording cannot be written as {output.suffix or 'a file without a suffix'}",
            remedy=f"Name an .mcap file, such as {output.with_suffix('.mcap')}",
            file=output,
        )


def _load(clip: str, skeleton: Path | None) -> "Motion":
    from poseloom.formats import drop_rest_frame, read_motion
    from poseloom.samples import sample_motions

    if not clip.startswith(SAMPLE_PREFIX):
        return drop_rest_frame(read_motion(Path(clip), skeleton))
    samples = sample_motions()
    sample = clip.removeprefix(SAMPLE_PREFIX)
    if sample not in samples:
        raise unknown_name("sample motion", sample, samples)
    return samples[sample]


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


def _parse_fault(text: str) -> "Fault":
    from poseloom.synthesis import Fault, FaultKind

    parts = text.split(":")
    try:
        kind, sensor, start, stop = parts
        begin, end = float(start), float(stop)
    except ValueError:
        raise SensorError(
            f"the fault {text!r} is not understood",
            remedy="Write KIND:SENSOR:START:STOP with times in seconds, such as silent:leftHand:2:3",
        ) from None
    if kind not in set(FaultKind):
        raise unknown_name("kind of fault", kind, list(FaultKind), SensorError)
    first, _, other = sensor.partition("+")
    return Fault(first, begin, end, FaultKind(kind), other=other)


def _show(recording: "Recording", output: Path) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from poseloom.sensors.summary import summarise

    table = Table(show_header=False, box=None, pad_edge=False)
    for label, text in [("recording", str(output)), *summarise(recording)]:
        table.add_row(label, Text(text))
    Console().print(table)
