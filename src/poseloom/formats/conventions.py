"""What motion files leave open, decided in one place for all formats: unit of length, up axis, impossible rates."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from poseloom.errors import FormatError
from poseloom.skeleton.conventions import (
    AXES,
    SHORTEST,
    TALLEST,
    guess_metres_per_unit,
    guess_up,
    scaled,
    stature,
    turned_upright,
    unit_name,
)
from poseloom.skeleton.motion import FileConventions, Motion, RestChoice

_SLOWEST, _FASTEST = 1.0, 2000.0
"""Frames a second: slower is none that anybody records, but a time in milliseconds or a rate in the time's place."""
_CENTIMETRE = 0.01


@dataclass(frozen=True)
class MotionChoices:
    """What a user says about motion files that do not say it themselves, or wrongly; None where nothing is said.

    Attributes:
        metres_per_unit: Unit of length.
        up: Axis that points up, of `AXES`.
        rate: Frames a second.
        rest: Which rest pose to take (`RestChoice`).
    """

    metres_per_unit: float | None = None
    up: str | None = None
    rate: float | None = None
    rest: RestChoice = "auto"


NOTHING_SAID = MotionChoices()


def settle(
    motion: Motion, path: Path, choices: MotionChoices, stated_unit: float | None = None, stated_up: str | None = None
) -> Motion:
    """A motion as its file gives it, in metres and Y up, with the conventions that were found.

    Args:
        motion: In metres by the stated unit; in the file's own unit if none is stated.
        path: For errors.
        choices: What the user says.
        stated_unit: Metres a unit, as the file or its format states.
        stated_up: The axis that points up, as the file or its format states.

    Raises:
        FormatError: for choices that make no sense.
    """
    if choices.metres_per_unit is not None and not 0 < choices.metres_per_unit < float("inf"):
        raise FormatError(
            f"the unit of length is {choices.metres_per_unit:g} m", remedy="Give a positive number", file=path
        )
    if choices.up is not None and choices.up not in AXES:
        raise FormatError(f"{choices.up!r} is no axis", remedy=f"Use one of: {', '.join(AXES)}", file=path)
    unit, unit_origin = _unit(motion, choices, stated_unit)
    motion = scaled(motion, unit if stated_unit is None else unit / stated_unit if unit != stated_unit else 1.0)
    if choices.up is None and stated_up is not None:
        up, whole, up_origin = stated_up, True, "stated"
    else:
        guessed, whole = guess_up(motion)
        up, up_origin = (guessed, "guessed") if choices.up is None else (choices.up, "given")
        whole = whole if up == guessed else True
    conventions = FileConventions(unit, unit_origin, up, up_origin, stature(motion.skeleton), choices.rest)
    return replace(turned_upright(motion, up, whole), conventions=conventions)


def _unit(motion: Motion, choices: MotionChoices, stated: float | None) -> tuple[float, str]:
    if choices.metres_per_unit is not None:
        return choices.metres_per_unit, "given"
    if stated is None:
        return guess_metres_per_unit(motion.skeleton) or _CENTIMETRE, "guessed"
    if not _human(stature(motion.skeleton)):
        other = guess_metres_per_unit(motion.skeleton)
        if other is not None:
            return other * stated, "guessed"
    return stated, "stated"


def check_human(motion: Motion, path: Path) -> None:
    """Refuses a motion whose body is human in no unit, unless the user gave the unit.

    Raises:
        FormatError: with the stature.
    """
    told = motion.conventions
    if told is None or told.unit_origin == "given" or _human(told.stature):
        return
    raise FormatError(
        f"the body would be about {told.stature:.3g} m tall",
        cause=f"its limbs are human in no unit of length; here they count as {unit_name(told.metres_per_unit)}",
        remedy="Say how many metres a unit is (--unit)",
        file=path,
    )


def _human(tall: float | None) -> bool:
    return tall is None or SHORTEST <= tall <= TALLEST


def check_rate(rate: float, path: Path, choices: MotionChoices, line: int | None = None) -> float:
    """The rate that a file states, or the one that the user gives where that one is impossible.

    Raises:
        FormatError: for less than one frame a second or more than 2,000, unless the user gives the rate; and where
            the user gives one for a file that states a possible one.
    """
    possible = _SLOWEST <= rate <= _FASTEST
    if choices.rate is not None:
        if possible:
            raise FormatError(
                f"a rate was given, but the file states its own, {rate:g} Hz",
                remedy="Leave the rate out, or correct the file's frame time",
                file=path,
                line=line,
            )
        if not 0 < choices.rate < float("inf"):
            raise FormatError(f"the rate is {choices.rate:g} Hz", remedy="Give a positive number", file=path)
        return choices.rate
    if possible:
        return rate
    time = 1 / rate
    cause = ""
    if _SLOWEST <= 1000 * rate <= _FASTEST:
        cause = f"taken for milliseconds it would be {1000 * rate:.6g} frames a second"
    if time == round(time) and 10 <= time <= _FASTEST:
        cause += f"{' and ' if cause else ''}taken for a rate {time:g} frames a second"
    raise FormatError(
        f"from frame to frame are {time:g} s, which nobody records",
        cause=cause,
        remedy="Say how many frames a second there are (--source-rate)",
        file=path,
        line=line,
    )


def describe_conventions(conventions: FileConventions) -> list[tuple[str, str]]:
    """Facts on how a file was understood, as labels and texts."""
    found = conventions
    tall = "" if found.stature is None else f": the body is about {found.stature:.2f} m tall"
    human = "" if _human(found.stature) else ", human in no unit (--unit)"
    rows = [("unit", f"{unit_name(found.metres_per_unit)}, {found.unit_origin}{tall}{human}")]
    rows.append(("up", f"{found.up}, {found.up_origin}"))
    if found.rest_origin:
        rows.append(("rest pose", _rest(found)))
    return rows


def one_line(conventions: FileConventions) -> str:
    """How a file was understood, in a few words: for catalogues and summaries."""
    told = f"{unit_name(conventions.metres_per_unit)} ({conventions.unit_origin}), "
    told += f"{conventions.up} up ({conventions.up_origin})"
    return told + (", rest pose from the motion" if conventions.rest_origin == "motion" else "")


def _rest(found: FileConventions) -> str:
    if found.rest_origin != "motion":
        return "the file's zero pose" if found.rest_origin == "zero pose" else "as this family's files have it"
    return "found from the motion, for the zero pose is no body's" + _guessed(found.unsure)


def _guessed(bones: Sequence[str]) -> str:
    return f"; a guess for {', '.join(bones)}" if bones else ""
