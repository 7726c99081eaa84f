"""What stands in the scene beside the figures: sensors, feet that stand, and the way that was walked."""

import math
from collections import deque
from collections.abc import Collection, Sequence

import numpy as np
import viser

from poseloom.arrays import Array, Bools, Floats
from poseloom.rotations import quat_from_matrix
from poseloom.sensors import Placement, Sample, SensorKind, SensorLayout, SensorStatus
from poseloom.skeleton.contacts import ContactThresholds, sole_points
from poseloom.skeleton.kinematics import BoneFrames, bone_points
from poseloom.skeleton.skeleton import Skeleton
from poseloom.viewer.colours import LOST, SILENT, STANDING, WELL, Colour

_AXIS, _AXIS_RADIUS, _BALL = 0.11, 0.006, 0.022
_DISC, _DISC_HEIGHT = 0.055, 0.004
_TRAIL_SECONDS, _TRAIL_STEP, _TRAIL_PIECES = 4.0, 0.2, 20
_RISE = 0.02
"""Metres a second by which the level at which feet stand may rise."""
_TRAIL_HEIGHT, _TRAIL_JUMP = 0.008, 1.5


class SensorMarks:
    """The sensors where they say that they are, or where they are worn if they cannot say it: a ball with axes each.

    Args:
        scene: Where to put them.
        path: Scene node that is theirs.
        layout: The sensors.
    """

    def __init__(self, scene: viser.SceneApi, path: str, layout: SensorLayout) -> None:
        self._layout = layout
        self._node = scene.add_frame(path, show_axes=False)
        self._marks = [
            scene.add_frame(
                f"{path}/{index}",
                axes_length=_AXIS,
                axes_radius=_AXIS_RADIUS,
                origin_radius=_BALL,
                origin_color=WELL,
                visible=False,
            )
            for index in range(len(layout))
        ]
        self._labels = [
            scene.add_label(f"{path}/{index}/n", name, visible=False, anchor="bottom-center", position=(0.0, 0.04, 0.0))
            for index, name in enumerate(layout.names)
        ]
        self._placed = [False] * len(layout)

    def update(
        self,
        sample: Sample,
        frames: BoneFrames | None,
        skeleton: Skeleton,
        placements: Sequence[Placement],
        troubled: Collection[str] = (),
    ) -> None:
        """Moves them.

        Args:
            sample: What they said. Of a tracker that said nothing the last place stays.
            frames: The bones of the present pose, for sensors that do not know where they are.
            skeleton: Whose bones these are.
            placements: Where each is worn.
            troubled: Names of those that are disbelieved: they turn red; silent ones turn grey.
        """
        for index, (sensor, mark) in enumerate(zip(self._layout.sensors, self._marks, strict=True)):
            place, turn = sample.positions[index], sample.quats_wxyz[index]
            if sensor.kind is not SensorKind.TRACKER and frames is not None:
                bone = skeleton.index(sensor.bone)
                place = bone_points(frames, bone, placements[index].p_bone_sensor)
                if np.isnan(turn[0]):
                    turn = quat_from_matrix(frames.rotations[bone] @ placements[index].R_bone_sensor)
            if np.isfinite(place[0]):
                mark.position = place
                if not self._placed[index]:
                    self._placed[index] = mark.visible = True
            if np.isfinite(turn[0]):
                mark.wxyz = turn
            silent = sample.status[index] == SensorStatus.MISSING
            mark.origin_color = LOST if sensor.name in troubled else SILENT if silent else WELL

    def show(self, visible: bool, named: bool) -> None:
        """Shows or hides them, and their names."""
        self._node.visible = visible
        for label in self._labels:
            label.visible = visible and named

    def remove(self) -> None:
        """Takes them out of the scene for good."""
        self._node.remove()


class ContactMarks:
    """A disc on the floor under each heel and toe that stands.

    Args:
        scene: Where to put them.
        path: Scene node that is theirs.
    """

    def __init__(self, scene: viser.SceneApi, path: str) -> None:
        self._node = scene.add_frame(path, show_axes=False)
        self._discs = [
            scene.add_cylinder(
                f"{path}/{point}",
                radius=_DISC,
                height=_DISC_HEIGHT,
                color=STANDING,
                opacity=0.7,
                cast_shadow=False,
                receive_shadow=False,
                # viser's cylinders stand along Z.
                wxyz=(math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0),
                visible=False,
            )
            for point in range(4)
        ]
        self._standing = np.zeros(4, dtype=np.bool_)

    def update(self, places: Floats[Array, "4 3"], standing: Bools[Array, "4"], floor: float = 0.0) -> None:
        """Left heel, left toe, right heel and right toe: where they are, and which of them stand."""
        for point, disc in enumerate(self._discs):
            if standing[point] and not self._standing[point]:
                disc.position = places[point] * (1.0, 0.0, 1.0) + np.array([0.0, floor + _DISC_HEIGHT, 0.0])
            if standing[point] != self._standing[point]:
                disc.visible = bool(standing[point])
        self._standing = standing.copy()

    def show(self, visible: bool) -> None:
        """Shows or hides them."""
        self._node.visible = visible

    def forget(self) -> None:
        """Forgets where feet stood: after a jump in time they stand elsewhere."""
        self._standing = np.zeros(4, dtype=np.bool_)
        for disc in self._discs:
            disc.visible = False

    def remove(self) -> None:
        """Takes them out of the scene for good."""
        self._node.remove()


