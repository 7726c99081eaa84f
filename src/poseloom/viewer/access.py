"""Who may see a viewer: checked on every request before a byte of the page or of the websocket is served.

On the loopback interface every program at the machine may look, unless a token was asked for, but no foreign web page
that the same browser has open: the `Host` must be this machine's and a websocket's `Origin` this viewer's own page.
Bound elsewhere, a token is needed: it stands in the address that the person opens, and from then on in a cookie.
"""

import hmac
import http
import ipaddress
import re
import secrets
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import SplitResult, parse_qs, urlsplit

from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from poseloom.errors import ViewerError

_REFUSAL = {
    http.HTTPStatus.UNAUTHORIZED: "This viewer needs a token. Open the whole address that poseloom printed.\n",
    http.HTTPStatus.FORBIDDEN: "This viewer answers its own page only.\n",
}
_LOCAL_NAME = "localhost"
NEW_TOKEN = "new"
_TOKEN = re.compile(r"[A-Za-z0-9_.-]{0,128}")
_SHORTEST = 16
"""Characters of a token that other machines may guess at."""


@dataclass(frozen=True)
class Access:
    """What a request must bring.

    Attributes:
        token: The secret that a visitor must know; empty where none is needed.
        local: Whether only this machine's own names are answered to.
    """

    token: str
    local: bool

    def answer(self, request: Request) -> Response | None:
        """None for a request that may pass; otherwise what to send in place of anything of the viewer's.

        A page that is asked for with the token in its address is answered with the cookie and sent on to the address
        without it, so that the token does not stay in the browser's history.
        """
        host = request.headers.get("Host", "")
        origin = request.headers.get("Origin")
        if self.local and not _is_local(_split(f"//{host}").hostname or ""):
            return _refuse(http.HTTPStatus.FORBIDDEN)
        if origin is not None and _split(origin).netloc != host:
            return _refuse(http.HTTPStatus.FORBIDDEN)
        if not self.token or self._knows(_cookie(request, cookie_name(host))):
            return None
        if not self._knows(_token_of(request)):
            return _refuse(http.HTTPStatus.UNAUTHORIZED)
        if request.headers.get("Upgrade") is not None:
            return None
        cookie = f"{cookie_name(host)}={self.token}; Path=/; HttpOnly; SameSite=Lax"
        return _response(http.HTTPStatus.SEE_OTHER, "", {"Location": "/", "Set-Cookie": cookie})

    def _knows(self, said: str) -> bool:
        return hmac.compare_digest(said.encode(), self.token.encode())


def access_for(bind: str, token: str = "") -> Access:
    """The rules for a viewer that listens at an address.

    Args:
        bind: The address.
        token: The secret that every visitor must know, on the loopback too; "new" draws one. Empty: one is drawn
            unless the address is the loopback, where none is needed.

    Raises:
        ViewerError: for a token that cannot stand in an address, or that is too short for other machines.
    """
    local = _is_local(bind)
    if token == NEW_TOKEN or not (token or local):
        token = secrets.token_urlsafe(16)
    if _TOKEN.fullmatch(token) is None or (not local and len(token) < _SHORTEST):
        raise ViewerError(
            "the token cannot be used",
            cause=f"it must be letters, digits, '-', '_' and '.'; {_SHORTEST} or more where other machines can look",
            remedy=f"Choose another --token, or --token {NEW_TOKEN}, which draws one",
        )
    return Access(token, local)


def cookie_name(host: str) -> str:
    """Name of the cookie that holds the token; cookies do not tell ports apart, so the name does."""
    try:
        port = urlsplit(f"//{host}").port
    except ValueError:
        port = None
    return f"poseloom-{port or 80}"


def _is_local(name: str) -> bool:
    if name.lower() == _LOCAL_NAME:
        return True
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _cookie(request: Request, name: str) -> str:
    for header in request.headers.get_all("Cookie"):
        try:
            cookies = SimpleCookie(header)
        except CookieError:
            continue
        if name in cookies:
            return cookies[name].value
    return ""


def _token_of(request: Request) -> str:
    return parse_qs(_split(request.path).query).get("token", [""])[0]


def _split(address: str) -> SplitResult:
    """The parts of an address; of one that is none, nothing."""
    try:
        return urlsplit(address)
    except ValueError:
        return urlsplit("")


def _refuse(status: http.HTTPStatus) -> Response:
    return _response(status, _REFUSAL[status], {})


def _response(status: http.HTTPStatus, text: str, headers: dict[str, str]) -> Response:
    body = text.encode()
    fields = Headers(
        {
            **headers,
            "Content-Type": "text/plain; charset=utf-8",
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Referrer-Policy": "no-referrer",
        }
    )
    return Response(status.value, status.phrase, fields, body)
