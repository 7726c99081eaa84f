"""What the commands that measure share: recordings, the commit, and rows as a table."""

import os
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from poseloom.errors import PoseloomError

if TYPE_CHECKING:
    from rich.table import Table

    from poseloom.evaluation.rows import Row

DATA_VARIABLE = "POSELOOM_DATA"
"""The environment variable that names the folder of the recordings."""


def recordings_of(data: Path | None) -> Path:
    """The folder of the recordings. Raises PoseloomError where none was given or there is none."""
    if data is None or not data.is_dir():
        raise PoseloomError(
            "no folder of recordings was given" if data is None else "no such folder",
            remedy=f"Give --data (or {DATA_VARIABLE}) the folder that holds mocap/",
            file=data,
        )
    return data


def running_commit() -> str:
    """The commit that the program runs from, if it runs from one."""
    try:
        answer = subprocess.run(
            ["git", "describe", "--always", "--dirty"],
            capture_output=True, text=True, encoding="utf-8", check=False, cwd=Path(os.path.realpath(__file__)).parent,
        )  # fmt: skip
    except OSError:  # no git
        return "unknown"
    return answer.stdout.strip() if answer.returncode == 0 else "unknown"


def rows_table(title: str, rows: "Iterable[Row]", shown: Callable[[str], bool]) -> "Table":
    """Rows for the terminal.

    Args:
        title: Above the table.
        rows: Of one table.
        shown: Whether a metric is shown.
    """
    from rich import box
    from rich.table import Table

    table = Table("method", "on", "split", "metric", title=title, box=box.SIMPLE_HEAD, title_justify="left")
    for column in ("value", "± over sequences", "sequences", "frames"):
        table.add_column(column, justify="right")
    for row in rows:
        if shown(row.metric):
            spread = "" if row.spread is None else f"{row.spread:.2f}"
            table.add_row(
                row.method, row.setting, row.split, row.metric, f"{row.value:.2f}", spread, str(row.sequences),
                f"{row.frames:,}",
            )  # fmt: skip
    return table
