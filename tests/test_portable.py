"""Other systems' ways, forced here: what Windows and macOS lack or do differently has a twin, chosen at run time."""

import ast
import asyncio
import errno
import io
import os
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from poseloom.cli import _app
from poseloom.errors import SensorError
from poseloom.formats import atomic
from poseloom.formats.atomic import atomic_file
from poseloom.library import folders, pool
from poseloom.live import datagrams, responsiveness
from poseloom.live.datagrams import DatagramPort
from poseloom.live.device_addresses import open_device
from poseloom.live.devices import pseudo_terminal, tcp_line
from poseloom.live.lines import parse_counts
from poseloom.live.source_serial import SerialSource
from poseloom.live.specifications import make_source
from poseloom.samples import sample_motions
from poseloom.synthesis.flex import simulate_flex

ROOT = Path(__file__).resolve().parents[1]


# Datagrams


class WithoutReaders(asyncio.SelectorEventLoop):
    """A loop that watches no sockets, as Windows' Proactor."""

    def add_reader(self, *_: object) -> None:  # type: ignore[override]
        raise NotImplementedError

    def remove_reader(self, *_: object) -> bool:  # type: ignore[override]
        raise NotImplementedError


def _received(loop: Callable[[], asyncio.AbstractEventLoop], count: int = 200) -> list[tuple[bytes, float, str]]:
    got: list[tuple[bytes, float, str]] = []

    async def run() -> None:
        async with DatagramPort("127.0.0.1", 0, lambda *what: got.append(what), lambda _lost: None) as port:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                for number in range(count):
                    sender.sendto(b"%d" % number, ("127.0.0.1", port.port))
                    if number % 20 == 0:
                        await asyncio.sleep(0)
                for _ in range(600):
                    if len(got) == count:
                        return
                    await asyncio.sleep(0.05)

    with asyncio.Runner(loop_factory=loop) as runner:
        runner.run(run())
    return got


@pytest.mark.parametrize("loop", [asyncio.SelectorEventLoop, WithoutReaders])
@pytest.mark.parametrize("system", ["own", "win32", "darwin"])
def test_datagrams_arrive_on_every_system_and_loop(
    system: str, loop: Callable[[], asyncio.AbstractEventLoop], monkeypatch: pytest.MonkeyPatch
):
    if system == "win32":
        monkeypatch.setattr(datagrams, "SYSTEMS", {})
    if system == "darwin":  # numbers that this kernel does not know: it refuses the option, and no stamp comes
        monkeypatch.setattr(datagrams, "system_stamps", lambda: datagrams.SYSTEMS["darwin"])
    before = time.monotonic()
    got = _received(loop)
    assert [int(data) for data, _, _ in got] == list(range(200))
    assert all(before - 0.1 <= arrival <= time.monotonic() for _, arrival, _ in got)
    assert {sender.rpartition(":")[0] for _, _, sender in got} == {"127.0.0.1"}


def _port(
    monkeypatch: pytest.MonkeyPatch, stamps: datagrams.Stamps | None
) -> tuple[DatagramPort, list[object], list[int]]:
    heard: list[object] = []
    lost: list[int] = []
    monkeypatch.setattr(datagrams, "system_stamps", lambda: stamps)
    return DatagramPort("127.0.0.1", 0, lambda *what: heard.append(what), lost.append), heard, lost


@pytest.mark.parametrize(("system", "part"), [("linux", 1e-9), ("darwin", 1e-6)])
def test_stamps_of_each_system_are_read(system: str, part: float, monkeypatch: pytest.MonkeyPatch):
    stamps = datagrams.SYSTEMS[system]
    port, _, lost = _port(monkeypatch, stamps)
    now, wall = time.monotonic(), time.time() - 0.25
    data = struct.pack(stamps.layout, int(wall), int((wall % 1) / part))
    extra = [(socket.SOL_SOCKET, stamps.message, data)]
    if stamps.overflows is not None:
        extra.append((socket.SOL_SOCKET, stamps.overflows, struct.pack("I", 7)))
    arrival = port._arrival(extra, now)  # pyright: ignore[reportPrivateUsage]
    assert arrival is not None
    assert now - 0.3 < arrival <= now - 0.2
    assert lost == ([7] if stamps.overflows is not None else [])


