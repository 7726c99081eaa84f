"""A killed build or addition leaves the library as it was, or as it was to become; never anything between.

A driver process forks children that build or add; each child kills itself (SIGKILL) at one of the events that Python
audits (opening, renaming, removing, listing, locking of files), or is killed by its parent after some time.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from poseloom.formats import write_motion
from poseloom.library import build_library, open_library
from poseloom.samples import sample_motions

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="killing is tested where processes can be forked")

DRIVER = r"""
import json, os, random, shutil, signal, sys, time
from pathlib import Path
from poseloom.errors import LibraryError
from poseloom.library import add_to_library, build_library, open_library
from poseloom.library.build import six_trackers

what, sources, more, old, work = sys.argv[1], *map(Path, sys.argv[2:6])
library = work / "library"
WATCHED = ("open", "os.", "shutil.", "sqlite3.")


def act():
    if what == "add":
        add_to_library(library, [more], workers=1)
    else:
        build_library([sources], library, workers=1, replace_existing=library.exists())


def content():
    if not library.exists():
        return None
    opened = open_library(library, verify=True)
    opened.moments(six_trackers())
    return opened.digest, [clip.name for clip in opened.clips]


def reset():
    shutil.rmtree(work)
    work.mkdir()
    if what != "build":
        shutil.copytree(old, library)


def trial(event=None, seconds=None):
    # Runs the act in a child that dies at an event or after a time; says whether it came to its end.
    child = os.fork()
    if child == 0:
        if event is not None:
            seen = [0]

            def hook(name, _):
                if name.startswith(WATCHED):
                    seen[0] += 1
                    if seen[0] == event:
                        os.kill(os.getpid(), 9)

            sys.addaudithook(hook)
        act()
        os._exit(0)
    if seconds is not None:
        time.sleep(seconds)
        try:
            os.kill(child, 9)
        except ProcessLookupError:
            pass
    return os.waitpid(child, 0)[1] == 0


reset()
before = content()
act()
after = content()
reset()
begin = time.perf_counter()
act()
lasts = time.perf_counter() - begin
assert content() == after != before

outcomes = {"before": 0, "after": 0}
event, random_trials = 0, random.Random(0)
step = int(sys.argv[6])
finished = False
while not finished:
    event += step
    finished = trial(event=event)
    now = content()
    assert now in (before, after), (event, now)
    outcomes["before" if now == before else "after"] += 1
    if now == after:
        reset()  # else go on with what the killed one has left: it must not stand in the way
for _ in range(int(sys.argv[7])):
    trial(seconds=random_trials.uniform(0, 1.2 * lasts))
    now = content()
    assert now in (before, after), now
    outcomes["before" if now == before else "after"] += 1
    if now == after:
        reset()
act() if content() == before else None
left = sorted(path.name for path in work.iterdir())
assert left == ["library"], left
assert len(list(library.glob("generation-*"))) == 1
assert content() == after
print(json.dumps({"events": event, **outcomes}))
"""


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("kill")
    for folder, names in (("sources", ("kick", "jump")), ("more", ("spin",))):
        (root / folder).mkdir()
        for name in names:
            write_motion(sample_motions()[name], root / folder / f"{name}.npz")
    (root / "other").mkdir()
    write_motion(sample_motions()["punch"], root / "other" / "punch.npz")
    build_library([root / "other"], root / "old", workers=1)
    return {name: root / name for name in ("sources", "more", "old")}


@pytest.mark.parametrize("what", ["build", "replace", "add"])
def test_a_kill_at_any_moment_leaves_old_or_new(what: str, places: dict[str, Path], tmp_path: Path) -> None:
    work = tmp_path / "work"
    work.mkdir()
    given = [str(places[name]) for name in ("sources", "more", "old")]
    done = subprocess.run(
        [sys.executable, "-c", DRIVER, what, *given, str(work), "1", "12"], capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["before"] > 10, told
    assert told["after"] >= 1, told


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="children are found through /proc")
def test_workers_end_when_their_parent_is_killed(places: dict[str, Path], tmp_path: Path) -> None:
    script = tmp_path / "build.py"
    script.write_text(
        "import sys\n"
        "from poseloom.library import build_library\n"
        "if __name__ == '__main__':\n"
        "    build_library(['samples', sys.argv[1]], sys.argv[2], mirror=True, workers=2)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, str(script), str(places["sources"]), str(tmp_path / "library")], stderr=subprocess.DEVNULL
    )
    try:
        children: set[int] = set()
        deadline = time.monotonic() + 60
        while len(children) < 2 and parent.poll() is None and time.monotonic() < deadline:
            children = {pid for pid in _descendants(parent.pid) if "spawn_main" in _command(pid)}
            time.sleep(0.01)
        assert len(children) == 2
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    deadline = time.monotonic() + 30
    while any(_command(pid) for pid in children) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert [_command(pid) for pid in children if _command(pid)] == []
    assert not (tmp_path / "library").exists()
    build_library([places["sources"]], tmp_path / "library", workers=1)
    assert len(open_library(tmp_path / "library").clips) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["build.py", "library"]


def _descendants(pid: int) -> list[int]:
    try:
        listed = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return []
    return [child for each in listed for child in (int(each), *_descendants(int(each)))]


def _command(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""
