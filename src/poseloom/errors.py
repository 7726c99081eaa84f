"""The one family of exceptions that poseloom raises on purpose.

Every message tells the fact, the cause and the remedy, and carries the file, line, channel, joint or frame where there
is one. The command line prints it without a traceback and exits with code 2.
"""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import TypeVar


class PoseloomError(Exception):
    """Something that the user gave, or the machine did, keeps poseloom from going on.

    Args:
        fact: What happened, as a sentence without its full stop.
        cause: Why, as far as known.
        remedy: What the user can do.
        file: The file it is about.
        line: The line in that file, counted from 1.
    """

    def __init__(
        self, fact: str, *, cause: str = "", remedy: str = "", file: str | Path | None = None, line: int | None = None
    ) -> None:
        self.fact = fact
        self.cause = cause
        self.remedy = remedy
        self.file = None if file is None else str(file)
        self.line = line
        super().__init__(self._message())

    def _message(self) -> str:
        place = "" if self.file is None else self.file if self.line is None else f"{self.file}:{self.line}"
        sentences = [text.rstrip(".") + "." for text in (self.fact, self.cause, self.remedy) if text]
        return (f"{place}: " if place else "") + " ".join(sentences)

    def __reduce__(self) -> tuple[object, ...]:
        # Keyword-only arguments do not survive the default pickling between the processes of a pool.
        return (_rebuild, (type(self), self.fact, self.cause, self.remedy, self.file, self.line))

    def at(self, file: str | Path, line: int | None = None) -> "PoseloomError":
        """The same error with the file (and line) it is about filled in."""
        return type(self)(self.fact, cause=self.cause, remedy=self.remedy, file=file, line=line or self.line)


def _rebuild(
    kind: type[PoseloomError], fact: str, cause: str, remedy: str, file: str | None, line: int | None
) -> PoseloomError:
    return kind(fact, cause=cause, remedy=remedy, file=file, line=line)


class FormatError(PoseloomError):
    """A file is not what its name or header says."""


class SkeletonError(PoseloomError):
    """A hierarchy of bones is cyclic, disconnected or otherwise impossible, or a bone is unknown."""


class RetargetError(PoseloomError):
    """A source skeleton cannot be mapped to the body."""


class LibraryError(PoseloomError):
    """A motion library is missing, damaged, of another version, or cannot serve the request."""


class SensorError(PoseloomError):
    """A layout, placement, channel or recording does not fit."""


class MethodError(PoseloomError):
    """A method is unknown, or cannot run with what it was given."""


class ViewerError(PoseloomError):
    """The viewer cannot listen where it was told to, or has nothing to show."""


Item = TypeVar("Item")


class Named(dict[str, Item]):
    """Things by name, as a dictionary whose error for an unknown name lists and suggests names.

    Args:
        what: What they are, for the error: "sample motion".
        items: The things.
        kind: Of the error.
    """

    def __init__(self, what: str, items: Mapping[str, Item], kind: type[PoseloomError] = PoseloomError) -> None:
        super().__init__(items)
        self._what, self._kind = what, kind

    def __missing__(self, name: str) -> Item:
        raise unknown_name(self._what, str(name), self, self._kind)


def unknown_name(
    what: str, name: str, valid: Iterable[str], kind: type[PoseloomError] = PoseloomError
) -> PoseloomError:
    """The error for a name that is none of the valid ones: it lists them and suggests the nearest."""
    names = list(valid)
    near = get_close_matches(name, names, n=1)
    hint = f"Did you mean {near[0]!r}? " if near else ""
    return kind(
        f"unknown {what} {name!r}",
        remedy=f"{hint}Valid names: {', '.join(names)}",
    )


def missing_extra(need: str, extra: str) -> PoseloomError:
    """The error for a part that needs packages which only an extra of poseloom installs.

    Args:
        need: What needs which package, as a sentence without its full stop.
        extra: Name of the extra.
    """
    return PoseloomError(
        need,
        cause=f"the packages of the extra `{extra}` are not installed",
        remedy=f'Install them with `pip install "poseloom[{extra}]"`',
    )
