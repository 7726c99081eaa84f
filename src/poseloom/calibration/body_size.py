"""How people's bodies differ in size: a mean body and principal components of its bone vectors."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from poseloom.arrays import Array, Floats, frozen_float
from poseloom.errors import SkeletonError
from poseloom.formats._files import read_bytes, reading
from poseloom.skeleton.body import BODY_BONES, MIRROR, average_body, mirror_bones
from poseloom.skeleton.skeleton import Skeleton

DEFAULT_COMPONENTS = 12
"""Components in use unless told otherwise. Five, as in the paper, cannot describe an unseen person to better than 2.6 %
of a bone, however good the measurement (docs/calibration.md)."""

OUTLIER_SIGMAS = 2.5
"""Robust standard deviations from the median at which a training body's bone vector is cut off."""

_SPREAD = 1.4826
"""Standard deviation of a normal distribution in units of its median absolute deviation."""


@dataclass(frozen=True, eq=False)
class BodySizeModel:
    """Sizes of the 22-bone body, alike on both sides: the mean's bone vectors plus components times coefficients.

    Coefficients have mean 0 and standard deviation 1 among people. Components are ordered by the variance they explain.

    Attributes:
        mean: Offset of each joint from its parent and tip of each bone, metres; a tip that a bone has not is 0.
        components: The same for each component, in metres per coefficient: its direction times its standard deviation.
        source: Where it was learnt from, for people.
    """

    mean: Floats[Array, "two joints 3"]
    components: Floats[Array, "components two joints 3"]
    source: str = ""

    @property
    def size(self) -> int:
        """Number of components."""
        return len(self.components)

    def cut(self, components: int) -> "BodySizeModel":
        """The model with its first components only.

        Raises:
            SkeletonError: if it has not so many.
        """
        if not 0 <= components <= self.size:
            raise SkeletonError(
                f"the body-size model has no {components} components", remedy=f"Ask for 0 to {self.size} components"
            )
        return replace(self, components=self.components[:components])

    def body_of(self, coefficients: Floats[Array, "components"]) -> Skeleton:
        """The body with these coefficients."""
        offsets, tips = self.mean + np.tensordot(coefficients, self.components, 1)
        body = average_body()
        return body.with_offsets(offsets, np.where(np.isfinite(body.tips), tips, np.nan))

    def coefficients_of(self, skeleton: Skeleton) -> Floats[Array, "components"]:
        """Coefficients of the body of the model that is nearest to a body, in least squares over all bone vectors.

        Raises:
            SkeletonError: if the skeleton is not the body.
        """
        apart = (size_vectors(skeleton) - self.mean).reshape(-1)
        basis = self.components.reshape(self.size, -1)
        return np.asarray(np.linalg.lstsq(basis.T, apart, rcond=None)[0])


def size_vectors(skeleton: Skeleton) -> Floats[Array, "two joints 3"]:
    """Offsets and tips of a body, both sides averaged; tips that bones have not are 0.

    Raises:
        SkeletonError: if the skeleton is not the body.
    """
    if skeleton.names != BODY_BONES:
        raise SkeletonError(
            f"a skeleton of {len(skeleton)} joints is not the body of {len(BODY_BONES)} bones",
            remedy="Retarget it to the body first",
        )
    vectors = np.stack([skeleton.offsets, np.nan_to_num(skeleton.tips)])
    return np.asarray(0.5 * (vectors + vectors[:, mirror_bones()] * MIRROR))


def fit_body_size(bodies: Sequence[Skeleton], components: int = DEFAULT_COMPONENTS, source: str = "") -> BodySizeModel:
    """Learns mean and principal components from people's bodies.

    Each number of a bone vector is first cut off at 2.5 robust standard deviations from its median (winsorised), so
    that a body with one mismeasured bone still serves for the others. Components are those of the vectors in metres,
    each bone once (not once a side).

    Args:
        bodies: On the body's 22 bones.
        components: How many to keep; fewer if there are not so many directions in which the bodies differ.
        source: Where they came from.

    Raises:
        SkeletonError: for fewer than three bodies, or one that is not the body.
    """
    if len(bodies) < 3:
        raise SkeletonError(f"{len(bodies)} bodies tell nothing of how people differ", remedy="Give three or more")
    vectors = np.stack([size_vectors(body) for body in bodies])
    middle = np.median(vectors, axis=0)
    spread = _SPREAD * np.median(np.abs(vectors - middle), axis=0)
    vectors = np.clip(vectors, middle - OUTLIER_SIGMAS * spread, middle + OUTLIER_SIGMAS * spread)
    mean = vectors.mean(axis=0)
    weights = np.sqrt(np.where(np.arange(len(BODY_BONES)) == mirror_bones(), 1.0, 0.5))[:, None]
    _, deviations, directions = np.linalg.svd(
        ((vectors - mean) * weights).reshape(len(bodies), -1), full_matrices=False
    )
    kept = min(components, int((deviations > 1e-9 * deviations[0]).sum()))
    scaled = deviations[:kept, None] / np.sqrt(len(bodies) - 1) * directions[:kept]
    return BodySizeModel(frozen_float(mean), frozen_float(scaled.reshape(kept, *mean.shape) / weights), source)


def body_size_to_json(model: BodySizeModel) -> str:
    """The model as text, one bone a line, rounded to a hundredth of a millimetre."""

    def table(vectors: Floats[Array, "two joints 3"]) -> dict[str, dict[str, list[float]]]:
        named = zip(("offsets", "tips"), np.round(vectors, 5) + 0.0, strict=True)
        return {
            what: {bone: row.tolist() for bone, row in zip(BODY_BONES, rows, strict=True) if row.any()}
            for what, rows in named
        }

    content = {
        "source": model.source,
        "unit": "metres; a component is given per standard deviation",
        "mean": table(model.mean),
        "components": [table(component) for component in model.components],
    }
    return json.dumps(content, indent=1) + "\n"


def body_size_from_json(text: str) -> BodySizeModel:
    """The inverse of `body_size_to_json`, to within its rounding.

    Raises:
        SkeletonError: where the text is no body-size model.
    """

    def vectors(table: dict[str, dict[str, list[float]]]) -> Floats[Array, "two joints 3"]:
        values = np.zeros((2, len(BODY_BONES), 3))
        for row, what in enumerate(("offsets", "tips")):
            for bone, vector in table[what].items():
                values[row, BODY_BONES.index(bone)] = vector
        return values

    try:
        content = json.loads(text)
        components = [vectors(table) for table in content["components"]]
        return BodySizeModel(
            frozen_float(vectors(content["mean"])),
            frozen_float(np.array(components).reshape(-1, 2, len(BODY_BONES), 3)),
            str(content["source"]),
        )
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise SkeletonError(
            "this is no body-size model",
            cause=f"{type(error).__name__}: {error}",
            remedy="Name a file that `poseloom fit body-size` has written",
        ) from None


def read_body_size(path: Path) -> BodySizeModel:
    """A model from a file that `poseloom fit body-size` has written.

    Raises:
        FormatError: where the file cannot be read.
        SkeletonError: where it holds no body-size model.
    """
    with reading(path, "a body-size model"):
        return body_size_from_json(read_bytes(path).decode("utf-8"))


@cache
def body_size_model() -> BodySizeModel:
    """The model that comes with poseloom, learnt from CMU's skeletons."""
    return body_size_from_json(files("poseloom.calibration").joinpath("body_size.json").read_text(encoding="utf-8"))
