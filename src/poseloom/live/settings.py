"""What a person can ask of a live session, defined once: for the command line, its configuration file and programs."""

import tomllib
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any, cast

from poseloom.errors import FormatError, SensorError, unknown_name
from poseloom.live.addresses import LOOPBACK


@dataclass(frozen=True)
class SettingFacts:
    """What is known of a setting beside its name, type and default.

    Attributes:
        help: What it is, for `poseloom live --help`.
        kind: What its value is, in a word: "URL", "FILE"; empty: as its type says.
        short: Letter of a short option; empty: none.
        lowest: Its lowest value, if it is a number.
        highest: Its highest value.
    """

    help: str
    kind: str = ""
    short: str = ""
    lowest: float | None = None
    highest: float | None = None


def facts_of(setting: "Field[Any]") -> SettingFacts:
    """What is known of a field of `LiveSettings`."""
    facts = setting.metadata["facts"]
    assert isinstance(facts, SettingFacts)
    return facts


def _setting(default: Any, help: str, kind: str = "", short: str = "", **bounds: float) -> Any:
    return field(default=default, metadata={"facts": SettingFacts(help, kind, short, **bounds)})


_SOURCE = (
    "Where samples come from: vmc://[HOST]:PORT, udp://[HOST]:PORT, serial:///DEVICE, lines:///FILE, replay:///FILE,"
    " simulate://CLIP; keys behind a question mark, as in vmc://:39539?rate=90 (docs/live.md). May be repeated."
)


@dataclass(frozen=True)
class LiveSettings:
    """What a person can ask of a live session: options of `poseloom live`, and keys of its configuration file.

    A new setting is one line here: its option, its key and their checks are made from it.
    """

    source: tuple[str, ...] = _setting((), _SOURCE, "URL", "s")
    method: str = _setting("", "How; with a library local-filter, else inverse-kinematics.", "NAME", "m")
    library: str = _setting("", "Folder of a motion library.", "FOLDER", "l")
    model: str = _setting("", "A fitted model, from `poseloom fit`.", "FILE")
    calibration: str = _setting("", "Sizes and placements, from `poseloom calibrate`.", "FILE", "c")
    layout: str = _setting("", "Layout of all sources together; else as the sources say.", "NAME")
    view: bool = _setting(False, "Show the figure in a browser.")
    port: int = _setting(0, "The viewer's port; else the first that is free from 8080 on.", lowest=0.0, highest=65535.0)
    record: str = _setting("", "File to record to (.mcap).", "FILE", "r")
    send: tuple[str, ...] = _setting((), "Send poses there: vmc://[HOST]:PORT. May be repeated.", "URL")
    export: str = _setting("", "File for the motion at the end: .bvh, .glb, .npz or .csv.", "FILE")
    bind: str = _setting(
        LOOPBACK,
        "Address on which the viewer listens; 127.0.0.1 unless given. A source's own stands in the source:"
        " vmc://0.0.0.0:39539.",
        "HOST",
    )
    token: str = _setting(
        "",
        "Secret that the viewer's visitors must know, on this machine too; 'new' draws one. Else one is drawn where"
        " other machines can reach the viewer, and none is needed on this one.",
        "SECRET",
    )
    folder: str = _setting(".", "Where recordings and calibrations go that are asked for in the viewer.", "FOLDER")
    seconds: float = _setting(0.0, "End after so many seconds; 0: when it is ended.", lowest=0.0)

    def __post_init__(self) -> None:
        for setting in fields(self):
            facts, value = facts_of(setting), getattr(self, setting.name)
            if facts.lowest is not None and not value >= facts.lowest:
                raise SensorError(f"{setting.name} is {value}", remedy=f"Give {facts.lowest:g} or more")
            if facts.highest is not None and not value <= facts.highest:
                raise SensorError(f"{setting.name} is {value}", remedy=f"Give {facts.highest:g} or less")


LiveSettings.__doc__ = f"{LiveSettings.__doc__}\n    Attributes:\n" + "\n".join(
    f"        {setting.name}: {facts_of(setting).help}" for setting in fields(LiveSettings)
)


def read_settings(path: Path, flags: Mapping[str, Any]) -> LiveSettings:
    """Settings from a TOML file, over which flags win.

    Args:
        path: The file; its keys are the fields of `LiveSettings`.
        flags: What was given on the command line, by field; None where nothing was.

    Raises:
        FormatError: for a file that cannot be read, an unknown key, or a value of another type.
        SensorError: for a number out of its range.
    """
    from poseloom.formats._files import read_bytes  # here: `poseloom --help` needs the fields alone, at once

    try:
        content = tomllib.loads(read_bytes(path).decode("utf-8"))
    except RecursionError:
        raise FormatError("this is nested without end", remedy="Mend the file", file=path) from None
    except ValueError as error:
        raise FormatError("this is no TOML", cause=str(error), remedy="Mend the file", file=path) from None
    return make_settings({**{key: _checked(key, value, path) for key, value in content.items()}, **_given(flags)})


def make_settings(flags: Mapping[str, Any]) -> LiveSettings:
    """Settings from what was given on the command line alone. Raises SensorError for a number out of its range."""
    return LiveSettings(**_given(flags))


def _given(flags: Mapping[str, Any]) -> dict[str, Any]:
    given = {key: value for key, value in flags.items() if value is not None}
    return {key: tuple(cast("list[str]", value)) if isinstance(value, list) else value for key, value in given.items()}


def _checked(key: str, value: Any, path: Path) -> Any:
    known = {field.name: field for field in fields(LiveSettings)}
    if key not in known:
        raise unknown_name("key", key, known, FormatError).at(path)
    default = known[key].default
    if isinstance(default, tuple) and isinstance(value, str):
        return (value,)
    if isinstance(default, tuple):
        items = cast("list[Any]", value) if isinstance(value, list) else [None]
        if all(isinstance(item, str) for item in items):
            return tuple(str(item) for item in items)
    elif isinstance(value, type(default)) and isinstance(value, bool) == isinstance(default, bool):
        return value
    elif isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool) and abs(value) < 1e300:
        return float(value)
    wanted = "a text or a list of texts" if isinstance(default, tuple) else f"a {type(default).__name__}"
    raise FormatError(f"the key {key!r} is not {wanted}", remedy="Mend the file", file=path)