def test_a_flood_without_stamps_is_emptied_and_counted(monkeypatch: pytest.MonkeyPatch):
    port, heard, lost = _port(monkeypatch, None)
    clock = [100.0]
    waiting = [1000]

    def receive() -> tuple[bytes, list[tuple[int, int, bytes]], tuple[str, int]]:
        if waiting[0] == 0:
            raise BlockingIOError
        waiting[0] -= 1
        return b"x", [], ("127.0.0.1", 9)

    monkeypatch.setattr(port, "_receive", receive)
    monkeypatch.setattr(datagrams.time, "monotonic", lambda: clock[0])
    port._emptied = clock[0]  # pyright: ignore[reportPrivateUsage]
    while waiting[0]:
        port._read()  # pyright: ignore[reportPrivateUsage]
        clock[0] += 0.2
    assert len(heard) + len(lost) == 1000
    assert len(heard) == 4 * 64  # the first full readings; then what may have waited too long is passed over
    port._read()  # pyright: ignore[reportPrivateUsage]
    waiting[0] = 3
    port._read()  # pyright: ignore[reportPrivateUsage]
    assert len(heard) == 4 * 64 + 3  # the buffer was empty: what comes is of now


# Serial lines


def test_a_serial_line_is_passed_on_by_tcp_where_there_are_no_terminals(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delattr(os, "openpty", raising=False)
    with pytest.raises(SensorError, match=r"serial://:4000"), pseudo_terminal():
        pass
    device = open_device("serial://:0")
    with (
        device.speaker() as (speaker, told),
        pytest.raises(SensorError, match="another port"),
        tcp_line("127.0.0.1", int(told.rpartition(":")[2])),
    ):
        pass
    with device.speaker() as (speaker, told):
        source = make_source(told.removeprefix("serial line "))
        assert isinstance(source, SerialSource)
        line = source._open()  # pyright: ignore[reportPrivateUsage]
        assert line is not None
        sample = simulate_flex(sample_motions()["walk"], source.layout).sample(0)
        got = b""
        for _ in range(200):
            speaker.say(sample, source.layout, 0.5)
            got += line.read(64)
            if got.count(b"\n") > 2:
                break
        line.close()
        packet = parse_counts(got.splitlines()[0], source.layout.names)
        assert packet is not None
        speaker.say(sample, source.layout, 0.6)  # whom nobody reads harms nobody
        speaker.say(sample, source.layout, 0.7)
    assert make_source("serial://COM3").device == "COM3"  # pyright: ignore


def test_a_coarse_clock_is_said(monkeypatch: pytest.MonkeyPatch):
    assert responsiveness.coarse_clock_note() == ""
    windows = SimpleNamespace(resolution=0.015625)
    monkeypatch.setattr(responsiveness.time, "get_clock_info", lambda _name: windows)
    assert "16 ms" in responsiveness.coarse_clock_note()


# Files


def test_a_file_that_another_program_has_open_is_replaced_a_little_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    target, refused = tmp_path / "with a space é.txt", [0]
    target.write_text("old", encoding="utf-8")
    replace = Path.replace

    def busy(self: Path, other: Path) -> Path:
        refused[0] += 1
        if refused[0] < 4:
            raise PermissionError(errno.EACCES, "The process cannot access the file", str(other))
        return replace(self, other)

    monkeypatch.setattr(Path, "replace", busy)
    monkeypatch.setattr(atomic, "_PAUSE", 0.0)
    with pytest.raises(PermissionError), atomic_file(target) as part:
        part.write_text("new", encoding="utf-8")  # elsewhere a refusal is one: nobody waits
    assert target.read_text(encoding="utf-8") == "old"
    refused[0] = 0
    monkeypatch.setattr(sys, "platform", "win32")
    with atomic_file(target) as part:
        part.write_text("new", encoding="utf-8")
    assert target.read_text(encoding="utf-8") == "new"
    refused[0] = -1000
    with pytest.raises(PermissionError), atomic_file(target) as part:
        part.write_text("newer", encoding="utf-8")
    assert target.read_text(encoding="utf-8") == "new"
    assert [path.name for path in tmp_path.iterdir()] == [target.name]


def test_a_folder_is_moved_into_place_as_windows_allows_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """There no folder moves while its lock is open, none onto another, and nothing opened to be read is synced."""
    rename, open_file, synced = Path.rename, os.open, list[int]()

    def windows_rename(self: Path, target: Path) -> Path:
        if target.exists():
            raise FileExistsError(errno.EEXIST, "Cannot create a file when that file already exists", str(target))
        with folders.writing(self):  # fails while it is held
            pass
        return rename(self, target)

    def windows_open(path: Path, flags: int, *rest: int) -> int:
        assert not Path(path).is_dir()
        synced.append(flags & (os.O_WRONLY | os.O_RDWR))
        return open_file(path, flags, *rest)

    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(Path, "rename", windows_rename)
    monkeypatch.setattr(os, "open", windows_open)
    target = tmp_path / "a library"
    target.mkdir()
    with folders.new_folder(target) as part:
        (part / "file").write_text("x", encoding="utf-8")
        folders.to_disk(part / "file")
    monkeypatch.undo()
    assert (target / "file").read_text(encoding="utf-8") == "x"
    assert synced == [os.O_RDWR]
    assert [path.name for path in tmp_path.iterdir()] == ["a library"]


def test_no_more_processes_than_windows_waits_for(monkeypatch: pytest.MonkeyPatch):
    asked: list[int] = []

    class Executor:
        def __init__(self, workers: int, **_: object) -> None:
            asked.append(workers)
            raise RuntimeError("asked")

    monkeypatch.setattr(pool, "ProcessPoolExecutor", Executor)
    with pytest.raises(RuntimeError, match="asked"):
        list(pool.in_order(str, range(1000), 128))
    assert asked == [61]


# The terminal


def test_a_terminal_without_our_letters_gets_others():
    """Output into a pipe is cp1252 on Windows, which has no arrows and no Greek."""
    code = "import sys; from poseloom.cli import _app; _app._print_anything(); print('→ σ 1 µs'); sys.stderr.write('σ')"
    environment = {**os.environ, "PYTHONIOENCODING": "cp1252:strict"}
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, env=environment, check=True)
    assert answer.stdout.decode("cp1252").strip() == "? ? 1 µs"


