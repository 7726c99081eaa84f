"""A pool of processes whose results come in the order of the questions."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TypeVar

from poseloom.errors import PoseloomError

Item = TypeVar("Item")
Result = TypeVar("Result")

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_AHEAD = 8
_MOST_WORKERS = 61
"""Windows waits for no more processes at once."""


def in_order(function: Callable[[Item], Result], items: Sequence[Item], workers: int) -> Iterator[Result]:
    """Results of a function over items, in their order, computed by processes of one thread each.

    At most 8 items a worker are under way or waiting to be taken, so results do not pile up. With one worker, or one
    item, everything happens in this process.

    Args:
        function: Importable by name, as are the items' types.
        items: Questions.
        workers: Number of processes.

    Raises:
        PoseloomError: if a process dies, and whatever the function raises.
    """
    if min(workers, len(items)) <= 1:
        yield from map(function, items)
        return
    workers = min(workers, len(items), _MOST_WORKERS)
    with _one_thread_each():
        pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_prepare)
        try:
            yield from _windowed(pool, function, items, _AHEAD * workers)
        except BrokenProcessPool:
            raise PoseloomError(
                "a process of the pool died",
                cause="the machine may have run out of memory, or this was called from a script whose top level is not "
                "guarded by: if __name__ == '__main__'",
                remedy="Close other programs, guard the script, or use one worker",
            ) from None
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _windowed(
    pool: ProcessPoolExecutor, function: Callable[[Item], Result], items: Sequence[Item], most: int
) -> Iterator[Result]:
    under_way: deque[Future[Result]] = deque()
    for item in items:
        if len(under_way) == most:
            yield under_way.popleft().result()
        under_way.append(pool.submit(function, item))
    while under_way:
        yield under_way.popleft().result()


@contextmanager
def _one_thread_each() -> Generator[None, None, None]:
    """Children read these variables when they load numpy, before any code of ours could tell them."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _prepare() -> None:
    """Leaves interrupts from the keyboard to the parent, and lets a worker end when its parent is killed.

    By itself a worker would wait for work for ever.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
