"""The viewer of a live session: a sink that shows what the session makes and hands on what a person asks of it."""

import time
from collections.abc import Iterable

import numpy as np
import viser

from poseloom.calibration.poses import guided_pose
from poseloom.live.contract import (
    CalibrationProgress,
    Command,
    Level,
    Notice,
    Post,
    SessionFacts,
    Update,
)
from poseloom.methods.contract import Frame
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import forward_kinematics
from poseloom.viewer.colours import GUIDE, METHODS
from poseloom.viewer.figure import Figure, FigureLook
from poseloom.viewer.markers import ContactMarks, SensorMarks, SoleContacts, Trail
from poseloom.viewer.options import Shown, ViewOptions
from poseloom.viewer.panels import LivePanel, LivePlots
from poseloom.viewer.server import open_server
from poseloom.viewer.stage import WORLD, Stage
from poseloom.viewer.words import NOTICE_COLOURS

FRAME_RATE = 40.0
"""Poses a second that are sent to browsers at most: smooth to look at, and drawing takes its share of one core."""

_GUIDE_SPACING, _GUIDE_SLACK = 1.1, 0.3
_NOTICE_SECONDS = 12.0


class SessionViewer:
    """A sink that shows a session in browsers. It listens as soon as it is made, so that its address can be told.

    Args:
        bind: The address to listen at; other than the loopback, only who brings the token is served.
        port: Where; the first free one from 8080 on unless given.
        frame_rate: Poses a second that are sent to browsers at most.
        token: Secret that a visitor must know, on this machine too; see `access_for`.

    Raises:
        ViewerError: if it cannot listen there.
    """

    name = "viewer"
    capacity = 1

    def __init__(
        self, bind: str = "127.0.0.1", port: int | None = None, frame_rate: float = FRAME_RATE, token: str = ""
    ) -> None:
        self._server = open_server(bind, port, token)
        self._period = 1.0 / frame_rate
        self._stage = Stage(self._server.viser)
        self._scene: _LiveScene | None = None
        self._panel: LivePanel | None = None
        self._plots: LivePlots | None = None
        self._options: ViewOptions | None = None
        self._post: Post = _nobody
        self._drawn = float("-inf")  # the clock may have begun a moment ago
        self._told = 0
        self.frames = 0

    @property
    def url(self) -> str:
        """The address to open in a browser."""
        return self._server.url

    @property
    def exposure(self) -> str:
        """Who else can look and press buttons; empty where only this machine can."""
        return self._server.exposure

    def open(self, facts: SessionFacts, post: Post) -> None:
        """Builds scene and panels; see `poseloom.live.contract.Sink`."""
        self._post = post
        server = self._server.viser
        try:
            self._build(server, facts, post)
        except BaseException:
            # A session does not close a sink that could not be opened.
            self._server.close()
            raise

    def _build(self, server: viser.ViserServer, facts: SessionFacts, post: Post) -> None:
        with server.atomic():
            self._panel = LivePanel(server, facts, post)
            self._plots = LivePlots(self._panel.tabs, server.gui, facts)
            with self._panel.tabs.add_tab("View"):
                self._options = ViewOptions(server.gui, self._stage)
            self._scene = _LiveScene(server, self._stage, facts)

    def changed(self, facts: SessionFacts) -> None:
        """Shows the new facts; the figure is made anew if it is another body or another layout."""
        if self._scene is None or self._panel is None:
            return
        server = self._server.viser
        with server.atomic():
            old = self._scene.facts
            self._panel.changed(facts)
            if old.skeleton is not facts.skeleton or old.layout is not facts.layout:
                self._scene.remove()
                self._scene = _LiveScene(server, self._stage, facts)
            self._scene.facts = facts
        self._notify(facts.notices)

    def show(self, update: Update) -> None:
        """Draws one step, unless the last was drawn a moment ago or nobody looks."""
        if self._scene is None or self._panel is None or self._plots is None or self._options is None:
            return
        self._plots.add(update)
        now = time.monotonic()
        clients = self._server.viser.get_clients()
        if now - self._drawn < self._period or not clients:
            return
        self._drawn = now
        self.frames += 1
        with self._server.viser.atomic():
            self._scene.draw(update, self._options.shown)
            self._panel.draw(update, now)
            self._plots.draw(now)
        self._notify(update.notices)

    def _notify(self, notices: Iterable[Notice]) -> None:
        clients = self._server.viser.get_clients()
        for notice in notices:
            if notice.number > self._told and clients:
                self._told = notice.number
                # The others stand in the panel: what lies over the figure had better be rare.
                if notice.level is Level.ERROR:
                    _notify(clients.values(), notice)

    def close(self) -> None:
        """Stops listening."""
        self._server.close()


