"""The format `.poses`: a line with the rate, then a line a frame: the pose vector of the average body."""

from pathlib import Path

import numpy as np

from poseloom import Motion, average_body
from poseloom.errors import FormatError
from poseloom.formats import Format, ReadOptions
from poseloom.formats.atomic import atomic_file
from poseloom.skeleton import make_motion

MAGIC = "poses "


def read(path: Path, options: ReadOptions) -> Motion:
    """Metres, Y up, so that nothing in `options` has a meaning. What the libraries raise becomes a FormatError."""
    head, *rows = path.read_text(encoding="ascii").splitlines()
    if not head.startswith(MAGIC) or not rows:
        raise FormatError("this is no table of poses", remedy="Give a file that begins with 'poses RATE'", file=path)
    q, body, rate = np.array([[float(word) for word in row.split()] for row in rows]), average_body(), float(head[6:])
    if q.shape[1] != body.size or not np.isfinite(q).all() or not 0 < rate < 1e4:
        raise FormatError(f"the frames have no {body.size} finite numbers, or no rate", file=path)
    return make_motion(body, q, rate, path.stem)


def write(motion: Motion, path: Path) -> None:
    """Writes a motion of the body's 22 bones; `retarget` brings others to it."""
    if motion.skeleton.names != average_body().names:
        raise FormatError("this motion is not on the body", remedy="Retarget it first", file=path)
    rows = "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in motion.q)
    try:
        with atomic_file(path) as part:
            part.write_text(f"{MAGIC}{motion.rate:.9g}\n{rows}", encoding="ascii")
    except OSError as error:
        raise FormatError("the file cannot be written", cause=str(error.strerror), file=path) from None


FORMAT = Format("pose table", (".poses",), lambda head: head.startswith(MAGIC.encode()), read, write)
