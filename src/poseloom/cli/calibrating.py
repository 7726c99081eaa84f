"""`poseloom calibrate`: sizes and placements from held poses; the guide to them; sessions to try it without sensors."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._progress import progress_bars
from poseloom.errors import PoseloomError

if TYPE_CHECKING:
    from rich.console import Console

    from poseloom.calibration.calibration import Calibration
    from poseloom.sensors import Recording


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command("calibrate")(calibrate_wearer)
    app.command("simulate-calibration")(simulate_calibration)


def calibrate_wearer(
    recording: Annotated[
        Path | None, typer.Argument(help="Trackers during a guided session (.mcap).", metavar="REC", show_default=False)
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The calibration, or with --guide the HTML page.")
    ] = None,
    guide: Annotated[
        bool, typer.Option("--guide", help="Write the page that leads through the poses instead.")
    ] = False,
    report: Annotated[Path | None, typer.Option(help="Also write a report, one HTML file.")] = None,
    rounds: Annotated[
        int | None, typer.Option(help="How often the eight poses are held; found by itself unless given.", min=1, max=8)
    ] = None,
    floor: Annotated[bool, typer.Option(help="Whether the feet stand on the trackers' y = 0.")] = True,
    body_size: Annotated[
        Path | None, typer.Option(help="A body-size model of your own, from `poseloom fit body-size`.")
    ] = None,
) -> None:
    """Find the wearer's bone lengths and where the trackers sit.

    First: poseloom calibrate --guide -o guide.html, open it, record while it leads.
    Then: poseloom calibrate REC -o CAL, and use it: poseloom reconstruct REC --calibration CAL.
    """
    from rich.console import Console

    if output is None:
        raise PoseloomError("there is no output", remedy="Name it with -o")
    if guide:
        from poseloom.calibration.session import DEFAULT_ROUNDS
        from poseloom.report.guide import write_guide

        write_guide(output, rounds or DEFAULT_ROUNDS)
        Console().print(f"Open {output} in a browser, start recording, and press Start there.")
        return
    if recording is None:
        raise PoseloomError(
            "there is no recording to calibrate from", remedy="Name one, or write the page of poses with --guide"
        )
    _calibrate(recording, output, report, rounds, floor, body_size)


def _calibrate(
    recording: Path, output: Path, report: Path | None, rounds: int | None, floor: bool, body_size: Path | None
) -> None:
    from rich.console import Console

    from poseloom.calibration.body_size import read_body_size
    from poseloom.calibration.calibration import write_calibration
    from poseloom.calibration.session import calibrate
    from poseloom.calibration.unknowns import CalibrationSettings
    from poseloom.formats.atomic import check_folder
    from poseloom.formats.recording import read_recording
    from poseloom.report.calibration import write_calibration_report

    for path in (output, report):
        if path is not None:
            check_folder(path)
    heard = read_recording(recording)
    model = None if body_size is None else read_body_size(body_size)
    settings = CalibrationSettings() if floor else CalibrationSettings(floor_m=float("inf"))
    with progress_bars() as show:
        found = calibrate(heard, settings, model, rounds, show)
    write_calibration(found, output)
    if report is not None:
        write_calibration_report(report, found, f"Calibration from {heard.name or recording.name}")
    console = Console()
    _print(found, console)
    truth = _truth_line(heard, found)
    if truth:
        console.print(truth)


def simulate_calibration(
    output: Annotated[Path, typer.Option("--output", "-o", help="The recording to write, an .mcap file.")],
    rounds: Annotated[int, typer.Option(help="How often the eight poses are held.", min=1, max=8)] = 5,
    pose_error_deg: Annotated[float, typer.Option(help="How far joint angles are from the poses.")] = 7.0,
    noise_mm: Annotated[float, typer.Option(help="Position noise, millimetres an axis.")] = 3.0,
    noise_deg: Annotated[float, typer.Option(help="Orientation noise, degrees an axis.")] = 0.5,
    swap: Annotated[
        str | None, typer.Option(metavar="A,B", help="Two trackers that were exchanged, e.g. leftHand,rightHand.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Draws the person, the placements and the noise.")] = 0,
) -> None:
    """Simulate a calibration session, to try calibration without sensors.

    A person of a size drawn from the body-size model wears six trackers strapped on anyhow and holds the poses badly.
    """
    from math import radians

    import numpy as np
    from rich.console import Console

    from poseloom.calibration.body_size import body_size_model
    from poseloom.calibration.poses import guided_poses
    from poseloom.calibration.session import ROUNDS_SETTING
    from poseloom.formats.recording import write_recording
    from poseloom.sensors import layout
    from poseloom.synthesis import Fault, FaultKind, TrackerNoise
    from poseloom.synthesis.holding import HoldingStyle, simulate_session

    if output.suffix.lower() != ".mcap":
        raise PoseloomError("a recording is an .mcap file", remedy=f"Name {output.with_suffix('.mcap')}", file=output)
    worn, model = layout("six-trackers"), body_size_model()
    faults: list[Fault] = []
    if swap is not None:
        first, _, second = swap.partition(",")
        faults.append(Fault(first.strip(), -1.0, 1e9, FaultKind.SWAP, other=second.strip()))
    person = model.body_of(np.random.default_rng(seed).normal(size=model.size))
    recording = simulate_session(
        person,
        np.stack([pose.q for pose in guided_poses()] * rounds),
        worn,
        TrackerNoise(position_m=noise_mm / 1e3, orientation_rad=radians(noise_deg)),
        faults,
        HoldingStyle(pose_rad=radians(pose_error_deg)),
        seed=seed,
        settings={ROUNDS_SETTING: str(rounds)},
    )
    write_recording(recording, output)
    Console().print(f"{output}: {rounds} x 8 poses, {recording.duration:.0f} s, {len(worn)} trackers")


def fit_sizes(
    table: Annotated[
        Path, typer.Argument(help="Bone offsets of CMU skeletons: subject,clip,joint,x,y,z.", metavar="CSV")
    ],
    skeletons: Annotated[
        list[Path] | None, typer.Argument(help="ASF files: more people, and how long a thorax is.", metavar="[ASF]...")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="The model, a JSON file.")] = Path("body_size.json"),
    components: Annotated[int, typer.Option(help="Principal components to keep.", min=1)] = 12,
    source: Annotated[str, typer.Option(help="Where the skeletons come from, to be kept in the file.")] = "",
) -> None:
    """Learn how people's bodies differ in size, from real skeletons."""
    import numpy as np
    from rich.console import Console

    from poseloom.calibration.body_size import body_size_to_json, fit_body_size
    from poseloom.calibration.size_sources import training_bodies
    from poseloom.formats.atomic import atomic_file

    bodies = training_bodies(table, skeletons or ())
    model = fit_body_size(bodies, components, source or f"{len(bodies)} skeletons of {table.name}")
    with atomic_file(output) as part:
        part.write_text(body_size_to_json(model), encoding="utf-8")
    spread = 1e3 * np.sqrt((model.components.reshape(model.size, -1) ** 2).sum(axis=1))
    console = Console()
    console.print(f"{output}: {len(bodies)} distinct bodies, {model.size} components")
    console.print("standard deviations, mm over all bones: " + " ".join(f"{value:.0f}" for value in spread))


