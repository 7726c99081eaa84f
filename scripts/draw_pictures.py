"""Draws the pictures of the documents into docs/images, from the built-in motions.

python scripts/draw_pictures.py
"""

import tempfile
from pathlib import Path

from poseloom.evaluation.cases import Conditions, read_cases
from poseloom.evaluation.experiment import evaluate_cases
from poseloom.evaluation.plan import Experiment
from poseloom.library import build_library
from poseloom.methods import DEFAULT_METHOD
from poseloom.report.strip import sequence_strip

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"


def main() -> None:
    """Reconstructs the built-in walk, left out of the library, and draws truth and estimate."""
    conditions = Conditions()
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "library"
        build_library(["samples"], library, mirror=True)
        cases = read_cases(["sample:walk"], conditions)
        evaluation = evaluate_cases(cases, Experiment((DEFAULT_METHOD,), library, conditions=conditions))
    (IMAGES / "walk.svg").write_text(sequence_strip(evaluation.sequences[0]), encoding="utf-8")


if __name__ == "__main__":
    main()
