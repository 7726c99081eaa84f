"""The viewer's web server: viser's, with a guard before it and without its share button."""

import contextlib
import io
import socket
import threading
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, cast

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from poseloom.errors import ViewerError
from poseloom.viewer.access import Access, access_for

DEFAULT_PORT = 8080
_TRIED_PORTS = 50

_Answer = Callable[[ServerConnection, Request], Response | None]

_starting = threading.Lock()


class _Server(viser.ViserServer):
    """viser's server without the tunnel to a public address that any visitor could otherwise open."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: a session is nobody else's business."""
        return None


@dataclass(frozen=True)
class OpenServer:
    """A server that listens.

    Attributes:
        viser: Scene and panels.
        url: The address to open in a browser, with the token where one is needed.
        access: Who may see it.
        bind: The address that it listens at.
    """

    viser: viser.ViserServer
    url: str
    access: Access
    bind: str = "127.0.0.1"

    @property
    def exposure(self) -> str:
        """Who else can look and press buttons; empty where only this machine can."""
        if self.access.local:
            return ""
        return (
            f"the viewer listens on {self.bind}: other machines that have the whole address, with its token, can look "
            "and press every button, and the connection is not encrypted; --bind 127.0.0.1 confines it to this machine"
        )

    def close(self) -> None:
        """Stops listening and sends every visitor away."""
        with contextlib.redirect_stdout(io.StringIO()):  # viser takes its leave on the terminal
            self.viser.stop()


def open_server(bind: str = "127.0.0.1", port: int | None = None, token: str = "") -> OpenServer:
    """Starts a viewer's server in a thread of its own.

    Args:
        bind: The address to listen at. Other than the loopback, only who brings the token in the address is served.
        port: Where exactly; the first free one from 8080 on unless given. 0 leaves the choice to the system.
        token: Secret that a visitor must know, on the loopback too; see `access_for`.

    Raises:
        ViewerError: if it cannot listen there, or the token cannot be one.
    """
    access = access_for(bind, token)
    chosen = _port(bind, port)
    with _starting, _guarding(access) as guarded, contextlib.redirect_stdout(io.StringIO()):
        server = _Server(host=bind, port=chosen, label="poseloom", verbose=False)
    if not guarded:
        # Better no viewer than one that lets everybody in.
        server.stop()
        raise ViewerError(
            "the viewer's guard could not be put before its server",
            cause="this version of viser listens in another way than the ones that are known",
            remedy="Install viser 1.1",
        )
    query = f"?token={access.token}" if access.token else ""
    return OpenServer(server, f"http://{_shown_host(bind)}:{server.get_port()}/{query}", access, bind)


@contextlib.contextmanager
def _guarding(access: Access) -> Generator[list[bool]]:
    """While this lasts, servers of websockets ask `access` first; the list says whether one was started.

    viser gives no way to look at requests, and a proxy before it would cost every frame and leave its port unguarded.
    """
    serve: Any = websockets.asyncio.server.serve
    started: list[bool] = []

    def guarded_serve(handler: Any, host: str, port: int, *, process_request: _Answer, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Response | None:
            return access.answer(request) or process_request(connection, request)

        started.append(True)
        return serve(handler, host, port, process_request=answer, **options)

    websockets.asyncio.server.serve = cast(Any, guarded_serve)
    try:
        yield started
    finally:
        websockets.asyncio.server.serve = serve


def _port(bind: str, port: int | None) -> int:
    """A port that can be listened at; asked beforehand, because viser would try a thousand others in silence."""
    ports = [port] if port is not None else [*range(DEFAULT_PORT, DEFAULT_PORT + _TRIED_PORTS), 0]
    reason = ""
    for candidate in ports:
        try:
            family, _, _, _, address = socket.getaddrinfo(bind, candidate, type=socket.SOCK_STREAM)[0]
            with socket.socket(family, socket.SOCK_STREAM) as trial:
                # On Windows SO_REUSEADDR would share a port that another program listens at.
                exclusive = getattr(socket, "SO_EXCLUSIVEADDRUSE", socket.SO_REUSEADDR)
                trial.setsockopt(socket.SOL_SOCKET, exclusive, 1)
                trial.bind(address)
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            continue
        return candidate
    where = bind if port is None else f"{bind}, port {port}"
    raise ViewerError(
        f"the viewer cannot listen at {where}",
        cause=reason,
        remedy="Choose another --port, or an address of this machine with --bind",
    )


def _shown_host(bind: str) -> str:
    """The address that a person can open: where all are listened at, the one that faces the network."""
    if bind not in ("0.0.0.0", "::", ""):
        return f"[{bind}]" if ":" in bind else bind
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # Sends nothing: it only asks which of this machine's addresses faces the network.
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()
