"""`poseloom convert` and `poseloom info`: motion files in, motion files and facts out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.cli._motion_options import RestPose, SourceRate, Unit, Up, motion_choices

if TYPE_CHECKING:
    from poseloom.skeleton.motion import Motion

_Skeleton = Annotated[
    Path | None, typer.Option(help="The .asf (or skeleton.json) of a motion that has none beside it.")
]


def register(app: typer.Typer) -> None:
    """Adds `convert` and `info` to the application."""
    app.command("convert")(convert)
    app.command("info")(info)


def convert(
    source: Annotated[
        Path, typer.Argument(metavar="IN", help="A motion: BVH, AMC, exponential-map CSV, DeepMimic JSON or NPZ.")
    ],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="The file to write: .bvh, .glb or .npz.")],
    skeleton: _Skeleton = None,
    unit: Unit = None,
    up: Up = None,
    source_rate: SourceRate = None,
    rest_pose: RestPose = "auto",
    rate: Annotated[float | None, typer.Option(help="Resample to so many frames a second.")] = None,
    drop_rest_frame: Annotated[
        bool, typer.Option("--drop-rest-frame", help="Leave out frame 0 if it is the pose the skeleton was drawn in.")
    ] = False,
    body: Annotated[bool, typer.Option("--body", help="Put the motion on the 22-bone body, size kept.")] = False,
) -> None:
    """Write a motion in another format.

    Example: poseloom convert 02_01.amc walk.glb
    """
    from poseloom import formats
    from poseloom.errors import FormatError
    from poseloom.formats.conventions import describe_conventions

    if target.suffix.lower() not in formats.writable_suffixes():
        raise FormatError(
            f"poseloom does not write files of kind {target.suffix.lower() or '(none)'}",
            remedy=f"Use one of: {', '.join(formats.writable_suffixes())}",
            file=target,
        )
    motion = formats.read_motion(source, skeleton, choices=motion_choices(unit, up, source_rate, rest_pose))
    conventions = motion.conventions
    if drop_rest_frame:
        motion = formats.drop_rest_frame(motion)
    if body:
        from poseloom.skeleton.retarget import retarget

        motion = retarget(motion)
        conventions = motion.conventions
    if rate is not None:
        from poseloom.skeleton.resample import resample

        motion = resample(motion, rate)
    formats.write_motion(motion, target)
    told = [] if conventions is None else describe_conventions(conventions)
    _print([("written", str(target)), ("format", formats.format_name(target)), *told, *_measures(motion)])


def info(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A motion file or a recording (.mcap).")],
    skeleton: _Skeleton = None,
    unit: Unit = None,
    up: Up = None,
    source_rate: SourceRate = None,
    rest_pose: RestPose = "auto",
) -> None:
    """Say what a motion file or a recording holds."""
    if file.suffix.lower() == ".mcap":
        from poseloom.formats.recording import describe_recording

        _print([("recording", str(file)), *describe_recording(file)])
        return
    from poseloom import formats

    motion = formats.read_motion(file, skeleton, choices=motion_choices(unit, up, source_rate, rest_pose))
    rows = [("motion", motion.name), ("format", formats.format_name(file)), *_conventions(motion), *_measures(motion)]
    if formats.format_name(file) == "DeepMimic JSON":
        from poseloom.formats.deepmimic import read_deepmimic

        rows.append(("repeats", "yes" if read_deepmimic(file).cyclic else "no"))
    if formats.starts_with_rest_frame(motion):
        rows.append(("frame 0", "the pose the skeleton was drawn in, not part of the movement"))
    _print(rows)


def _conventions(motion: "Motion") -> list[tuple[str, str]]:
    """How a motion's file was understood, and which rest pose retargeting would take."""
    from poseloom.errors import RetargetError
    from poseloom.formats.conventions import describe_conventions
    from poseloom.skeleton.retarget import retarget

    if motion.conventions is None:
        return []
    try:
        told = retarget(motion).conventions
    except RetargetError as error:
        return [*describe_conventions(motion.conventions), ("on the body", f"no: {error.fact}")]
    return describe_conventions(told or motion.conventions)


def _measures(motion: "Motion") -> list[tuple[str, str]]:
    """Facts of a motion, as labels and texts."""
    import numpy as np

    from poseloom.skeleton.kinematics import motion_frames

    frames = motion_frames(motion)
    tips = np.where(np.isfinite(motion.skeleton.tips), motion.skeleton.tips, 0.0)
    ends = frames.positions + np.einsum("fjab,jb->fja", frames.rotations, tips)
    heights = np.concatenate([frames.positions, ends], axis=1)[:, :, 1]
    tall = np.median(heights.max(axis=1) - heights.min(axis=1))
    ground = frames.positions[:, _hips(motion)][:, [0, 2]]
    path = np.linalg.norm(np.diff(ground, axis=0), axis=1).sum()
    net = np.linalg.norm(ground[-1] - ground[0])
    rows = [
        ("joints", f"{len(motion.skeleton)} ({_family(motion)})"),
        ("frames", f"{len(motion)} at {motion.rate:g} Hz"),
        ("duration", f"{motion.duration:.2f} s"),
        ("height", f"{tall:.2f} m from lowest to highest point (median)"),
        ("travel", f"{path:.2f} m of the hips over ground, {net:.2f} m from start to end"),
    ]
    if motion.displacements is not None:
        moving = [motion.skeleton.names[j] for j in np.flatnonzero(motion.displacements.any(axis=(0, 2)))]
        rows.append(("translating", ", ".join(moving)))
    return rows


def _hips(motion: "Motion") -> int:
    """The joint at the first fork from the root down: some files move a joint below the root."""
    joint = 0
    while len(children := motion.skeleton.children(joint)) == 1:
        joint = children[0]
    return joint


def _family(motion: "Motion") -> str:
    """The naming family of a motion's joints, as far as it is known."""
    from poseloom.errors import RetargetError
    from poseloom.skeleton.families import recognise

    try:
        return recognise(motion.skeleton).name
    except RetargetError:
        return "names of no known family"


def _print(rows: list[tuple[str, str]]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(show_header=False, box=None, pad_edge=False)
    for label, text in rows:
        table.add_row(label, Text(text))
    Console().print(table)
