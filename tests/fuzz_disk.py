"""Lets the disk be full at several moments of each command that writes; run by `test_full_disk`.

In a process of its own, which may write no more than some bytes to a file (RLIMIT_FSIZE): what is written beyond fails
as on a full disk, though the system calls it a file too large.
"""

import contextlib
import io
import resource
import shutil
import signal
import sys
from pathlib import Path

from poseloom.cli._app import run
from poseloom.formats import write_motion
from poseloom.samples import sample_motions

OLD = b"what stood here before"


def contents(folder: Path) -> dict[str, bytes | None]:
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def quietly(command: list[str], most: int = -1) -> tuple[object, str]:
    """Exit code and all that was said, where no file may have more than some bytes."""
    said = io.StringIO()
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (most if most >= 0 else hard, hard))
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return run(command), said.getvalue()
    except BaseException as error:
        return f"{type(error).__name__}: {error}", said.getvalue()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))


def prepare(folder: Path) -> dict[str, tuple[list[str], str, int]]:
    """Each command by name, its target in the folder where it works, and how many budgets are tried."""
    motions = sample_motions()
    for name, motion in (("one", motions["walk"].cut(0, 150)), ("two", motions["walk"].cut(100, 260))):
        (folder / name).mkdir()
        write_motion(motion, folder / name / f"{name}.npz")
    one, two, walk = str(folder / "one"), str(folder / "two"), str(folder / "one" / "one.npz")
    trackers, session, library = (str(folder / name) for name in ("walk.mcap", "session.mcap", "library"))
    for command in (
        ["library", "build", one, "-o", library, "--workers", "1"],
        ["simulate", walk, "-o", trackers, "--stop", "1"],
        ["simulate-calibration", "-o", session, "--rounds", "1", "--seed", "5"],
    ):
        assert quietly(command)[0] == 0, quietly(command)
    return {
        "build": (["library", "build", one, "-o", "@new", "--workers", "1"], "new", 4),
        "replace": (["library", "build", two, "-o", "@library", "--replace", "--workers", "1"], "library", 3),
        "add": (["library", "add", "@library", two, "--workers", "1"], "library", 3),
        "fit": (
            ["fit", "phase-hmm", "-l", library, "--layout", "right-foot-imu", "-o", "@a.model.npz"],
            "a.model.npz",
            2,
        ),
        "convert to BVH": (["convert", walk, "@a.bvh"], "a.bvh", 2),
        "convert to GLB": (["convert", walk, "@a.glb"], "a.glb", 2),
        "convert to NPZ": (["convert", walk, "@a.npz"], "a.npz", 2),
        "simulate": (["simulate", walk, "-o", "@a.mcap"], "a.mcap", 2),
        "calibrate": (["calibrate", session, "-o", "@a.cal"], "a.cal", 1),
        "guide": (["calibrate", "--guide", "-o", "@a.html"], "a.html", 2),
        "export": (["reconstruct", trackers, "-m", "inverse-kinematics", "-o", "@a.csv"], "a.csv", 1),
        "report": (["phases", walk, "-o", "@a.html"], "a.html", 2),
    }


def main(folder: Path) -> None:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    commands = prepare(folder)
    escaped = 0
    for name, (command, target, count) in commands.items():
        work = folder / "work"

        def fresh(target: str = target, work: Path = work) -> dict[str, bytes | None]:
            shutil.rmtree(work, ignore_errors=True)
            work.mkdir()
            if target == "library":
                shutil.copytree(folder / "library", work / "library")
            elif target != "new":
                (work / target).write_bytes(OLD)
            return contents(work)

        placed = [str(work / part.removeprefix("@")) if part.startswith("@") else part for part in command]
        before = fresh()
        assert quietly(placed)[0] == 0, (name, quietly(placed))
        written = {len(content) for path, content in contents(work).items() if content and before.get(path) != content}
        # Every file that is written is once one byte too large; and nothing at all fits.
        budgets = sorted({0, max(written) // 2, *(size - 1 for size in written)})
        chosen = {budgets[len(budgets) * i // count] for i in range(count)} | {budgets[-1]}
        for most in sorted(chosen):
            print(name, most, flush=True)
            before = fresh()
            code, said = quietly(placed, most)
            after = contents(work)
            words = " ".join(said.split())
            wrong = [
                what
                for what, bad in (
                    (f"exit code {code}", code != 2),
                    ("the target is not named", str(work / target) not in said.replace("\n", "")),
                    ("a hidden name is told", f"{work}/." in said.replace("\n", "")),
                    ("a traceback", "Traceback" in said),
                    (f"left: {sorted(set(after) ^ set(before))}", set(after) != set(before)),
                    ("old content changed", any(after.get(path) != content for path, content in before.items())),
                )
                if bad
            ]
            escaped += bool(wrong)
            if wrong:
                print(f"ESCAPED {name} {most}: {wrong} {words[-600:]}", flush=True)
    print("escaped", escaped)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
