"""The one door to numba, so that its missing type information stays in one place."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba  # pyright: ignore[reportMissingTypeStubs]

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def compiled(function: Kernel) -> Kernel:
    """Compiles a numeric kernel to machine code on first use, releasing the interpreter lock, and caches it on disk.

    Kernels live in modules named `*_kernels`; they know numbers and arrays only. No fast-math: a missing value is NaN
    and must stay one.
    """
    return cast(Kernel, numba.njit(cache=True, nogil=True, error_model="numpy")(function))  # pyright: ignore