class _LiveScene:
    """The figure and what belongs to it."""

    def __init__(self, server: viser.ViserServer, stage: Stage, facts: SessionFacts) -> None:
        scene = server.scene
        self.facts = facts
        self._stage = stage
        self._figure = Figure(scene, f"{WORLD}/f", facts.skeleton, FigureLook(METHODS[0]))
        self._sensors = SensorMarks(scene, f"{WORLD}/s", facts.layout)
        self._contacts = ContactMarks(scene, f"{WORLD}/c")
        self._trail = Trail(scene, f"{WORLD}/t", METHODS[0])
        self._soles = SoleContacts(facts.skeleton)
        self._guide = Figure(scene, f"{WORLD}/g", average_body(), FigureLook(GUIDE, 0.75))
        self._guide.show(False)
        self._guided = ""
        self._beside = np.full(3, np.inf)
        self._shown = Shown()
        self._last: Frame | None = None
        self._figure.pose(_at_rest(facts))

    def draw(self, update: Update, shown: Shown) -> None:
        if shown != self._shown:
            self._apply(shown)
        frame = update.frame or self._last
        frames = None
        if frame is not None:
            frames = forward_kinematics(self.facts.skeleton, frame.pose.q)
            self._figure.pose(frame.pose.q)
            self._figure.doubt(frame.spread if shown.doubt else None)
            places = self._soles.places(frames)
            self._contacts.update(places, self._soles.step(frame.time, places), self._soles.floor)
            self._trail.add(frame.time, frame.pose.q[:3], self._soles.floor)
        self._last = frame
        troubled = {finding.sensor for finding in update.findings}
        self._sensors.update(update.sample, frames, self.facts.skeleton, self.facts.placements, troubled)
        self._lead(update.calibration, frame)
        middle = np.zeros(3) if frame is None else frame.pose.q[:3]
        self._stage.follow(middle + np.array([0.5 * _GUIDE_SPACING, 0.0, 0.0]) if self._guided else middle)

    def remove(self) -> None:
        for part in (self._figure, self._sensors, self._contacts, self._trail, self._guide):
            part.remove()

    def _apply(self, shown: Shown) -> None:
        self._shown = shown
        self._sensors.show(shown.sensors, shown.names)
        self._contacts.show(shown.contacts)
        self._trail.show(shown.trail)

    def _lead(self, progress: CalibrationProgress | None, frame: Frame | None) -> None:
        """Shows the pose to hold beside the wearer."""
        wanted = progress.pose if progress is not None else ""
        if wanted:
            self._stand_beside(frame)
        if wanted == self._guided:
            return
        if bool(wanted) != bool(self._guided):
            self._guide.show(bool(wanted))
            self._stage.arrange(2 if wanted else 1, _GUIDE_SPACING)
        self._guided = wanted
        if wanted:
            self._guide.pose(guided_pose(wanted).q)

    def _stand_beside(self, frame: Frame | None) -> None:
        """Keeps the guide beside a wearer who walks off, but still while the wearer is."""
        wearer = np.zeros(3) if frame is None else frame.pose.q[:3] * (1.0, 0.0, 1.0)
        beside = wearer + np.array([_GUIDE_SPACING, self._soles.floor, 0.0])
        if np.linalg.norm(beside - self._beside) > _GUIDE_SLACK:
            self._beside = beside
            self._guide.place(beside)


def _at_rest(facts: SessionFacts) -> np.ndarray:
    """The rest pose with the feet on the floor, to be seen until the first pose comes."""
    q = np.zeros(facts.skeleton.size)
    q[1] = -float(facts.skeleton.rest_positions()[:, 1].min()) + 0.03
    return q


def _notify(clients: Iterable[viser.ClientHandle], notice: Notice) -> None:
    for client in clients:
        client.add_notification(
            "Error", notice.text, auto_close_seconds=_NOTICE_SECONDS, color=NOTICE_COLOURS[notice.level]
        )


def _nobody(_command: Command) -> None:
    """Before a session has opened the viewer nobody hears."""