def test_a_reader_that_has_gone_away_is_no_error(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def gone(_argv: list[str]) -> int:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(_app, "_run", gone)
    assert _app.run([]) == 2
    monkeypatch.setattr(sys, "platform", "win32")
    assert _app.run([]) == 1
    monkeypatch.setattr(_app, "_run", lambda _argv: (_ for _ in ()).throw(OSError(errno.EINVAL, "x", "file")))
    assert _app.run([]) == 2
    assert "file" in capsys.readouterr().err
    assert io.DEFAULT_BUFFER_SIZE > 0


# All of the source

_UNIX_ONLY = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}


def _trees() -> list[tuple[Path, ast.Module]]:
    files = sorted(path for top in ("src", "examples", "scripts", "benchmarks") for path in (ROOT / top).rglob("*.py"))
    return [(path, ast.parse(path.read_text(encoding="utf-8"))) for path in files]


def test_every_text_states_its_encoding():
    """Without one, Windows takes the code page of its country."""
    bare = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path, tree in _trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and _is_bare_text(node)
    ]
    assert not bare


def _is_bare_text(call: ast.Call) -> bool:
    named = {keyword.arg: keyword.value for keyword in call.keywords}
    if "encoding" in named:
        return False
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    if name in ("read_text", "write_text"):
        return len(call.args) < (1 if name == "read_text" else 2)
    if name in ("run", "Popen", "check_output"):
        return any(key in named for key in ("text", "universal_newlines"))
    return name == "open" and isinstance(call.func, ast.Name) and "b" not in _mode(call, 1)


def _mode(call: ast.Call, place: int) -> str:
    given = [keyword.value for keyword in call.keywords if keyword.arg == "mode"] + call.args[place : place + 1]
    return str(given[0].value) if given and isinstance(given[0], ast.Constant) else "r"


def test_no_module_needs_unix_to_be_imported():
    needed = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path, tree in _trees()
        for node in tree.body
        if isinstance(node, ast.Import | ast.ImportFrom)
        and {alias.name for alias in node.names if isinstance(node, ast.Import)} & _UNIX_ONLY
    ]
    assert not needed
