"""Addresses of sources and receivers as URLs: `vmc://0.0.0.0:39539?rate=60`, `replay:///path/session.mcap?speed=2`."""

import ipaddress
import math
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, unquote

from poseloom.errors import PoseloomError, SensorError, unknown_name

LOOPBACK = "127.0.0.1"
_FLAGS = {"1": True, "true": True, "yes": True, "on": True, "0": False, "false": False, "no": False, "off": False}
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*")
_BROKEN_ESCAPE = re.compile(r"%(?![0-9A-Fa-f]{2})")
_WINDOWS = re.compile(r"/([A-Za-z]:([/\\]|$)|COM\d+$)")


@dataclass(frozen=True)
class Address:
    """A URL, taken apart: `SCHEME://LOCATION?KEY=VALUE&KEY=VALUE`.

    Attributes:
        scheme: What stands before `://`, in lower case.
        location: What stands between `://` and `?`, as written: a host and port, or a path.
        query: Values by key, percent-decoded; a `+` stands for itself; a key without `=` has the value "1".
        text: The URL as written.
    """

    scheme: str
    location: str
    query: Mapping[str, tuple[str, ...]]
    text: str

    def one(self, key: str, default: str = "") -> str:
        """The value of a key, which may be given once. Raises SensorError."""
        values = self.query.get(key, ())
        if len(values) > 1:
            raise self.error(f"has {key} more than once", "Give it once")
        return values[0] if values else default

    def many(self, key: str) -> tuple[str, ...]:
        """All values of a key."""
        return self.query.get(key, ())

    def number(self, key: str, default: float) -> float:
        """The value of a key as a positive number. Raises SensorError."""
        text = self.one(key, str(default))
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 < value < 1e9:
            raise self.error(f"has no {key}: {text!r} is no positive number", f"Write a number, such as {key}=60")
        return value

    def whole(self, key: str, default: int) -> int:
        """The value of a key as a whole number from 0 on. Raises SensorError."""
        text = self.one(key, str(default))
        if not (text.isascii() and text.isdigit() and len(text) < 16):
            remedy = f"Write a number, such as {key}={default}"
            raise self.error(f"has no {key}: {text!r} is no whole number from 0 on", remedy)
        return int(text)

    def flag(self, key: str) -> bool:
        """Whether a key is switched on; a key that is not there is off. Raises SensorError."""
        text = self.one(key, "0")
        if text.lower() not in _FLAGS:
            raise self.error(f"has {key}={text!r}, which is neither on nor off", f"Write {key}=1 or {key}=0")
        return _FLAGS[text.lower()]

    def only(self, keys: Collection[str]) -> None:
        """Raises SensorError for a key that is not among these."""
        for key in self.query:
            if key not in keys:
                error = unknown_name(f"key in the address {self.text!r}:", key, keys, SensorError)
                raise error if keys else self.error(f"has the key {key!r}", "Leave it out: there are none here")

    def path(self) -> Path:
        """The location as a file's path: `///` begins an absolute one, `///C:/` one of Windows."""
        text = unquote(self.location, errors="surrogateescape")
        if "\0" in text:
            raise self.error("has a zero byte in its path", "Leave it out")
        return Path(text[1:] if _WINDOWS.match(text) else text)

    def host_and_port(self, example: int, lowest: int = 0) -> tuple[str, int]:
        """The location as host and port; the host is this machine's loopback unless it is named.

        Args:
            example: A port, for errors.
            lowest: The lowest port: 0, to let the system choose, or 1.

        Raises:
            SensorError: for a port that is missing or out of range, or a host that cannot be one.
        """
        place, slash, path = self.location.partition("/")
        if path or (slash and not place):
            remedy = f"Write {self.scheme}://HOST:PORT, such as {self.scheme}://:{example}"
            raise self.error(f"has a path, {slash + path!r}, but {self.scheme} takes a host and a port", remedy)
        host, port = self._split(place, example)
        if not port:
            fitting = f"{self.scheme}://{bracketed(host)}:{example}"
            raise self.error("has no port", f"Write it behind a colon, such as {fitting}")
        if not (port.isascii() and port.isdigit()):
            raise self.error(
                f"has no port: {port!r} is no number", f"Write {self.scheme}://{bracketed(host)}:{example}"
            )
        if len(port) > 5 or not lowest <= int(port) <= 65535:
            raise self.error(f"has the port {port}", f"Choose a port from {lowest} to 65535")
        return host or LOOPBACK, int(port)

    @property
    def is_host_and_port(self) -> bool:
        """Whether the location can only be a host and a port, not a path: `192.168.1.7:4000`."""
        return re.fullmatch(r"[^/\\]*:\d+", self.location) is not None

    def _split(self, place: str, example: int) -> tuple[str, str]:
        """Host, without brackets, and port, as written."""
        if place.startswith("["):
            inside, closed, after = place[1:].partition("]")
            host = unquote(inside)
            if not closed or after[:1] not in ("", ":") or not _is_ip(host, 6):
                remedy = f"Write it in brackets, as in {self.scheme}://[::1]:{example}"
                raise self.error(f"has no IPv6 address in its brackets: {place!r}", remedy)
            return host, after[1:]
        host, _, port = place.rpartition(":") if ":" in place else (place, "", "")
        if ":" in host:
            inside = place if _is_ip(place, 6) and not _is_ip(host, 6) else host
            fitting = f"{self.scheme}://[{inside}]:{port if inside == host else example}"
            remedy = f"Write {fitting if _is_ip(inside, 6) else f'{self.scheme}://HOST:PORT, an IPv6 host in brackets'}"
            raise self.error("has more than one colon behind the scheme", remedy)
        if "@" in host or any(letter.isspace() for letter in unquote(host)):
            raise self.error(f"has no host: {host!r}", f"Write {self.scheme}://HOST:PORT")
        return unquote(host), port

    def error(self, fact: str, remedy: str) -> SensorError:
        """An error that begins with this address. `fact` is what is wrong with it: "has no port"."""
        return SensorError(f"the address {self.text!r} {fact}", remedy=remedy)


