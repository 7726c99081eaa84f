"""A live session's panels: how it goes, what can be asked of it, and plots."""

import time
from collections import deque
from collections.abc import Sequence

import numpy as np
import viser

from poseloom.live.contract import (
    Calibrate,
    CalibrationKind,
    CancelCalibration,
    ChooseMethod,
    Counters,
    Latency,
    Notice,
    Post,
    ResetHeading,
    SessionFacts,
    StartRecording,
    Stop,
    StopRecording,
    Update,
)
from poseloom.methods.contract import Health, HealthState
from poseloom.viewer.colours import LOST, METHODS
from poseloom.viewer.plots import PlotLook, Rolling, add_plot, signals_of
from poseloom.viewer.words import (
    arrivals_text,
    counters_text,
    findings_text,
    guide_text,
    notice_text,
    sensor_table,
    status_text,
)

_TEXT_PERIOD = 0.25
_PLOT_PERIOD = 0.3
_SAID_SECONDS = 10.0
"""For how long the last notice stands in the panel."""
_MOST_ROUNDS = 5
_HEALTH_LEVELS = {
    HealthState.LOST: 0.0,
    HealthState.COASTING: 1.0,
    HealthState.REJOINING: 2.0,
    HealthState.DEGRADED: 2.0,
    HealthState.OK: 3.0,
}
_NO_LATENCY = Latency(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_ARMS_OUT, _EIGHT = "Arms out", "Eight poses"


class LivePanel:
    """Status and buttons.

    Args:
        server: Where they go: the status and the most needed buttons into the main panel, the rest into tabs, which a
            phone keeps folded.
        facts: The session.
        post: Who carries out what is asked.
    """

    def __init__(self, server: viser.ViserServer, facts: SessionFacts, post: Post) -> None:
        self._facts, self._post = facts, post
        self._arrived: deque[str] = deque(maxlen=20)
        self._server = server
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        self._status = gui.add_html(status_text(facts, None, _NO_LATENCY, Counters()))
        self._arrivals = gui.add_html("", visible=False)
        self._findings = gui.add_html("", visible=False)
        self._said = gui.add_html("", visible=False)
        self._guide = gui.add_html("", visible=False)
        self._cancel = gui.add_button("Cancel calibration", color="gray", visible=False)
        self._cancel.on_click(lambda _: post(CancelCalibration()))
        self._record = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD)
        self._record.on_click(lambda _: post(StartRecording() if self._facts.recording is None else StopRecording()))
        self._reset = gui.add_button(
            "Reset heading", icon=viser.Icon.COMPASS, hint="Stand straight and look ahead first"
        )
        self._reset.on_click(lambda _: post(ResetHeading()))
        self._calibrate = gui.add_button_group("Calibrate", (_ARMS_OUT, _EIGHT) if facts.guided else (_ARMS_OUT,))
        self._calibrate.on_click(self._begin)
        self.tabs = gui.add_panel()
        self._add_setup(gui)
        gui.main_panel.dock_right()
        self.tabs.dock_below(gui.main_panel)
        self._calibrating = False
        self._written = float("-inf")
        self.changed(facts)

    def changed(self, facts: SessionFacts) -> None:
        """Shows what the session now is."""
        self._facts = facts
        recording = facts.recording is not None
        self._record.label = "Stop recording" if recording else "Record"
        self._record.color = "red" if recording else None
        if tuple(self._method.options) != facts.methods:
            self._method.options = facts.methods
        self._method.value = facts.method
        self._arrivals.content = arrivals_text(facts.arrivals)
        self._arrivals.visible = facts.arrivals is not None
        if facts.arrivals is not None:
            self._arrived.append(facts.arrivals.text)
        self._say(facts.notices, time.monotonic())

    def draw(self, update: Update, now: float) -> None:
        """Writes the status anew, a few times a second."""
        if update.calibration is not None or self._calibrating:
            self._lead(update)
        if now - self._written < _TEXT_PERIOD:
            return
        self._written = now
        health = None if update.frame is None else update.frame.health
        self._status.content = status_text(self._facts, health, update.latency, update.counters)
        self._findings.content = findings_text(update.findings)
        self._findings.visible = bool(update.findings)
        self._say(update.notices, now)
        self._sensors.content = sensor_table(self._facts, update.sample.status.tolist(), update.findings)
        self._counters.content = counters_text(update.counters, self._facts)

    def _say(self, notices: Sequence[Notice], now: float) -> None:
        """Shows the last notice for a while; what arrives stands above for as long as it is so."""
        others = [notice for notice in notices if notice.text not in self._arrived]
        said = [notice for notice in others[-1:] if now - notice.time < _SAID_SECONDS]
        self._said.content = "".join(notice_text(notice) for notice in said)
        self._said.visible = bool(said)

    def _add_setup(self, gui: viser.GuiApi) -> None:
        with self.tabs.add_tab("Sensors"):
            self._sensors = gui.add_html("")
            self._counters = gui.add_html("")
        with self.tabs.add_tab("Session"):
            self._method = gui.add_dropdown("Method", self._facts.methods, initial_value=self._facts.method)
            self._method.on_update(self._choose)
            self._rounds = gui.add_slider("Rounds", 1, _MOST_ROUNDS, 1, 1, hint="How often the eight poses are held")
            self._rounds.visible = self._facts.guided
            gui.add_button("End session", color="red", icon=viser.Icon.POWER).on_click(self._ask_to_stop)

    def _choose(self, event: viser.GuiEvent[viser.GuiDropdownHandle[str]]) -> None:
        # Also called when the session itself sets the value: that must not become a command.
        if event.client is not None and self._method.value != self._facts.method:
            self._post(ChooseMethod(self._method.value))

    def _begin(self, _event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        kind = CalibrationKind.GUIDED if self._calibrate.value == _EIGHT else CalibrationKind.ARMS_OUT
        self._post(Calibrate(kind, int(self._rounds.value)))

    def _ask_to_stop(self, event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
        if event.client is None:
            return
        gui = event.client.gui
        with gui.add_modal("End the session?") as modal:
            end, on = gui.add_button("End it", color="red"), gui.add_button("Go on", color="gray")

        def leave(_event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            modal.close()

        on.on_click(leave)
        end.on_click(leave)
        end.on_click(lambda _: self._post(Stop()))

    def _lead(self, update: Update) -> None:
        """In a calibration the guide takes the place of the buttons."""
        running = update.calibration is not None
        if running != self._calibrating:
            self._calibrating = running
            for handle in (self._guide, self._cancel):
                handle.visible = running
            for handle in (self._record, self._reset, self._calibrate):
                handle.visible = not running
        if update.calibration is not None:
            self._guide.content = guide_text(update.calibration)


class LivePlots:
    """What sensors say, how late poses are, and how well it goes, over the last seconds.

    Args:
        tabs: The panel that gets a tab for them.
        gui: Where.
        facts: The session.
    """

    def __init__(self, tabs: viser.PanelHandle, gui: viser.GuiApi, facts: SessionFacts) -> None:
        self._signals = signals_of(facts.layout)
        self._series = [Rolling(len(signal.labels)) for signal in self._signals]
        self._latency, self._health = Rolling(2, peaks=True), Rolling(1)
        with tabs.add_tab("Signals"):
            self._plots = [
                add_plot(gui, PlotLook(signal.title, signal.labels), series.lines())
                for signal, series in zip(self._signals, self._series, strict=True)
            ]
            look = PlotLook("latency, ms", ("arrival to pose", "the method's step"), (METHODS[0], METHODS[1]), 0.0)
            self._latency_plot = add_plot(gui, look, self._latency.lines())
            look = PlotLook("health: 3 ok, 2 degraded or rejoining, 1 coasting, 0 lost", ("health",), (LOST,), 0.0)
            self._health_plot = add_plot(gui, look, self._health.lines())
        self._drawn = float("-inf")

    def add(self, update: Update) -> None:
        """Keeps the values of one step."""
        now = update.finished
        for signal, series in zip(self._signals, self._series, strict=True):
            series.add(now, signal.values(update.sample))
        self._latency.add(now, np.array([update.latency.newest, update.latency.step]))
        self._health.add(now, np.array([_level(None if update.frame is None else update.frame.health)]))

    def draw(self, now: float) -> None:
        """Draws anew, a few times a second."""
        if now - self._drawn < _PLOT_PERIOD:
            return
        self._drawn = now
        for plot, series in zip(self._plots, self._series, strict=True):
            plot.data = series.lines()
        self._latency_plot.data = self._latency.lines()
        self._health_plot.data = self._health.lines()


def _level(health: Health | None) -> float:
    return float("nan") if health is None else _HEALTH_LEVELS[health.state]
