"""From what a person asked for, on the command line or in a file, to the plan of a session."""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from poseloom.calibration.calibration import read_calibration
from poseloom.errors import SensorError
from poseloom.library import MotionLibrary, open_library
from poseloom.live.contract import Sink
from poseloom.live.reprocess import CONFIGURATION, LIBRARY_DIGEST, MODEL_DIGEST, file_sha256
from poseloom.live.responsiveness import coarse_clock_note
from poseloom.live.session_plan import SessionPlan
from poseloom.live.settings import LiveSettings
from poseloom.live.sinks.motion_export import MotionExport
from poseloom.live.source import Source
from poseloom.live.source_replay import ReplaySource
from poseloom.live.source_serial import LineFileSource
from poseloom.live.specifications import make_sender, make_source
from poseloom.methods.choose import default_method, maker, ready_methods
from poseloom.methods.reconstruction import rate_note
from poseloom.sensors import (
    Placement,
    SensorLayout,
    SensorSpec,
    default_placements,
    layout,
    layout_names,
    make_layout,
)
from poseloom.sensors.rate import resample_recording, same_rate
from poseloom.skeleton.body import average_body
from poseloom.skeleton.skeleton import Skeleton


def plan_session(settings: LiveSettings, sinks: Sequence[Sink] = ()) -> SessionPlan:
    """The plan of a session.

    Args:
        settings: What was asked for.
        sinks: Sinks beside those that the settings name: the viewer, the terminal.

    Raises:
        PoseloomError: for anything that is missing, cannot be read or does not fit.
    """
    if not settings.source:
        raise SensorError(
            "no source was given",
            remedy="Give --source, such as vmc://:39539, udp://:9870, serial:///dev/ttyACM0 or simulate://sample:walk",
        )
    sources = tuple(make_source(text) for text in settings.source)
    _check_speeds(sources)
    heard = joint_layout(sources, settings.layout)
    library = open_library(Path(settings.library)) if settings.library else None
    make = maker(heard, library, settings.model or None)
    method = settings.method or default_method(heard, library, settings.model or None)
    worn = replace(heard, rate=make(method).layout.rate)
    sources, notes = _at_the_sessions_rate(sources, worn.rate)
    skeleton, placements, calibrated = _wearer(settings, sources, worn)
    exports = (MotionExport(Path(settings.export)),) if settings.export else ()
    return SessionPlan(
        sources=sources,
        layout=worn,
        skeleton=skeleton,
        placements=placements,
        method=method,
        make=make,
        sinks=(*(make_sender(text) for text in settings.send), *exports, *sinks),
        methods=tuple(dict.fromkeys((method, *ready_methods(heard, library)))),
        calibrated=calibrated,
        record=Path(settings.record) if settings.record else None,
        folder=Path(settings.folder),
        settings=_told(settings, library),
        seconds=settings.seconds or None,
        notes=(*notes, *filter(None, [coarse_clock_note()])),
    )


def _check_speeds(sources: Sequence[Source]) -> None:
    """Raises SensorError where one of several sources is played at another speed: they would share no time."""
    for source in sources:
        if len(sources) > 1 and isinstance(source, ReplaySource | LineFileSource) and source.speed != 1.0:
            raise SensorError(
                f"{source.name} is played at {source.speed:g} times its speed, beside other sources at theirs",
                remedy="Leave the speed out, or play it alone",
            )


def joint_layout(sources: Sequence[Source], name: str) -> SensorLayout:
    """The sensors of all sources: a layout that is named, or a built-in one of the same sensors, or just these.

    Raises:
        SensorError: if the layout is unknown, or a sensor of it is no source's.
    """
    sensors: list[SensorSpec] = [sensor for source in sources for sensor in source.layout.sensors]
    rate = max(source.layout.rate for source in sources)
    if name:
        named = layout(name)
        spoken = {sensor.name for sensor in sensors}
        mute = [sensor for sensor in named.names if sensor not in spoken]
        if mute:
            raise SensorError(
                f"no source speaks of {', '.join(mute)}", remedy="Add a source for them, or choose another layout"
            )
        return replace(named, rate=rate)
    if len(sources) == 1:
        return sources[0].layout
    for known in map(layout, layout_names()):
        if set(known.sensors) == set(sensors) and len(known) == len(sensors):
            return replace(known, rate=rate)
    return make_layout("+".join(source.layout.name for source in sources), sensors, rate)


def _at_the_sessions_rate(sources: Sequence[Source], rate: float) -> tuple[tuple[Source, ...], tuple[str, ...]]:
    """Recordings that are replayed, resampled to the session's rate as `poseloom reconstruct` would; devices as is."""
    at_rate: list[Source] = []
    notes: list[str] = []
    for source in sources:
        if isinstance(source, ReplaySource) and not source.loop and not same_rate(source.layout.rate, rate):
            notes.append(f"{source.name}: {rate_note(source.layout.rate, rate)}")
            recording = resample_recording(source.recording, rate)
            source = ReplaySource(recording, source.name, source.speed, source.loop)
        at_rate.append(source)
    return tuple(at_rate), tuple(notes)


def _wearer(
    settings: LiveSettings, sources: Sequence[Source], worn: SensorLayout
) -> tuple[Skeleton, tuple[Placement, ...], bool]:
    """Bones and placements: as calibrated, as a recording says, or the average body's."""
    if settings.calibration:
        calibration = read_calibration(Path(settings.calibration))
        known = dict(zip(calibration.sensors, calibration.placements, strict=True))
        missing = [name for name in worn.names if name not in known]
        if missing:
            raise SensorError(
                f"the calibration has no sensor {', '.join(missing)}",
                cause=f"it was made with {', '.join(calibration.sensors)}",
                remedy="Calibrate with the sensors that are worn now",
                file=settings.calibration,
            )
        return calibration.skeleton, tuple(known[name] for name in worn.names), True
    replays = [source for source in sources if isinstance(source, ReplaySource)]
    if len(sources) == 1 and replays:
        recording = replays[0].recording
        places = dict(zip(recording.layout.names, recording.placements, strict=True))
        return recording.skeleton, tuple(places[name] for name in worn.names), True
    body = average_body()
    return body, default_placements(worn, body), False


def _told(settings: LiveSettings, library: MotionLibrary | None) -> dict[str, str]:
    """The configuration as a recording keeps it, with digests of what the method was fitted to."""
    # Whole paths: the recording may be reprocessed from another folder.
    whole = {key: str(Path(value).absolute()) for key in ("library", "model") if (value := getattr(settings, key))}
    told = {CONFIGURATION: json.dumps(asdict(replace(settings, **whole)))}
    if library is not None:
        told[LIBRARY_DIGEST] = library.digest
    if settings.model:
        told[MODEL_DIGEST] = file_sha256(Path(settings.model))
    return told
