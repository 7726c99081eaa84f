"""Read-only arrays for frozen dataclasses."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array itself if it cannot be written to, else a contiguous read-only copy."""
    if not array.flags.writeable and array.flags.c_contiguous:
        return array
    copy = np.array(array, order="C")
    copy.flags.writeable = False
    return copy


def frozen_float(values: ArrayLike) -> NDArray[np.float64]:
    """A contiguous read-only array of doubles."""
    return frozen(np.asarray(values, dtype=np.float64))
