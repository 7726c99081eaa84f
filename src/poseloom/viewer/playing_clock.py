"""The one time of a page on which recordings are played."""

import threading
import time


class PlayingClock:
    """Which moment is shown: set by whoever drags the slider, carried on while it plays.

    Args:
        duration: Seconds after which it stands.
    """

    def __init__(self, duration: float) -> None:
        self._duration = duration
        self._lock, self._wake, self._closed = threading.Lock(), threading.Event(), False
        self._moment, self._since, self._speed, self._playing = 0.0, 0.0, 1.0, False

    @property
    def playing(self) -> bool:
        """Whether it goes on by itself."""
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
        """Goes to a second."""
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
        """Goes on at another speed, 1 being that of life."""
        self.now()
        with self._lock:
            self._speed = speed

    def wait(self, seconds: float) -> bool:
        """Waits until something may have changed; False once closed."""
        self._wake.wait(seconds)
        self._wake.clear()
        return not self._closed

    def close(self) -> None:
        """Ends all waiting."""
        self._closed = True
        self._wake.set()
