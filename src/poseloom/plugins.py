"""Tables of methods, formats and sources, which installed packages extend through entry points.

A package names its rows in its `pyproject.toml`, under the group of the table:

    [project.entry-points."poseloom.methods"]
    my-method = "my_package:METHOD"

Entry points are listed on the first use of a name and loaded when a name that is not poseloom's own is asked for, or
all names. One that cannot be loaded is left out with a `PluginWarning` and leaves the others alone.
"""

import warnings
from collections.abc import Iterator, Mapping
from functools import cached_property
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from poseloom.errors import PoseloomError, unknown_name

Row = TypeVar("Row")

METHODS_GROUP = "poseloom.methods"
FORMATS_GROUP = "poseloom.formats"
SOURCES_GROUP = "poseloom.sources"


class PluginWarning(UserWarning):
    """A row of another package is left out."""


class Registry(Mapping[str, Row]):
    """Rows by name: poseloom's own, then those of installed packages.

    Args:
        group: Group of entry points that extends it.
        what: What a row is, for messages: "method".
        kind: Class of a row.
        own: poseloom's own rows, in their order.
        error: Class of the error for a name that has no row.
    """

    def __init__(
        self, group: str, what: str, kind: type[Row], own: Mapping[str, Row], error: type[PoseloomError] = PoseloomError
    ) -> None:
        self.group, self.what, self.kind, self.error = group, what, kind, error
        self._own = dict(own)

    def row(self, name: str) -> Row:
        """The row of a name. Raises the table's error for an unknown or refused name, or a plug-in that is broken."""
        if name not in self:
            if name in self._refused:
                raise self.error(
                    f"the {self.what} {name!r} of an installed package cannot be used",
                    cause=self._refused[name],
                    remedy="Mend or uninstall the package",
                )
            raise unknown_name(self.what, name, self, self.error)
        return self[name]

    def __getitem__(self, name: str) -> Row:
        _ = self._found  # a clash with a name of poseloom's own is told even where nothing else is loaded
        return self._own[name] if name in self._own else self._loaded[0][name]

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from self._loaded[0]

    def __len__(self) -> int:
        return len(self._own) + len(self._loaded[0])

    @property
    def own(self) -> tuple[str, ...]:
        """Names of poseloom's own rows."""
        return tuple(self._own)

    @cached_property
    def _found(self) -> tuple[Mapping[str, EntryPoint], Mapping[str, str]]:
        """Entry points by name, and why others are refused."""
        by_name: dict[str, list[EntryPoint]] = {}
        for point in entry_points(group=self.group):
            by_name.setdefault(point.name, []).append(point)
        found: dict[str, EntryPoint] = {}
        refused: dict[str, str] = {}
        for name, points in sorted(by_name.items()):
            owners = [*(["poseloom"] if name in self._own else []), *sorted(map(_distribution, points))]
            if len(owners) == 1:
                found[name] = points[0]
                continue
            clash = f"{' and '.join(owners)} each have a {self.what} of this name"
            used = "; poseloom's own is used" if name in self._own else "; none of them is used"
            _warn(f"{self.what} {name!r}: {clash}{used}")
            refused[name] = clash
        return found, refused

    @cached_property
    def _loaded(self) -> tuple[Mapping[str, Row], Mapping[str, str]]:
        """Rows of other packages, and why others are broken."""
        rows: dict[str, Row] = {}
        broken: dict[str, str] = {}
        for name, point in self._found[0].items():
            try:
                row = point.load()
                if not isinstance(row, self.kind):
                    raise TypeError(f"{point.value} is a {type(row).__name__}, not a {self.kind.__name__}")
                rows[name] = row
            except Exception as error:  # whatever another's package does when it is imported
                broken[name] = f"{_distribution(point)} fails with {type(error).__name__}: {error}"
                _warn(f"{self.what} {name!r} is left out: {broken[name]}")
        return rows, broken

    @property
    def _refused(self) -> Mapping[str, str]:
        return {**self._found[1], **self._loaded[1]}


def _distribution(point: EntryPoint) -> str:
    return "an unknown package" if point.dist is None else point.dist.name


def _warn(text: str) -> None:
    warnings.warn(text, PluginWarning, stacklevel=2)
