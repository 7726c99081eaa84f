"""A skeleton as plain JSON, for the headers of files. Floats keep every bit."""

from typing import Any

import numpy as np

from poseloom.errors import SkeletonError
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

_LARGEST = 1e4
"""Metres; the sizes of what moves on them are limited by nothing else."""


def skeleton_to_json(skeleton: Skeleton) -> dict[str, Any]:
    """Names, parents, offsets (metres), the tips that are stated (metres) and locked axes, as JSON knows them."""
    return {
        "names": list(skeleton.names),
        "parents": skeleton.parents.tolist(),
        "offsets": skeleton.offsets.tolist(),
        "tips": {
            name: tip.tolist()
            for name, tip in zip(skeleton.names, skeleton.tips, strict=True)
            if np.isfinite(tip).all()
        },
        "locked": {
            name: axes.tolist() for name, axes in zip(skeleton.names, skeleton.locked, strict=True) if axes.any()
        },
    }


def skeleton_from_json(content: dict[str, Any]) -> Skeleton:
    """The inverse of `skeleton_to_json`.

    Raises:
        SkeletonError: for an impossible hierarchy, or bones that no body has.
        KeyError, TypeError, ValueError: where the content has another form.
    """
    names, parents = list(content["names"]), list(content["parents"])
    if not all(isinstance(name, str) for name in names) or not all(type(parent) is int for parent in parents):
        raise TypeError("names are not all text, or parents not all whole numbers")
    tips = {str(name): np.array(tip, dtype=np.float64) for name, tip in content["tips"].items()}
    sizes = [np.abs(np.array(content["offsets"], dtype=np.float64)), *(np.abs(tip) for tip in tips.values())]
    if not all(size.size == 0 or size.max() <= _LARGEST for size in sizes):  # a NaN is not either
        raise SkeletonError(f"bones are no numbers, or longer than {_LARGEST:g} m", remedy="Mend the skeleton")
    return make_skeleton(names, parents, content["offsets"], tips, content["locked"])
