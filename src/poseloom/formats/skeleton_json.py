"""A skeleton as plain JSON, for the headers of files. Floats keep every bit."""

from typing import Any

import numpy as np

from poseloom.skeleton.skeleton import Skeleton, make_skeleton


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
        SkeletonError: for an impossible hierarchy.
        KeyError, TypeError, ValueError: where the content has another form.
    """
    return make_skeleton(content["names"], content["parents"], content["offsets"], content["tips"], content["locked"])
