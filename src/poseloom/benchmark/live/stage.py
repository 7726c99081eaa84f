"""What every live measurement needs around the session: a library, devices in other processes, a browser's stand-in."""

import subprocess
import sys
import tempfile
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from poseloom.library import build_library
from poseloom.live.contract import Sink
from poseloom.live.session_plan import SessionPlan
from poseloom.live.settings import LiveSettings
from poseloom.live.setup import plan_session
from poseloom.live.sources_network import DatagramSource, VmcSource
from poseloom.viewer.session import SessionViewer

RATE = 60.0
CLIP = "sample:walk"
_READY = 60.0


@dataclass(frozen=True)
class Stage:
    """A folder with a library of the built-in motions but the walk, which the simulated devices perform.

    Attributes:
        folder: Where files go.
        library: The library, at 60 poses a second, mirrored.
        seed: Of what is drawn.
    """

    folder: Path
    library: Path
    seed: int = 0

    def plan(self, source: str, sinks: Sequence[Sink] = (), **settings: object) -> SessionPlan:
        """A session with the recommended method on the library.

        Args:
            source: As for `poseloom live --source`.
            sinks: Sinks beside those of the settings.
            settings: Further fields of `LiveSettings`.
        """
        known = {"library": str(self.library), **settings}
        return plan_session(replace(LiveSettings(source=(source,)), **known), sinks)  # pyright: ignore[reportArgumentType]


@contextmanager
def stage(seed: int = 0) -> Generator[Stage]:
    """Builds the library in a temporary folder, and removes it afterwards."""
    with tempfile.TemporaryDirectory(prefix="poseloom-live-") as name:
        folder = Path(name)
        library = folder / "library"
        build_library(["samples"], library, rate=RATE, mirror=True, exclude=("walk",))
        yield Stage(folder, library, seed)


def listening_port(plan: SessionPlan) -> int:
    """The port of a plan's one network source; 0 until it listens."""
    (source,) = plan.sources
    assert isinstance(source, VmcSource | DatagramSource)
    return source.port


@dataclass
class Device:
    """A simulated device in a process of its own.

    Attributes:
        process: The process.
        told: What it printed when it ended.
    """

    process: "subprocess.Popen[str]"
    told: list[str] = field(default_factory=list[str])

    def wait(self) -> int:
        """Waits until it ends; returns how many datagrams it says to have sent."""
        out, _ = self.process.communicate()
        words = out.split()
        return int(words[words.index("sent") + 1]) if "sent" in words else 0

    def kill(self) -> None:
        """Ends it at once."""
        self.process.kill()
        self.process.communicate()


def device(
    kind: str, port: int, seconds: float | None = None, rate: float = RATE, faults: Sequence[str] = (), seed: int = 0
) -> Device:
    """Starts a simulated device that performs the walk, and waits until it speaks."""
    command = [sys.executable, "-m", "poseloom", "simulate-device", f"{kind}://127.0.0.1:{port}", CLIP]
    command += ["--rate", f"{rate:g}", "--seed", str(seed)]
    command += [] if seconds is None else ["--seconds", f"{seconds:g}"]
    for fault in faults:
        command += ["--fault", fault]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, encoding="utf-8")
    assert process.stdout is not None
    process.stdout.readline()
    return Device(process)


_VISITOR = """
import sys
import viser
from websockets.sync.client import connect
url = sys.argv[1].replace("http", "ws", 1)
with connect(url, subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as page:
    print("open", flush=True)
    total = 0
    for message in page:
        total += len(message)
"""


@contextmanager
def visitor(viewer: SessionViewer) -> Generator[None]:
    """A process that takes everything that the viewer sends to a browser, and draws nothing."""
    process = subprocess.Popen(
        [sys.executable, "-c", _VISITOR, viewer.url], stdout=subprocess.PIPE, text=True, encoding="utf-8"
    )
    assert process.stdout is not None
    process.stdout.readline()
    try:
        yield
    finally:
        process.kill()
        process.communicate()


@contextmanager
def all_sinks(folder: Path, visitors: bool = True) -> Generator[tuple[SessionViewer, dict[str, object]]]:
    """A viewer with a visitor, and the settings that switch the recorder and VMC on."""
    viewer = SessionViewer(port=0)
    settings: dict[str, object] = {"record": str(folder / "session.mcap"), "send": ("vmc://127.0.0.1:39999",)}
    with ExitStack() as stack:
        if visitors:
            stack.enter_context(visitor(viewer))
        yield viewer, settings
