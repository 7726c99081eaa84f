"""Which clips are of one take: mirror images, the same recording in another format, and clips that overlap in time.

An evaluation that leaves a take out must leave out all of these, or it measures memory. Names do not tell: the same
recording goes through collections under other names, on other skeletons, shifted by part of a frame. So postures are
compared (places of nine joints in the hips' frame), first over windows of one second, then, where windows are alike,
over all that two clips have in common at that shift. Measured on CMU, HDM05, DeepMimic and Bandai recordings: in the
best second copies differ by 0.022 of their movement or less, other performances of a movement by 0.033 or more. Copies
whose way through another skeleton turned limbs by some degrees differ by up to 0.16 over their whole length, but their
roots travel the same way to within 0.04. So may the walks and runs of one person back and forth on one track: the
second test is left out where both clips come from skeletons of one family, and so went one way; and any two ways at an
even pace along a straight line are one, turned and scaled, so there the postures must agree better (CMU's 35_01 differs
by 0.003 from its own copy in another format, by 0.12 or more from the other walks of that person).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from poseloom.arrays import Array, Floats32, Ints
from poseloom.library import _posture_kernels as kernels
from poseloom.library.postures import JOINT_COORDINATES, JOINTS, mirrored_postures, postures

__all__ = ["CopyCriteria", "CopyFinder", "find_takes", "postures"]

_SAMPLES = 9
_COLUMNS = 8
_LEARNT_FROM = 20_000


@runtime_checkable
class Stretch(Protocol):
    """What is asked of a clip."""

    @property
    def start(self) -> int: ...
    @property
    def stop(self) -> int: ...
    @property
    def take(self) -> str: ...
    @property
    def mirrored(self) -> bool: ...
    @property
    def family(self) -> str: ...


@dataclass(frozen=True)
class CopyCriteria:
    """When two clips are of one recording. Differences are root mean squares, as shares of the movement.

    Attributes:
        seconds: Length of the windows.
        every: Seconds from one compared window to the next.
        least_movement: Windows whose joints move less than this, in metres, say nothing.
        nearness: Largest difference of two windows' principal components to look closer.
        same: Largest difference of two windows of one recording.
        alike: Largest difference of two windows to compare all that the clips have in common.
        common_seconds: Least length of what they have in common.
        common: Largest difference in that.
        path: Largest difference of the ways the root goes in that, turned, moved and scaled to fit.
        least_path: Ways that stray less than this from their middle, in metres, say nothing.
        straight: Largest difference in what clips have in common where a way strays less than that from a straight line
            at an even pace, which tells no recording from another.
    """

    seconds: float = 1.0
    every: float = 0.25
    least_movement: float = 0.015
    nearness: float = 0.1
    same: float = 0.03
    alike: float = 0.13
    common_seconds: float = 2.5
    common: float = 0.17
    path: float = 0.04
    least_path: float = 0.15
    straight: float = 0.08


def find_takes(
    poses: Floats32[Array, "poses dofs"],
    clips: Sequence[Stretch],
    rate: float,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, str]:
    """For each take that clips name, the name of the take that it turns out to belong to.

    Args:
        poses: Pose vectors of the average body.
        clips: Clips; those that name the same take already stay together.
        rate: Frames a second.
        progress: Told how many of how many clips are compared.
    """
    finder = CopyFinder(poses, clips, rate)
    names = list(dict.fromkeys(clip.take for clip in clips))
    number = {name: index for index, name in enumerate(names)}
    first = list(range(len(names)))
    for index, clip in enumerate(finder.clips):
        for other in finder.holders(finder.postures_of(index), index, clip.family):
            _join(first, number[clip.take], number[finder.clips[other].take])
        if progress is not None:
            progress(index + 1, len(finder.clips))
    return {name: names[_root(first, index)] for index, name in enumerate(names)}


class CopyFinder:
    """Looks for clips that hold a recording, wholly or in part.

    Args:
        poses: Pose vectors of the average body.
        clips: Their clips; mirror images are passed over, for each belongs to the take of what it mirrors.
        rate: Frames a second.
        criteria: When two clips are of one recording.
    """

    def __init__(
        self,
        poses: Floats32[Array, "poses dofs"],
        clips: Sequence[Stretch],
        rate: float,
        criteria: CopyCriteria | None = None,
    ) -> None:
        spatial = cast(Any, import_module("scipy.spatial"))  # takes a third of a second to load, and few need it

        self._criteria = criteria or CopyCriteria()
        self._rate = rate
        self._every = max(round(rate * self._criteria.every), 1)
        self._step = max(round(rate * self._criteria.seconds / (_SAMPLES - 1)), 1)
        self.clips = tuple(clip for clip in clips if not clip.mirrored)
        sizes = np.array([clip.stop - clip.start for clip in self.clips], dtype=np.int64)
        self._stops = np.cumsum(sizes)
        self._starts = self._stops - sizes
        self._postures = np.concatenate([postures(poses[clip.start : clip.stop]) for clip in self.clips])
        ranges = zip(self._starts.tolist(), self._stops.tolist(), strict=True)
        rows = np.concatenate([self._windows(start, stop) for start, stop in ranges])
        self._basis = self._principal(rows)
        components, movement = self._describe(self._postures, rows)
        moving = movement >= self._criteria.least_movement
        self._rows = rows[moving]
        self._tree = spatial.cKDTree(components[moving])

    def postures_of(self, index: int) -> Floats32[Array, "poses coordinates"]:
        """The postures of one of the finder's clips."""
        return self._postures[self._starts[index] : self._stops[index]]

    def holders(self, places: Floats32[Array, "poses coordinates"], but: int = -1, family: str = "") -> set[int]:
        """Indices of the clips that hold a part of a motion, or of its mirror image.

        Args:
            places: The motion's postures (`postures`), at the finder's rate.
            but: Index of a clip that does not count: the motion itself.
            family: Family of the motion's source skeleton (`Clip.family`); empty if unknown, which finds the most.
        """
        found: set[int] = set()
        for image in (places, mirrored_postures(places)):
            rows = self._windows(0, len(image))[:: self._every]
            components, movement = self._describe(image, rows)
            moving = movement >= self._criteria.least_movement
            found |= self._look_closer(image, rows[moving], components[moving], movement[moving], found | {but}, family)
        return found

    @property
    def _length(self) -> int:
        return (_SAMPLES - 1) * self._step + 1

    def _windows(self, start: int, stop: int) -> Ints[Array, "windows"]:
        return np.arange(start, max(stop - self._length + 1, start), dtype=np.int64)

    def _principal(self, rows: Ints[Array, "windows"]) -> Floats32[Array, "samples coordinates columns"]:
        """Directions in which windows differ most, one block for each of a window's samples."""
        chosen = rows[:: max(len(rows) // _LEARNT_FROM, 1)]
        joints = self._postures[:, :JOINT_COORDINATES]
        windows = np.stack([joints[chosen + k * self._step] for k in range(_SAMPLES)], axis=1)
        windows -= windows.mean(axis=1, keepdims=True)
        flat = windows.reshape(len(chosen), _SAMPLES * JOINT_COORDINATES).astype(np.float64)
        basis = np.linalg.eigh(flat.T @ flat)[1][:, : -_COLUMNS - 1 : -1]
        blocks = basis.reshape(_SAMPLES, JOINT_COORDINATES, _COLUMNS)
        return (blocks - blocks.mean(axis=0)).astype(np.float32)

    def _describe(
        self, places: Floats32[Array, "poses coordinates"], rows: Ints[Array, "windows"]
    ) -> tuple[Floats32[Array, "windows columns"], Floats32[Array, "windows"]]:
        """Principal components of windows, their mean taken out, and how much joints move in them, in metres."""
        components = np.zeros((len(rows), _COLUMNS), dtype=np.float32)
        squares = np.zeros(len(rows), dtype=np.float32)
        total = np.zeros((len(rows), JOINT_COORDINATES), dtype=np.float32)
        for k in range(_SAMPLES):
            sample = places[rows + k * self._step, :JOINT_COORDINATES]
            components += sample @ self._basis[k]
            squares += np.einsum("ij,ij->i", sample, sample)
            total += sample
        scatter = np.maximum(squares - np.einsum("ij,ij->i", total, total) / _SAMPLES, 0)
        return components, np.sqrt(scatter / (_SAMPLES * len(JOINTS)))

    def _look_closer(
        self,
        places: Floats32[Array, "poses coordinates"],
        rows: Ints[Array, "windows"],
        components: Floats32[Array, "windows columns"],
        movement: Floats32[Array, "windows"],
        passed: set[int],
        family: str,
    ) -> set[int]:
        """Clips that are of this motion's recording, by their windows and by what they have in common with it."""
        if len(rows) == 0 or len(self._rows) == 0:
            return set()
        reach = self._criteria.nearness * movement.astype(np.float64) * np.sqrt(_SAMPLES * len(JOINTS))
        near: list[list[int]] = self._tree.query_ball_point(components, reach, return_sorted=False)
        counts = np.array([len(found) for found in near])
        others = self._rows[np.concatenate([np.asarray(found, dtype=np.int64) for found in near])]
        owners = np.searchsorted(self._stops, others, side="right")
        fresh = ~np.isin(owners, list(passed))
        others, owners, starts = others[fresh], owners[fresh], np.repeat(rows, counts)[fresh]
        misfits = np.empty(len(others))
        kernels.window_misfits(
            places, self._postures, JOINT_COORDINATES, starts, others, self._starts[owners], self._stops[owners],
            self._length, misfits,
        )  # fmt: skip
        order = np.lexsort((misfits, owners))
        best = order[np.unique(owners[order], return_index=True)[1]]
        found = {int(owners[i]) for i in best if misfits[i] <= self._criteria.same}
        for i in best:
            owner = int(owners[i])
            elsewhere = not family or family != self.clips[owner].family
            if elsewhere and self._criteria.same < misfits[i] <= self._criteria.alike:
                shift = int(others[i] - self._starts[owner] - starts[i])
                if self._have_much_in_common(places, self.postures_of(owner), shift):
                    found.add(owner)
        return found

    def _have_much_in_common(
        self, a: Floats32[Array, "poses coordinates"], b: Floats32[Array, "other_poses coordinates"], shift: int
    ) -> bool:
        """Whether all that two motions share, if frame i of one is frame i + shift of the other, is one recording."""
        begin, end = max(0, -shift), min(len(a), len(b) - shift)
        if end - begin < self._criteria.common_seconds * self._rate:
            return False
        a, b = a[begin:end], b[begin + shift : end + shift]
        misfit = np.empty(1)
        first = np.zeros(1, dtype=np.int64)
        # One frame less at both ends leaves room for the part of a frame by which the two may be shifted.
        kernels.window_misfits(
            a, b, JOINT_COORDINATES, first + 1, first + 1, first, first + len(b), len(a) - 2, misfit
        )  # fmt: skip
        if misfit[0] > self._criteria.common:
            return False
        ways = [each[:, -3].astype(np.float64) + 1j * each[:, -1] for each in (a, b)]
        if misfit[0] > self._criteria.straight and min(_strays(way) for way in ways) < self._criteria.least_path:
            return False
        return self._go_one_way(*ways)

    def _go_one_way(self, a: NDArray[np.complex128], b: NDArray[np.complex128]) -> bool:
        """Whether two horizontal ways, as complex numbers, are one; the best turn and scale is one complex factor."""
        a, b = a - a.mean(), b - b.mean()
        size, other = float((np.abs(a) ** 2).sum()), float((np.abs(b) ** 2).sum())
        if min(size, other) < len(a) * self._criteria.least_path**2:
            return False
        explained = abs(complex((np.conj(a) * b).sum())) ** 2 / (size * other)
        return 1 - explained <= self._criteria.path**2


def _strays(way: NDArray[np.complex128]) -> float:
    """Root mean square distance, in metres, from the straight line at an even pace that fits a horizontal way best."""
    time = np.arange(len(way)) - 0.5 * (len(way) - 1)
    around = way - way.mean()
    pace = complex(time @ around) / float(time @ time)
    return float(np.sqrt((np.abs(around - pace * time) ** 2).mean()))


def _root(first: list[int], index: int) -> int:
    while first[index] != index:
        first[index] = first[first[index]]
        index = first[index]
    return index


def _join(first: list[int], a: int, b: int) -> None:
    low, high = sorted((_root(first, a), _root(first, b)))
    first[high] = low
