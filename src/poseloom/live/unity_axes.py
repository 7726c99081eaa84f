"""Unity's left-handed axes (X right, Y up, Z forward) and poseloom's right-handed ones (X left, Y up, Z forward).

One is the other's mirror image in the plane x = 0. A reflection turns the sense of rotations about axes within its
plane, and leaves it about the axis across: (w, x, y, z) becomes (w, x, -y, -z). It is its own inverse, so the same
functions serve both ways.
"""

from collections.abc import Sequence

from poseloom.live.readings import Vector


def mirrored_position(position: Sequence[float]) -> Vector:
    """A place in the other axes, metres."""
    x, y, z = position
    return (-x, y, z)


def mirrored_quat(quat_wxyz: Sequence[float]) -> Vector:
    """A rotation in the other axes, scalar first."""
    w, x, y, z = quat_wxyz
    return (w, x, -y, -z)
