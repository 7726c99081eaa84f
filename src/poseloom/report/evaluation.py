"""The report of an evaluation."""

from pathlib import Path

from poseloom.evaluation.experiment import Evaluation
from poseloom.evaluation.splits import Split
from poseloom.methods.choose import method_name
from poseloom.report.html import write_report

_LEFT_OUT = {
    Split.BY_SEQUENCE: "The whole take of each sequence is left out of the library: the clip itself, its mirror image "
    "and every copy or overlapping cut of it.",
    Split.BY_SUBJECT: "All clips of the people who move in a sequence are left out of the library, and every copy of "
    "its take.",
    Split.NONE: "Nothing is left out of the library: where it holds a sequence, the figures say how well it remembers.",
}


def write_evaluation_report(
    path: str | Path, evaluation: Evaluation, title: str = "", notes: tuple[str, ...] = ()
) -> None:
    """Writes an evaluation's report as one offline HTML file (see `write_report`).

    Args:
        path: The HTML file.
        evaluation: What was measured.
        title: Heading; made of the sequences' and methods' names if empty.
        notes: Further paragraphs on how it was made.
    """
    sequences = evaluation.sequences
    what = sequences[0].name if len(sequences) == 1 else f"{len(sequences)} sequences"
    made = ["No truth enters a method: each is given the sensors' samples, the wearer's bones and the sensors' places."]
    if evaluation.library_poses:
        made.append(_LEFT_OUT[evaluation.experiment.split])
    made.append(f"Data digest {evaluation.data_digest[:16]}. The metrics are defined in poseloom's docs/metrics.md.")
    heading = title or f"{what}: {', '.join(map(method_name, evaluation.experiment.methods))}"
    write_report(path, sequences, heading, [*notes, *made], evaluation.facts())