class SoleContacts:
    """Which heels and toes stand, from one pose after another, as far as this can be told at once.

    Args:
        skeleton: The body.
        thresholds: Heights and speeds.
    """

    def __init__(self, skeleton: Skeleton, thresholds: ContactThresholds | None = None) -> None:
        self._limits = thresholds or ContactThresholds()
        self._points = [
            (skeleton.index(f"{side}{bone}"), point)
            for side in ("left", "right")
            for bone, point in zip(("Foot", "Toes"), sole_points(skeleton, side), strict=True)
        ]
        self._last: tuple[float, Floats[Array, "4 3"]] | None = None
        self._standing = np.zeros(4, dtype=np.bool_)
        self._levels = np.full(2, np.inf)
        self.floor = 0.0

    def places(self, frames: BoneFrames) -> Floats[Array, "4 3"]:
        """Left heel, left toe, right heel and right toe in the world."""
        return np.stack([bone_points(frames, bone, point) for bone, point in self._points])

    def step(self, time: float, places: Floats[Array, "4 3"]) -> Bools[Array, "4"]:
        """Which of them stand.

        Args:
            time: Of the pose, seconds.
            places: What `places` says of it.
        """
        if self._last is None or time <= self._last[0]:
            self._last = (time, places)
            return self._standing
        seconds = time - self._last[0]
        speeds = np.linalg.norm(places - self._last[1], axis=1) / seconds
        self._last = (time, places)
        # Heels and toes stand where they have been lowest of late, each at a level of their own, for feet differ from
        # the average: it falls at once and rises slowly.
        lowest = places[:, 1].reshape(2, 2).min(axis=0)
        self._levels = np.minimum(lowest, self._levels + _RISE * seconds)
        self.floor = float(self._levels.min())
        heights = places[:, 1] - np.tile(self._levels, 2)
        on = (heights < self._limits.height_on) & (speeds < self._limits.speed_on)
        off = (heights > self._limits.height_off) | (speeds > self._limits.speed_off)
        self._standing = (self._standing | on) & ~off
        return self._standing


class Trail:
    """The way over the floor of the last few seconds.

    Args:
        scene: Where to draw it.
        path: Scene node that is its own.
        colour: Of the line.
    """

    def __init__(self, scene: viser.SceneApi, path: str, colour: Colour) -> None:
        self._points: deque[tuple[float, Floats[Array, 3]]] = deque(maxlen=_TRAIL_PIECES + 1)
        self._line = scene.add_line_segments(
            path, np.zeros((_TRAIL_PIECES, 2, 3)), np.array(colour, dtype=np.uint8), thickness=0.012
        )

    def add(self, time: float, place: Floats[Array, "3"], floor: float = 0.0) -> None:
        """Goes on to a place, of which the height does not matter."""
        if self._points:
            seconds, metres = time - self._points[-1][0], place[[0, 2]] - self._points[-1][1][[0, 2]]
            if not 0 <= seconds < _TRAIL_SECONDS or np.hypot(*metres) > _TRAIL_JUMP:
                self._points.clear()
        if self._points and time - self._points[-1][0] < _TRAIL_STEP:
            return
        self._points.append((time, place * (1.0, 0.0, 1.0) + np.array([0.0, floor + _TRAIL_HEIGHT, 0.0])))
        self._draw()

    def follow(self, times: Floats[Array, "points"], places: Floats[Array, "points 3"], floor: float = 0.0) -> None:
        """Shows a way that is known."""
        self._points.clear()
        for time, place in zip(times[-_TRAIL_PIECES - 1 :], places[-_TRAIL_PIECES - 1 :], strict=True):
            self._points.append((float(time), place * (1.0, 0.0, 1.0) + np.array([0.0, floor + _TRAIL_HEIGHT, 0.0])))
        self._draw()

    def show(self, visible: bool) -> None:
        """Shows or hides it."""
        self._line.visible = visible

    def remove(self) -> None:
        """Takes it out of the scene for good."""
        self._line.remove()

    def _draw(self) -> None:
        points = np.stack([place for _, place in self._points])
        pieces = np.repeat(points[-1:], 2 * _TRAIL_PIECES, axis=0).reshape(_TRAIL_PIECES, 2, 3)
        pieces[: len(points) - 1, 0], pieces[: len(points) - 1, 1] = points[:-1], points[1:]
        self._line.points = pieces
