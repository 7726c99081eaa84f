"""One offline HTML file: truth beside estimates as a moving figure, and every error of theirs."""

import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

from poseloom.errors import PoseloomError
from poseloom.evaluation.results import SequenceResult
from poseloom.formats.atomic import atomic_file
from poseloom.report.charts import chart_script
from poseloom.report.page_data import page_data


def write_report(
    path: str | Path,
    sequences: Sequence[SequenceResult],
    title: str,
    notes: Sequence[str] = (),
    facts: Mapping[str, str] | None = None,
) -> None:
    """Writes the report, whole or not at all. It needs nothing but a browser, and no network.

    Args:
        path: The HTML file.
        sequences: What was measured; those beyond the page's size (`page_data.BUDGET`) stand in its tables only.
        title: The page's heading.
        notes: Paragraphs on how it was made.
        facts: What the heading says beside the title: data, split, seed, sensors ...; the version is added.

    Raises:
        PoseloomError: where there is no sequence or no method.
        OSError: where the file cannot be written.
    """
    if not any(sequence.results for sequence in sequences):
        raise PoseloomError("a report needs at least one sequence with one method", remedy="Evaluate something first")
    text = _page(sequences, title, notes, dict(facts or {}))
    with atomic_file(path) as part:
        part.write_text(text, encoding="utf-8")


def _page(sequences: Sequence[SequenceResult], title: str, notes: Sequence[str], facts: dict[str, str]) -> str:
    running = version("poseloom")
    data = json.dumps(page_data(sequences), separators=(",", ":"), allow_nan=False)
    paragraphs = "".join(f"<p>{html.escape(note)}</p>" for note in notes)
    parts = {
        "title": html.escape(title),
        "facts": "".join(
            f"<div><dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd></div>"
            for name, value in (facts | {"poseloom": running}).items()
        ),
        "notes": f"<h2>How this was made</h2>{paragraphs}" if notes else "",
        "version": running,
        # "</script>" within the data would end it.
        "data": data.replace("<", "\\u003c"),
        "css": _asset("page.css"),
        "figure": _asset("figure.js"),
        "page": _asset("page.js"),
        "plotly": chart_script(),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], _asset("page.html"))


def _asset(name: str) -> str:
    return files("poseloom.report").joinpath("page", name).read_text(encoding="utf-8")
