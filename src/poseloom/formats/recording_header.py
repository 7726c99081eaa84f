"""What stands at the beginning of a recording's file: the sensors, where they sat, and whose body it was."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from poseloom.errors import FormatError, PoseloomError, SensorError
from poseloom.formats._files import DAMAGE
from poseloom.formats.artefact_arrays import rate
from poseloom.formats.skeleton_json import skeleton_from_json, skeleton_to_json
from poseloom.sensors.layout import SensorKind, SensorLayout, SensorSpec, make_layout
from poseloom.sensors.placement import Placement, make_placement
from poseloom.sensors.recording import CHANNEL_SHAPES
from poseloom.skeleton.skeleton import Skeleton

FORMAT = "poseloom recording"
VERSION = 1

_FARTHEST = 100.0
_MOST_SENSORS = 1000


@dataclass(frozen=True, eq=False)
class RecordingHeader:
    """All of a recording but its samples.

    Attributes:
        layout: The sensors.
        placements: Where each sensor is said to sit.
        skeleton: The wearer's calibrated bones.
        name: What the recording is called.
        settings: How it was made.
        truth_skeleton: Bones of the truth, where it is recorded beside the samples.
        truth_name: What the true motion is called.
    """

    layout: SensorLayout
    placements: tuple[Placement, ...]
    skeleton: Skeleton
    name: str = ""
    settings: Mapping[str, str] = field(default_factory=dict[str, str])
    truth_skeleton: Skeleton | None = None
    truth_name: str = ""

    def sample_type(self) -> np.dtype[np.void]:
        """The binary record of one sample, little-endian and packed: times, the channels in order, the status."""
        count = len(self.layout)
        return np.dtype(
            [
                ("time", "<f8"),
                ("arrival", "<f8"),
                *((name, "<f8", (count, *shape)) for name, shape in CHANNEL_SHAPES.items()),
                ("status", "u1", (count,)),
            ]
        )


def placements_to_json(placements: Sequence[Placement]) -> list[dict[str, Any]]:
    """Placements as JSON knows them; floats keep every bit."""
    return [
        {"bone": p.bone, "R_bone_sensor": p.R_bone_sensor.tolist(), "p_bone_sensor": p.p_bone_sensor.tolist()}
        for p in placements
    ]


def placements_from_json(content: list[dict[str, Any]]) -> tuple[Placement, ...]:
    """The inverse of `placements_to_json`.

    Raises:
        SensorError: for a place or rotation that is none.
        KeyError, TypeError, ValueError: where the content has another form.
    """
    placements = tuple(make_placement(str(p["bone"]), p["p_bone_sensor"], p["R_bone_sensor"]) for p in content)
    if any(np.abs(placement.p_bone_sensor).max() > _FARTHEST for placement in placements):
        raise SensorError(f"a sensor sits more than {_FARTHEST:g} m from its bone", remedy="Mend its placement")
    return placements


def header_to_json(header: RecordingHeader) -> bytes:
    """The header as UTF-8 JSON; floats keep every bit."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "name": header.name,
        "settings": dict(header.settings),
        "layout": {
            "name": header.layout.name,
            "rate": header.layout.rate,
            "sensors": [{"name": s.name, "kind": s.kind.value, "bone": s.bone} for s in header.layout.sensors],
        },
        "placements": placements_to_json(header.placements),
        "skeleton": skeleton_to_json(header.skeleton),
        "truth": None
        if header.truth_skeleton is None
        else {"name": header.truth_name, "skeleton": skeleton_to_json(header.truth_skeleton)},
    }
    return json.dumps(content).encode()


def header_from_json(text: bytes, file: Path) -> RecordingHeader:
    """The inverse of `header_to_json`. Equal skeletons of wearer and truth become one object.

    Raises:
        FormatError: if it is another format or version, or damaged.
    """
    try:
        content: dict[str, Any] = json.loads(text)
        version = int(content["version"]) if content["format"] == FORMAT else 0
        if version == VERSION:
            return _header(content)
    except PoseloomError as error:
        raise error.at(file) from None
    except DAMAGE as error:
        raise FormatError(
            "the recording's header is damaged",
            cause=repr(error)[:160],
            remedy="Record it anew, or get the file again",
            file=file,
        ) from None
    raise FormatError(
        f"this recording has version {version} of the format, but poseloom reads version {VERSION}",
        remedy="Use the poseloom that wrote it",
        file=file,
    )


def _header(content: dict[str, Any]) -> RecordingHeader:
    layout: dict[str, Any] = content["layout"]
    if not 0 < len(layout["sensors"]) <= _MOST_SENSORS:
        raise ValueError(f"a layout of {len(layout['sensors'])} sensors")
    truth: dict[str, Any] | None = content["truth"]
    skeleton = skeleton_from_json(content["skeleton"])
    truth_skeleton = None
    if truth is not None:
        same = truth["skeleton"] == content["skeleton"]
        truth_skeleton = skeleton if same else skeleton_from_json(truth["skeleton"])
    return RecordingHeader(
        layout=make_layout(
            str(layout["name"]),
            [SensorSpec(str(s["name"]), SensorKind(s["kind"]), str(s["bone"])) for s in layout["sensors"]],
            rate(layout["rate"]),
        ),
        placements=placements_from_json(content["placements"]),
        skeleton=skeleton,
        name=str(content["name"]),
        settings={str(key): str(value) for key, value in content["settings"].items()},
        truth_skeleton=truth_skeleton,
        truth_name="" if truth is None else str(truth["name"]),
    )
