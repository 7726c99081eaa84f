"""Buttons, slider, words and plots beside what is played."""

import time

import numpy as np
import viser

from poseloom.viewer.playing_clock import PlayingClock
from poseloom.viewer.plots import PlotLook, add_plot, decimated, signals_of
from poseloom.viewer.tracks import Take, position_errors_cm
from poseloom.viewer.words import box, dot, health_text

_SPEEDS = ("0.25 ×", "0.5 ×", "1 ×", "2 ×")
_SLIDER_PERIOD, _TEXT_PERIOD = 0.1, 0.25


class TakeControls:
    """Time, play and pause, speed, and plots.

    Args:
        server: Where they are drawn.
        clock: What they set.
        take: What is played.
    """

    def __init__(self, server: viser.ViserServer, clock: PlayingClock, take: Take) -> None:
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
        self._slid = self._written = float("-inf")
        self._playing = False

    def draw(self, now: float) -> None:
        """Shows the moment; the slider and the words move less often than the figures."""
        current = time.monotonic()
        if self._playing != self._clock.playing:
            self._playing = self._clock.playing
            self._play.label = "Pause" if self._playing else "Play"
            self._play.icon = viser.Icon.PLAYER_PAUSE if self._playing else viser.Icon.PLAYER_PLAY
            self._slid = self._written = float("-inf")
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
