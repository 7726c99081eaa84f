"""A column map: a small TOML file that says which columns of a foreign table hold what, and in what units.

    time = "Zeit"                   # column names as the table has them
    time_unit = "ms"
    quaternion_order = "xyzw"

    [sensors.head]
    position = ["hx", "hy", "hz"]
    quaternion = ["hqx", "hqy", "hqz", "hqw"]

Sensors of IMU tables have `acceleration`, `angular_rate` and `quaternion`; those of tracker tables `position` and
`quaternion`.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

from poseloom.errors import FormatError, unknown_name
from poseloom.formats._files import decode, read_bytes

_SETTINGS = (
    "time", "time_unit", "rate", "accel_unit", "gyro_unit", "quaternion_order", "length_unit", "up", "handedness",
    "layout", "name",
)  # fmt: skip
_PARTS: Mapping[str, int] = MappingProxyType({"acceleration": 3, "angular_rate": 3, "quaternion": 4, "position": 3})


@dataclass(frozen=True)
class ColumnMap:
    """What a column map says.

    Attributes:
        file: The TOML file.
        sensors: By sensor and part (`acceleration`, `angular_rate`, `quaternion`, `position`) the columns' names.
        settings: Everything else, as text; `rate` is a number.
    """

    file: Path
    sensors: Mapping[str, Mapping[str, tuple[str, ...]]]
    settings: Mapping[str, str]

    @property
    def rate(self) -> float | None:
        """Samples a second, if the map says it."""
        return float(self.settings["rate"]) if "rate" in self.settings else None

    def get(self, setting: str) -> str:
        """A setting; empty if the map does not have it."""
        return self.settings.get(setting, "")


def read_column_map(path: Path) -> ColumnMap:
    """Reads a column map.

    Raises:
        FormatError: for what is no TOML, an unknown key, or a part with another number of columns.
    """
    try:
        content = tomllib.loads(decode(read_bytes(path)))
    except (ValueError, RecursionError) as error:
        raise FormatError(
            "this is no column map", cause=f"its TOML cannot be read: {error}"[:200], remedy="Mend it", file=path
        ) from None
    sensors = content.pop("sensors", {})
    settings: dict[str, str] = {}
    for key, value in content.items():
        if key not in _SETTINGS:
            raise unknown_name("setting", key[:60], (*_SETTINGS, "sensors"), FormatError).at(path)
        if key == "rate" and not (isinstance(value, int | float) and math.isfinite(value) and value > 0):
            raise FormatError(f"the rate is {str(value)[:40]!r}", remedy="Give samples a second", file=path)
        if not isinstance(value, str | int | float):
            raise FormatError(f"{key} is no text or number", remedy=f'Write {key} = "..."', file=path)
        settings[key] = str(value)
    if not isinstance(sensors, dict):
        raise FormatError("sensors is no table", remedy="Write [sensors.NAME]", file=path)
    read = {str(name): _parts(str(name), parts, path) for name, parts in cast(dict[str, Any], sensors).items()}
    return ColumnMap(path, MappingProxyType(read), MappingProxyType(settings))


def _parts(sensor: str, parts: Any, path: Path) -> Mapping[str, tuple[str, ...]]:
    if not isinstance(parts, dict) or not parts:
        raise FormatError(f"sensor {sensor!r} has no columns", remedy=f"Give one of {', '.join(_PARTS)}", file=path)
    out: dict[str, tuple[str, ...]] = {}
    for part, names in cast(dict[str, Any], parts).items():
        if part not in _PARTS:
            raise unknown_name(f"part of sensor {sensor!r}", part[:60], _PARTS, FormatError).at(path)
        columns = cast(list[object], names) if isinstance(names, list) else []
        if len(columns) != _PARTS[part] or not all(isinstance(name, str) for name in columns):
            raise FormatError(
                f"{part} of sensor {sensor!r} is not a list of {_PARTS[part]} column names",
                remedy=f"Write {part} = [" + ", ".join(['"..."'] * _PARTS[part]) + "]",
                file=path,
            )
        out[part] = tuple(str(name) for name in columns)
    return MappingProxyType(out)
