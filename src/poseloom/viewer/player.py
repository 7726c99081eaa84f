"""A page on which recordings are played: figures side by side along one time that can be scrubbed."""

import threading
import time
from dataclasses import dataclass

import numpy as np
import viser

from poseloom.rotations import heading_angle, quat_from_rotvec
from poseloom.skeleton.contacts import sole_positions
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.viewer.figure import Figure, FigureLook
from poseloom.viewer.markers import ContactMarks, SensorMarks, Trail
from poseloom.viewer.options import Shown, ViewOptions
from poseloom.viewer.plots import PlotLook, add_plot, decimated, signals_of
from poseloom.viewer.server import OpenServer, open_server
from poseloom.viewer.stage import WORLD, Stage
from poseloom.viewer.tracks import Take, Track, position_errors_cm
from poseloom.viewer.words import box, dot, health_text

FRAME_RATE = 40.0
SPACING = 1.25
"""Metres between figures that stand side by side."""

_SPEEDS = ("0.25 ×", "0.5 ×", "1 ×", "2 ×")
_SLIDER_PERIOD, _TEXT_PERIOD = 0.1, 0.25
_TRAIL_FRAMES, _TRAIL_SECONDS = 20, 4.0


class Player:
    """A server that plays a take to whoever looks; all look at the same moment.

    Args:
        take: What to play.
        bind: The address to listen at; other than the loopback, only who brings the token is served.
        port: Where; the first free one from 8080 on unless given.

    Raises:
        ViewerError: if it cannot listen there.
    """

    def __init__(self, take: Take, bind: str = "127.0.0.1", port: int | None = None) -> None:
        self._server: OpenServer = open_server(bind, port)
        viewer = self._server.viser
        self._take = take
        self._stage = Stage(viewer)
        self._clock = _Clock(take.duration)
        with viewer.atomic():
            self._scene = _TakeScene(viewer, self._stage, take)
            self._controls = _Controls(viewer, self._clock, take)
            with self._controls.tabs.add_tab("View"):
                self._beside = viewer.gui.add_checkbox("Side by side", len(take.tracks) > 1)
                self._beside.visible = len(take.tracks) > 1
                self._options = ViewOptions(viewer.gui, self._stage)
            self._draw(self._clock.now())
        self._thread = threading.Thread(target=self._run, name="poseloom-player", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The address to open in a browser."""
        return self._server.url

    @property
    def moment(self) -> float:
        """The second that is shown."""
        return self._clock.now()

    def seek(self, moment: float) -> None:
        """Goes to a second."""
        self._clock.seek(moment)

    def wait(self) -> None:
        """Returns when the player has been closed."""
        while self._thread.is_alive():
            self._thread.join(0.5)

    def close(self) -> None:
        """Stops playing and listening."""
        self._clock.close()
        self._thread.join()
        self._server.close()

    def _run(self) -> None:
        drawn: tuple[float, Shown, bool] | None = None
        while self._clock.wait(1.0 / FRAME_RATE):
            now = self._clock.now()
            wanted = (now, self._options.shown, bool(self._beside.value))
            if wanted != drawn:
                drawn = wanted
                with self._server.viser.atomic():
                    self._draw(now)

    def _draw(self, now: float) -> None:
        self._scene.arrange(bool(self._beside.value))
        self._scene.draw(now, self._options.shown)
        self._controls.draw(now)


class _Clock:
    """Which moment is shown: set by whoever drags the slider, carried on while it plays."""

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self._lock, self._wake, self._closed = threading.Lock(), threading.Event(), False
        self._moment, self._since, self._speed, self._playing = 0.0, 0.0, 1.0, False

    @property
    def playing(self) -> bool:
        return self._playing

    def now(self) -> float:
        """The moment; playing stops at the end."""
        with self._lock:
            if self._playing:
                current = time.monotonic()
                self._moment += (current - self._since) * self._speed
                self._since = current
                if self._moment >= self._duration:
                    self._moment, self._playing = self._duration, False
            return self._moment

    def seek(self, moment: float) -> None:
        with self._lock:
            self._moment, self._since = min(max(moment, 0.0), self._duration), time.monotonic()
        self._wake.set()

    def toggle(self) -> None:
        """Plays, from the beginning if it stands at the end, or pauses."""
        now = self.now()
        with self._lock:
            self._playing = not self._playing
            if self._playing and now >= self._duration:
                self._moment = 0.0
            self._since = time.monotonic()
        self._wake.set()

    def faster(self, speed: float) -> None:
        self.now()
        with self._lock:
            self._speed = speed

    def wait(self, seconds: float) -> bool:
        """Waits until something may have changed; False once closed."""
        self._wake.wait(seconds)
        self._wake.clear()
        return not self._closed

    def close(self) -> None:
        self._closed = True
        self._wake.set()


@dataclass(frozen=True)
class _Actor:
    """A track's figure and its marks."""

    track: Track
    figure: Figure
    contacts: ContactMarks
    trail: Trail
    soles: np.ndarray | None
    label: viser.LabelHandle


class _TakeScene:
    """All figures of a take, and the sensors at the first."""

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


class _Controls:
    """Time, play and pause, speed, and plots."""

    def __init__(self, server: viser.ViserServer, clock: _Clock, take: Take) -> None:
        self._clock, self._take = clock, take
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label(take.name)
        self._legend = gui.add_html("")
        self._time = gui.add_slider("Seconds", 0.0, max(round(take.duration, 2), 0.01), 0.01, 0.0)
        self._time.on_update(self._seek)
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self._play.on_click(lambda _: clock.toggle())
        speed = gui.add_button_group("Speed", _SPEEDS)
        speed.value = "1 ×"
        speed.on_click(lambda _: clock.faster(float(speed.value.split()[0])))
        self.tabs = gui.add_panel()
        self._errors = {track.label: errors for track in take.tracks if (errors := position_errors_cm(take, track))}
        self._add_plots(gui)
        gui.main_panel.dock_right()
        self.tabs.dock_below(gui.main_panel)
        self._slid = self._written = 0.0
        self._playing = False

    def draw(self, now: float) -> None:
        """Shows the moment; the slider and the words move less often than the figures."""
        current = time.monotonic()
        if self._playing != self._clock.playing:
            self._playing = self._clock.playing
            self._play.label = "Pause" if self._playing else "Play"
            self._play.icon = viser.Icon.PLAYER_PAUSE if self._playing else viser.Icon.PLAYER_PLAY
            self._slid = self._written = 0.0
        if current - self._slid > _SLIDER_PERIOD or not self._playing:
            self._slid = current
            self._time.value = round(now, 2)
        if current - self._written > _TEXT_PERIOD or not self._playing:
            self._written = current
            self._legend.content = self._words(now)

    def _seek(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        # Also called when the clock moves the slider: that must not stop the clock.
        if event.client is not None:
            self._clock.seek(float(self._time.value))

    def _words(self, now: float) -> str:
        lines: list[str] = []
        for track in self._take.tracks:
            words = f"{dot(track.colour)}<b>{track.label}</b>"
            if track.label in self._errors:
                times, errors = self._errors[track.label]
                here = errors[max(int(np.searchsorted(times, now + 1e-9, side="right")) - 1, 0)]
                words += f" {here:.1f} cm off, {errors.mean():.1f} on average"
            if track.health is not None:
                words += f'<br><span style="margin-left:1.15em">{health_text(track.health[track.frame_at(now)])}</span>'
            lines.append(words)
        return box("<br>".join(lines))

    def _add_plots(self, gui: viser.GuiApi) -> None:
        recording = self._take.recording
        if not self._errors and recording is None:
            return
        with self.tabs.add_tab("Plots"):
            for track in self._take.tracks:
                if track.label in self._errors:
                    times, errors = self._errors[track.label]
                    look = PlotLook(f"{track.label}: joints off, cm", (track.label,), (track.colour,), 0.0)
                    add_plot(gui, look, decimated(times, errors[:, None]))
            if recording is not None:
                times = recording.times - recording.times[0]
                for signal in signals_of(recording.layout):
                    values = np.stack([signal.values(recording.sample(i)) for i in range(len(recording))])
                    add_plot(gui, PlotLook(signal.title, signal.labels), decimated(times, values))
