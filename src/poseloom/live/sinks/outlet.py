"""A sink with its thread and its bounded queue, so that a slow or failing one costs nobody else anything."""

import threading
import time
from collections import deque
from collections.abc import Callable

from poseloom.errors import PoseloomError
from poseloom.live.contract import Level, Post, SessionFacts, Sink, Update

Tell = Callable[[Level, str], None]
"""Called with what a person should know, from any thread."""

_LONGEST_CLOSE = 30.0
"""Seconds that a sink may take to end, but for one that makes a file: that is waited for."""

_LOOK_EVERY = 0.2
"""Seconds between looks at a sink that is ending."""


class Outlet:
    """Hands updates to one sink.

    Args:
        sink: The sink.
        post: Where its commands go.
        tell: Where its failures are told.

    Attributes:
        unseen: Updates that it did not get.
        alive: Whether it gets updates.
        failure: Why it has failed; empty while it has not.
    """

    def __init__(self, sink: Sink, post: Post, tell: Tell) -> None:
        self.sink = sink
        self.unseen = 0
        self.alive = False
        self.failure = ""
        self._post, self._tell = post, tell
        self._waiting: deque[Update | SessionFacts | None] = deque()
        self._updates = 0
        self._change = threading.Condition()
        self._thread: threading.Thread | None = None

    def open(self, facts: SessionFacts) -> None:
        """Opens the sink; one without a queue at once, another on its own thread.

        Raises:
            PoseloomError, OSError: from the sink's `open`, for one without a queue.
        """
        self.alive = True
        if self.sink.capacity == 0:
            self.sink.open(facts, self._post)
            return
        opened = threading.Event()
        failure: list[Exception] = []
        self._thread = threading.Thread(
            target=self._run, args=(facts, opened, failure), name=f"sink {self.sink.name}", daemon=True
        )
        self._thread.start()
        opened.wait()
        if failure:
            self.alive = False
            raise failure[0]

    def changed(self, facts: SessionFacts) -> None:
        """Passes on that the facts have changed, in its place among the updates; never dropped."""
        if self.sink.capacity == 0:
            self._guarded(lambda: self.sink.changed(facts))
            return
        with self._change:
            self._waiting.append(facts)
            self._change.notify()

    def show(self, update: Update) -> None:
        """Passes on an update; if too many wait, the oldest of them is dropped and counted."""
        if not self.alive:
            return
        if self.sink.capacity == 0:
            self._guarded(lambda: self.sink.show(update))
            return
        with self._change:
            if self._updates >= self.sink.capacity:
                oldest = next(i for i, each in enumerate(self._waiting) if isinstance(each, Update))
                del self._waiting[oldest]
                self._updates -= 1
                self.unseen += 1
            self._waiting.append(update)
            self._updates += 1
            self._change.notify()

    @property
    def keeps(self) -> bool:
        """Whether the sink makes a file, so that its failure is a loss."""
        return bool(getattr(self.sink, "keeps", False))

    @property
    def waiting(self) -> int:
        """Updates that it has still to take."""
        return self._updates

    def discard(self) -> None:
        """Lets a sink that makes a file leave none when it is closed."""
        discard: Callable[[], None] | None = getattr(self.sink, "discard", None)
        if discard is not None:
            discard()

    def close(self, waited: Callable[[], None] | None = None) -> None:
        """Lets the sink take what waits, and closes it.

        Args:
            waited: Called a few times a second while that takes long.
        """
        if self._thread is None:
            if self.alive:
                self.alive = False
                self._guarded(self.sink.close)
            return
        with self._change:
            self._waiting.append(None)
            self._change.notify()
        end = time.monotonic() + _LONGEST_CLOSE
        while self._thread.is_alive() and (self.keeps or time.monotonic() < end):
            self._thread.join(_LOOK_EVERY)
            if waited is not None:
                waited()
        if self._thread.is_alive():
            self._tell(Level.WARNING, f"{self.sink.name} does not end; it is left")

    def _run(self, facts: SessionFacts, opened: threading.Event, failure: list[Exception]) -> None:
        try:
            self.sink.open(facts, self._post)
        except Exception as error:
            failure.append(error)
            return
        finally:
            opened.set()
        try:
            while (item := self._next()) is not None:
                if isinstance(item, Update):
                    self._guarded(lambda update=item: self.sink.show(update))
                else:
                    self._guarded(lambda facts=item: self.sink.changed(facts))
                if not self.alive:
                    break
        finally:
            self.alive = False
            self._guarded(self.sink.close)

    def _next(self) -> Update | SessionFacts | None:
        with self._change:
            while not self._waiting:
                self._change.wait()
            item = self._waiting.popleft()
            self._updates -= isinstance(item, Update)
            return item

    def _guarded(self, call: Callable[[], None]) -> None:
        """Any exception ends this sink and no other: here ends what its author could foresee."""
        try:
            call()
        except Exception as error:
            self.alive = False
            reason = str(error) if isinstance(error, PoseloomError) else f"{type(error).__name__}: {error}"
            if self.failure:
                return  # a sink that has failed may fail again when it is closed
            self.failure = reason
            failed = "HAS FAILED" if self.keeps else "has failed"
            self._tell(Level.ERROR, f"{self.sink.name} {failed} and gets no more poses: {reason}")
