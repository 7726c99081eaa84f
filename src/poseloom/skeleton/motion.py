"""A pose and a motion of a skeleton, as pose vectors."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import PoseloomError
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class Pose:
    """One pose of a skeleton.

    Attributes:
        skeleton: The bones.
        q: Pose vector: root position (3, metres, world), root rotation vector (3, radians, world), then one rotation
            vector (3) a joint, relative to its parent and to the rest pose.
    """

    skeleton: Skeleton
    q: Floats[Array, "dofs"]


RestChoice = Literal["auto", "zero", "motion"]
"""Which pose of a motion's skeleton is laid over the body's T-pose: "zero" is its zero pose, "motion" one guessed from
its movement, "auto" the zero pose where a body could take it, else the other where it is certain."""


@dataclass(frozen=True)
class FileConventions:
    """How the numbers of a motion's file were understood, and what its user said about them.

    Attributes:
        metres_per_unit: The file's unit of length.
        unit_origin: "stated" by the file or its format, "guessed" from the body's size, or "given" by the user.
        up: The file's axis that points up: x, y, z, or one of them with a minus.
        up_origin: "stated", "guessed" from rest pose and motion, or "given".
        stature: About how tall the body is in this unit, metres, from its limbs; None where they are not known.
        rest: Which rest pose the user wants (`RestChoice`).
        rest_origin: Which one was taken, once the motion is on the body; empty before.
        unsure: Body bones whose turn about themselves is a guess.
    """

    metres_per_unit: float
    unit_origin: str
    up: str
    up_origin: str
    stature: float | None = None
    rest: RestChoice = "auto"
    rest_origin: str = ""
    unsure: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of one skeleton at a constant rate. Make one with `make_motion`, which checks.

    Attributes:
        skeleton: The bones.
        q: Pose vectors, one row a frame (see `Pose`), rotation vectors continuous in time.
        rate: Frames a second.
        name: What it is called: the file's stem, or the clip's name.
        displacements: Metres by which joints are moved from their rest offsets, in the parent's frame, for files whose
            joints translate; None where all joints stay (always so on the body).
        conventions: How its file was understood; None for motions that come from none.
    """

    skeleton: Skeleton
    q: Floats[Array, "frames dofs"]
    rate: float
    name: str = ""
    displacements: Floats[Array, "frames joints 3"] | None = field(default=None)
    conventions: FileConventions | None = None

    def __len__(self) -> int:
        return len(self.q)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self) - 1) / self.rate

    @property
    def root_positions(self) -> Floats[Array, "frames 3"]:
        """Root positions in the world, metres."""
        return self.q[:, :3]

    @property
    def rotvecs(self) -> Floats[Array, "frames joints 3"]:
        """Rotation vectors of all joints, the root's relative to the world."""
        return self.q[:, 3:].reshape(len(self.q), -1, 3)

    def pose(self, frame: int) -> Pose:
        """The pose of one frame."""
        return Pose(self.skeleton, self.q[frame])

    def cut(self, start: int, stop: int) -> "Motion":
        """The frames start to stop - 1."""
        part = None if self.displacements is None else self.displacements[start:stop]
        return replace(self, q=self.q[start:stop], displacements=part)


def make_motion(
    skeleton: Skeleton, q: ArrayLike, rate: float, name: str = "", displacements: ArrayLike | None = None
) -> Motion:
    """Checks and freezes a motion.

    Raises:
        PoseloomError: for no frames, a wrong number of columns, numbers that are not finite, or a rate not positive.
    """
    values = frozen_float(q)
    what = f"motion {name!r}" if name else "the motion"
    if values.ndim != 2 or values.shape[1] != skeleton.size:
        raise PoseloomError(
            f"{what} has shape {values.shape}, but a skeleton of {len(skeleton)} joints needs {skeleton.size} columns",
            remedy="Give one row a frame: root position and rotation vector, then one rotation vector a joint",
        )
    if len(values) == 0:
        raise PoseloomError(f"{what} has no frames", remedy="Give at least one frame")
    if not (np.isfinite(rate) and rate > 0):
        raise PoseloomError(f"{what} has a rate of {rate} frames a second", remedy="Give a positive, finite rate")
    if not np.isfinite(values).all():
        frame, column = (int(i[0]) for i in np.nonzero(~np.isfinite(values)))
        raise PoseloomError(
            f"{what} is not finite in frame {frame}, column {column}", remedy="Mend or cut out that part of the data"
        )
    moved = None if displacements is None else frozen_float(displacements)
    if moved is not None and moved.shape != (len(values), len(skeleton), 3):
        raise PoseloomError(
            f"{what} has displacements of shape {moved.shape}", remedy="Give one vector a frame and joint"
        )
    return Motion(skeleton, values, float(rate), name, moved)
