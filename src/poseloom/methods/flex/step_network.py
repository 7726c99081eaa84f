"""What every network of a flex method offers: one sample in, angles and what to remember out."""

from typing import Any, Protocol

from poseloom.arrays import Array, Floats

INPUTS = 8
"""Four values, and four flags that say whether they were measured."""

Memory = Any
"""What a network remembers between samples; opaque to the method, never changed in place."""


class StepNetwork(Protocol):
    """A network that takes one sample at a time."""

    def start(self) -> Memory:
        """The memory before the first sample."""
        ...

    def step(
        self, memory: Memory, values: Floats[Array, "channels"], measured: Floats[Array, "channels"], fresh: bool
    ) -> tuple[Memory, Floats[Array, "angles"], Floats[Array, "angles"]]:
        """One sample.

        Args:
            memory: What was remembered.
            values: Of each channel, as a share of its range; finite.
            measured: 1 where the value was measured, 0 where it is the last one carried on.
            fresh: Whether this is the first sample of all.

        Returns:
            The next memory, the angles in radians and their spread.
        """
        ...
