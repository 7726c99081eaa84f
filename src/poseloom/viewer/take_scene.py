"""What is played as it stands on the stage: figures with their marks, and sensors."""

from dataclasses import dataclass

import numpy as np
import viser

from poseloom.rotations import heading_angle, quat_from_rotvec
from poseloom.skeleton.contacts import sole_positions
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.viewer.figure import Figure, FigureLook
from poseloom.viewer.markers import ContactMarks, SensorMarks, Trail
from poseloom.viewer.options import Shown
from poseloom.viewer.stage import WORLD, Stage
from poseloom.viewer.tracks import Take, Track

SPACING = 1.25
"""Metres between figures that stand side by side."""

_TRAIL_FRAMES, _TRAIL_SECONDS = 20, 4.0


@dataclass(frozen=True)
class _Actor:
    """A track's figure and its marks."""

    track: Track
    figure: Figure
    contacts: ContactMarks
    trail: Trail
    soles: np.ndarray | None
    label: viser.LabelHandle


class TakeScene:
    """All figures of a take, and the sensors at the first.

    Args:
        server: Where they are drawn.
        stage: The ground that they stand on.
        take: What is played.
    """

    def __init__(self, server: viser.ViserServer, stage: Stage, take: Take) -> None:
        self._take, self._stage = take, stage
        self._actors = [_actor(server.scene, index, track) for index, track in enumerate(take.tracks)]
        layout = None if take.recording is None else take.recording.layout
        self._sensors = None if layout is None else SensorMarks(server.scene, f"{WORLD}/0/s", layout)
        self._beside: bool | None = None
        self._shown = Shown()
        first = take.tracks[0].motion
        stage.face(float(heading_angle(quat_from_rotvec(first.q[0, 3:6]))))

    def arrange(self, beside: bool) -> None:
        """Puts the figures side by side, or all into one place."""
        if beside == self._beside:
            return
        self._beside = beside
        spacing = SPACING if beside else 0.0
        for index, actor in enumerate(self._actors):
            actor.figure.place(self._stage.across(spacing * index))
            actor.label.visible = beside and len(self._actors) > 1
        self._stage.arrange(len(self._actors) if beside else 1, spacing)
        self._draw_focus(0.0, jump=True)

    def draw(self, now: float, shown: Shown) -> None:
        """Shows a moment, with what is wanted to be seen."""
        if shown != self._shown:
            self._apply(shown)
        for actor in self._actors:
            _show_moment(actor, now, shown)
        self._draw_sensors(now)
        self._draw_focus(now)

    def _draw_focus(self, now: float, jump: bool = False) -> None:
        first = self._take.tracks[0]
        spacing = SPACING if self._beside else 0.0
        root = first.motion.q[first.frame_at(now), :3]
        middle = root + self._stage.across(0.5 * spacing * (len(self._actors) - 1))
        (self._stage.centre if jump else self._stage.follow)(middle)

    def _draw_sensors(self, now: float) -> None:
        recording = self._take.recording
        if recording is None or self._sensors is None:
            return
        times = recording.times - recording.times[0]
        index = max(int(np.searchsorted(times, now + 1e-9, side="right")) - 1, 0)
        first = self._take.tracks[0]
        frames = forward_kinematics(first.motion.skeleton, first.motion.q[first.frame_at(now)])
        self._sensors.update(recording.sample(index), frames, first.motion.skeleton, recording.placements)

    def _apply(self, shown: Shown) -> None:
        self._shown = shown
        for actor in self._actors:
            actor.contacts.show(shown.contacts)
            actor.trail.show(shown.trail)
        if self._sensors is not None:
            self._sensors.show(shown.sensors, shown.names)


def _actor(scene: viser.SceneApi, index: int, track: Track) -> _Actor:
    path = f"{WORLD}/{index}"
    figure = Figure(scene, path, track.motion.skeleton, FigureLook(track.colour))
    soles = None if track.standing is None else sole_positions(track.motion)
    label = scene.add_label(f"{path}/l", track.label, anchor="bottom-center", visible=False)
    trail = Trail(scene, f"{path}/t", track.colour)
    return _Actor(track, figure, ContactMarks(scene, f"{path}/c"), trail, soles, label)


def _show_moment(actor: _Actor, now: float, shown: Shown) -> None:
    track, motion = actor.track, actor.track.motion
    frame = track.frame_at(now)
    moved = None if motion.displacements is None else motion.skeleton.offsets + motion.displacements[frame]
    actor.figure.pose(motion.q[frame], moved)
    actor.figure.doubt(track.spread[frame] if track.spread is not None and shown.doubt else None)
    root = motion.q[frame, :3]
    actor.label.position = root * (1.0, 0.0, 1.0) + np.array([0.0, track.floor + 1.95, 0.0])
    if actor.soles is not None and track.standing is not None:
        actor.contacts.update(actor.soles[frame], track.standing[frame], track.floor)
    if shown.trail:
        step = max(1, round(_TRAIL_SECONDS / _TRAIL_FRAMES * motion.rate))
        rows = np.unique(np.r_[np.arange(frame % step, frame, step)[-_TRAIL_FRAMES:], frame])
        actor.trail.follow(track.times[rows], motion.q[rows, :3], track.floor)