def _print(found: "Calibration", console: "Console") -> None:
    from math import degrees

    from rich.table import Table

    from poseloom.calibration.calibration import Level
    from poseloom.report.calibration import placement_rows, size_rows

    sizes = Table("bone", "cm", "sd", "average", title="Sizes")
    for name, length, sigma, usual in size_rows(found):
        sizes.add_row(name, f"{100 * length:.1f}", f"{100 * sigma:.1f}", f"{100 * usual:.1f}")
    places = Table("sensor", "bone", "place cm", "sd", "turn deg", "sd", "left over mm, deg", title="Placements")
    for index, (name, bone, place, offset, turn, angle) in enumerate(placement_rows(found)):
        places.add_row(
            name,
            bone,
            " ".join(f"{100 * value:.1f}" for value in place),
            f"{100 * offset:.1f}",
            " ".join(f"{degrees(value):.0f}" for value in turn),
            f"{degrees(angle):.1f}",
            _left_over(found, index),
        )
    console.print(sizes)
    console.print(places)
    for verdict in found.verdicts:
        console.print(f"{'good' if verdict.level is Level.GOOD else 'warning'}: {verdict}", soft_wrap=True)


def _left_over(found: "Calibration", sensor: int) -> str:
    import numpy as np

    part = found.residuals[:, sensor]
    part = part[np.isfinite(part[:, 0])]
    if not len(part):
        return "silent"
    metres, angle = np.sqrt((part**2).mean(axis=0))
    return f"{1e3 * metres:.1f}, {np.degrees(angle):.1f}"


def _truth_line(heard: "Recording", found: "Calibration") -> str:
    """How far a simulated session's calibration is from the truth."""
    import numpy as np

    from poseloom.synthesis import true_placements
    from poseloom.synthesis.wearing import TRUE_PLACEMENTS

    if heard.truth is None or TRUE_PLACEMENTS not in heard.settings:
        return ""
    true = np.linalg.norm(heard.truth.skeleton.offsets, axis=1)
    known = true > 0
    percent = 100 * np.abs(found.lengths[known] / true[known] - 1)
    apart = [
        float(np.linalg.norm(a.p_bone_sensor - b.p_bone_sensor))
        for a, b in zip(found.placements, true_placements(heard), strict=True)
    ]
    return (
        f"simulated, so the truth is known: bones off by {percent.mean():.1f} % on average, {percent.max():.1f} % at "
        f"most; sensors by {100 * np.mean(apart):.1f} cm"
    )
