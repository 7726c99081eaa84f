"""A page on which recordings are played: figures side by side along one time that can be scrubbed."""

import threading

from poseloom.viewer.options import Shown, ViewOptions
from poseloom.viewer.playing_clock import PlayingClock
from poseloom.viewer.server import OpenServer, open_server
from poseloom.viewer.stage import Stage
from poseloom.viewer.take_controls import TakeControls
from poseloom.viewer.take_scene import TakeScene
from poseloom.viewer.tracks import Take

FRAME_RATE = 40.0


class Player:
    """A server that plays a take to whoever looks; all look at the same moment.

    Args:
        take: What to play.
        bind: The address to listen at; other than the loopback, only who brings the token is served.
        port: Where; the first free one from 8080 on unless given.
        token: Secret that a visitor must know, on this machine too; see `access_for`.

    Raises:
        ViewerError: if it cannot listen there.
    """

    def __init__(self, take: Take, bind: str = "127.0.0.1", port: int | None = None, token: str = "") -> None:
        self._server: OpenServer = open_server(bind, port, token)
        viewer = self._server.viser
        self._take = take
        self._stage = Stage(viewer)
        self._clock = PlayingClock(take.duration)
        with viewer.atomic():
            self._scene = TakeScene(viewer, self._stage, take)
            self._controls = TakeControls(viewer, self._clock, take)
            with self._controls.tabs.add_tab("View"):
                self._beside = viewer.gui.add_checkbox("Side by side", len(take.tracks) > 1)
                self._beside.visible = len(take.tracks) > 1
                self._options = ViewOptions(viewer.gui, self._stage)
            self._draw(self._clock.now())
        self._thread = threading.Thread(target=self._run, name="poseloom-player", daemon=True)
        self._thread.start()

    @property
    def exposure(self) -> str:
        """Who else can look; empty where only this machine can."""
        return self._server.exposure

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