def parse_address(text: str, what: str, examples: Callable[[], Mapping[str, str]]) -> Address:
    """Takes a URL apart. Whether its scheme is one that is known is not looked at.

    Args:
        text: The URL.
        what: What it is the address of, for errors: "source".
        examples: Gives an address of each scheme that is known; called for errors alone.

    Raises:
        SensorError: for what is no URL, telling what to write instead; for a fragment, or a broken percent escape.
    """
    scheme, separator, rest = text.strip().partition("://")
    if not separator or not _SCHEME.fullmatch(scheme):
        raise _no_url(text, what, examples())
    location, _, query = rest.partition("?")
    address = Address(scheme.lower(), location, _parse_query(query), text)
    if "#" in rest:
        raise address.error("has a #", "Write %23 for a # that belongs to a name")
    if _BROKEN_ESCAPE.search(rest):
        raise address.error("has a % without two hexadecimal digits", "Write %25 for a % that belongs to a name")
    if "" in address.query:
        raise address.error("has a value without a key", "Write ?KEY=VALUE&KEY=VALUE")
    return address


def _parse_query(query: str) -> dict[str, tuple[str, ...]]:
    values: dict[str, tuple[str, ...]] = {}
    for word in query.split("&") if query else ():
        key, equals, value = word.partition("=")
        key = unquote(key)
        values[key] = (*values.get(key, ()), unquote(value, errors="surrogateescape") if equals else "1")
    return values


def write_address(scheme: str, location: str, query: Collection[tuple[str, str]] = ()) -> str:
    """The URL of these parts; the location may be a path, with any characters."""
    words = "&".join(f"{_quoted(key)}={_quoted(value)}" for key, value in query)
    return f"{scheme}://{_quoted(location)}{'?' if words else ''}{words}"


def _quoted(text: str) -> str:
    return quote(text, safe="/:,+[]~@!$'()*;\\", errors="surrogateescape")


def bracketed(host: str) -> str:
    """A host as it stands before a port: an IPv6 address in brackets."""
    return f"[{host}]" if ":" in host else host


def _is_ip(text: str, version: int) -> bool:
    try:
        return ipaddress.ip_address(text).version == version
    except ValueError:
        return False


def _no_url(text: str, what: str, examples: Mapping[str, str]) -> PoseloomError:
    """The error for what is no URL: it names the one that was meant, or all schemes."""
    instead = _instead(text.strip(), examples)
    if instead:
        return SensorError(f"{text!r} is no URL of a {what}", remedy=f"Write {instead}")
    scheme, colon, _ = text.strip().partition(":")
    if colon and scheme.isalnum() and not scheme.isdigit():
        return unknown_name(f"scheme of a {what} in {text!r}:", scheme, examples, SensorError)
    some = ", ".join(examples.values())
    return SensorError(f"{text!r} is no URL of a {what}: it has no scheme", remedy=f"Write an address such as {some}")


def _instead(text: str, examples: Mapping[str, str]) -> str:
    """The URL that was meant by words with a colon and commas, or by a bare file; empty if that cannot be told."""
    head, *words = text.split(",")
    scheme, _, location = head.partition(":")
    scheme, location = scheme.strip().lower(), location.strip()
    if scheme not in examples:
        kind = "replay" if text.endswith(".mcap") else "serial" if text.startswith("/dev/") else ""
        return write_address(kind, text) if kind in examples else ""
    query: list[tuple[str, str]] = []
    for word in words:
        key, equals, value = (part.strip() for part in word.partition("="))
        if equals or key in ("loop", "once"):
            query.append((key, value if equals else "1"))
        elif not query:
            location += f",{word}"
    port = examples[scheme].rpartition(":")[2]
    if port.isdigit():
        location = f":{location or port}" if location.isdigit() or not location else location
        location = location if ":" in location else f"{location}:{port}"
    return write_address(scheme, location, query) if location else examples[scheme]
