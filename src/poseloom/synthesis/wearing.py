"""What simulations of every kind of sensor share: where sensors really sit, and how a recording says it was made."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields

from poseloom.errors import PoseloomError, SensorError
from poseloom.formats.recording_header import placements_from_json, placements_to_json
from poseloom.rotations import matrix_from_rotvec
from poseloom.sensors.layout import SensorKind, SensorLayout
from poseloom.sensors.placement import Placement, make_placement
from poseloom.sensors.recording import Recording
from poseloom.skeleton.motion import Motion
from poseloom.synthesis.faults import Fault
from poseloom.synthesis.noise import Delivery, Streams

TRUE_PLACEMENTS = "true placements"
"""Key in a recording's settings of where the sensors really sat (JSON, see `true_placements`)."""

_KINDS: Mapping[SensorKind, tuple[str, str]] = {
    SensorKind.TRACKER: ("trackers", "six-trackers"),
    SensorKind.IMU: ("IMUs", "right-foot-imu"),
    SensorKind.FLEX: ("flex sensors", "flex-four"),
}


def true_placements(recording: Recording) -> tuple[Placement, ...]:
    """Where the sensors of a simulated recording really sat: what calibration should find.

    That is where the recording says, unless it was simulated with a placement error.

    Raises:
        SensorError: where what the recording says of them is no placement of each of its sensors.
    """
    text = recording.settings.get(TRUE_PLACEMENTS)
    if text is None:
        return recording.placements
    try:
        placements = placements_from_json(json.loads(text))
        if len(placements) != len(recording.layout):
            raise ValueError(f"{len(placements)} placements of {len(recording.layout)} sensors")
    except (PoseloomError, ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
        raise SensorError(
            "what the recording says of its true placements is damaged",
            cause=str(error)[:160],
            remedy="Get the recording again, or simulate it anew",
        ) from None
    return placements


def check_wearer(motion: Motion, layout: SensorLayout, kind: SensorKind) -> None:
    """Raises SensorError for a motion whose joints translate, or a layout with sensors of another kind."""
    if motion.displacements is not None:
        raise SensorError(
            "the motion moves its joints apart, so no sensor keeps its place on a bone",
            remedy="Retarget the motion to the body first",
        )
    others = [sensor.name for sensor in layout.sensors if sensor.kind is not kind]
    if others:
        words, example = _KINDS[kind]
        raise SensorError(
            f"layout {layout.name!r} has sensors that are no {words}: {', '.join(others)}",
            remedy=f"Choose a layout of {words}, such as {example}",
        )


def misplaced(
    stated: tuple[Placement, ...], layout: SensorLayout, shift_m: float, turn_rad: float, streams: Streams
) -> tuple[Placement, ...]:
    """Where the sensors really sit: off by standard deviations an axis; `stated` itself where both are nought."""
    if not (shift_m or turn_rad):
        return stated
    worn: list[Placement] = []
    for sensor, placement in zip(layout.names, stated, strict=True):
        shift, turn = streams.stream(sensor, "placement").normal(size=(2, 3))
        worn.append(
            make_placement(
                placement.bone,
                placement.p_bone_sensor + shift_m * shift,
                placement.R_bone_sensor @ matrix_from_rotvec(turn_rad * turn),
            )
        )
    return tuple(worn)


def told_settings(
    maker: str,
    motion: Motion,
    noise: Delivery,
    faults: Sequence[Fault],
    streams: Streams,
    worn: tuple[Placement, ...] | None,
) -> Mapping[str, str]:
    """How a recording was made: source, seed, all parameters that are not zero, faults, and where sensors really sat.

    Args:
        maker: Name of the function that made it.
        motion: What the body did.
        noise: The errors' parameters.
        faults: What went wrong in addition.
        streams: What was drawn from.
        worn: True placements, if they differ from those that the recording states.
    """
    settings = {"made by": maker, "source": motion.name, "seed": str(streams.seed)}
    told = {each.name: getattr(noise, each.name) for each in fields(noise)}
    settings |= {f"noise {name}": repr(value) for name, value in told.items() if value}
    if faults:
        settings["faults"] = json.dumps([asdict(fault) for fault in faults])
    if worn is not None:
        settings[TRUE_PLACEMENTS] = json.dumps(placements_to_json(worn))
    return settings
