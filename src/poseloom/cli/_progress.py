"""Progress bars, on stderr."""

from collections.abc import Callable, Generator
from contextlib import contextmanager

ShowProgress = Callable[[str, int, int], None]
"""Called with the name of what is being done, and how many of how many are."""


@contextmanager
def progress_bars() -> Generator[ShowProgress, None, None]:
    """A bar for each name that the yielded function is called with. Without a terminal, one line each at the end."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<40}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        tasks: dict[str, TaskID] = {}

        def show(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = progress.add_task(what)
            progress.update(tasks[what], completed=done, total=total)

        yield show
