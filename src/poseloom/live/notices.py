"""What a person should know, numbered and kept, told from any thread."""

import threading
import time
from collections import deque

from poseloom.live.contract import Level, Notice

_SHOWN, _KEPT = 8, 1000


class Notices:
    """Collects notices; the last thousand are kept."""

    def __init__(self) -> None:
        self._kept: deque[Notice] = deque(maxlen=_KEPT)
        self._newest: deque[Notice] = deque(maxlen=_SHOWN)
        self._count = 0
        self._lock = threading.Lock()

    def tell(self, level: Level, text: str) -> None:
        """Adds one."""
        with self._lock:
            self._count += 1
            notice = Notice(self._count, level, text, time.monotonic())
            self._kept.append(notice)
            self._newest.append(notice)

    @property
    def count(self) -> int:
        """How many have been added."""
        return self._count

    @property
    def shown(self) -> tuple[Notice, ...]:
        """The last few, for an update."""
        with self._lock:
            return tuple(self._newest)

    @property
    def kept(self) -> tuple[Notice, ...]:
        """All that are kept."""
        with self._lock:
            return tuple(self._kept)
