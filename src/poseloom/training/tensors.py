"""Two calls to torch that its stubs type only in part."""

from typing import Any

import torch
from numpy.typing import NDArray
from torch import Tensor


def tensor(array: NDArray[Any]) -> Tensor:
    """A tensor that shares an array's numbers."""
    return torch.from_numpy(array)  # pyright: ignore[reportUnknownMemberType]


def seed_torch(seed: int) -> None:
    """Seeds what torch draws: first weights and dropped units."""
    torch.manual_seed(seed)  # pyright: ignore[reportUnknownMemberType]
