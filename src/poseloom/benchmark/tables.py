"""Figures and tables of the pages that benchmarks write."""

from collections.abc import Iterable, Sequence

from poseloom.evaluation.rows import Row


def figure_of(row: Row, digits: int = 2) -> str:
    """A row's value, and its spread where it has one, for a cell."""
    spread = "" if row.spread is None else f" ± {row.spread:.{digits}f}"
    return f"{row.value:.{digits}f}{spread}"


def markdown_table(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    rule = ["---"] * len(heads)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, rule, *lines))
