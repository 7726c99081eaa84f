"""Array types with shapes, and the one door to the compiler."""

from poseloom.arrays._compiled import compiled
from poseloom.arrays._frozen import frozen, frozen_float
from poseloom.arrays._room import exceeds_room
from poseloom.arrays._types import Array, Bools, Floats, Floats32, Ints

__all__ = ["Array", "Bools", "Floats", "Floats32", "Ints", "compiled", "exceeds_room", "frozen", "frozen_float"]
