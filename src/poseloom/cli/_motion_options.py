"""Options for motion files that do not say how they are meant, shared by all commands that read some."""

from typing import TYPE_CHECKING, Annotated

import typer

from poseloom.errors import FormatError

if TYPE_CHECKING:
    from poseloom.formats.conventions import MotionChoices
    from poseloom.skeleton.motion import Motion

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048, "cmu": 0.0254 / 0.45}
"""Names of units of length, and metres a unit; `cmu` is that of CMU's ASF files."""

Unit = Annotated[
    str | None,
    typer.Option(help="Unit of length, where its guess is wrong: m, cm, mm, in, ft, cmu, or metres a unit."),
]
Up = Annotated[str | None, typer.Option(help="Axis that points up, where its guess is wrong: x, y, z, -x, -y or -z.")]
SourceRate = Annotated[
    float | None,
    typer.Option(help="Frames a second, where a BVH file's frame time is impossible or an AMC file's are not 120."),
]
RestPose = Annotated[
    str,
    typer.Option(
        help="Rest pose: the file's zero pose, a guess from the motion, or auto for what is sure.",
        metavar="auto|zero|motion",
    ),
]


def motion_choices(
    unit: str | None = None, up: str | None = None, source_rate: float | None = None, rest_pose: str = "auto"
) -> "MotionChoices":
    """What the user says of motion files.

    Raises:
        FormatError: for a unit, axis or rest pose that is none.
    """
    from poseloom.formats.conventions import MotionChoices
    from poseloom.skeleton.conventions import AXES

    if up is not None and up.lower() not in AXES:
        raise FormatError(f"{up!r} is no axis (--up)", remedy=f"Use one of: {', '.join(AXES)}")
    if rest_pose not in ("auto", "zero", "motion"):
        raise FormatError(f"{rest_pose!r} is no rest pose (--rest-pose)", remedy="Use auto, zero or motion")
    return MotionChoices(_metres(unit), up.lower() if up else None, source_rate, rest_pose)


def _metres(unit: str | None) -> float | None:
    if unit is None:
        return None
    try:
        return UNITS[unit.lower()] if unit.lower() in UNITS else float(unit)
    except ValueError:
        remedy = f"Use one of: {', '.join(UNITS)}, or a number of metres"
        raise FormatError(f"{unit!r} is no unit of length (--unit)", remedy=remedy) from None


def tell_conventions(motion: "Motion") -> None:
    """Says on stderr, in one line, how a motion's file was understood."""
    from poseloom.formats.conventions import one_line

    if motion.conventions is not None:
        typer.echo(f"{motion.name or 'motion'}: read as {one_line(motion.conventions)}", err=True)
