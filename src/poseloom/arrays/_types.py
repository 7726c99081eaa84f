"""Short names for jaxtyping's annotations: `Floats[Array, "frames joints 3"]` is an array of doubles of that shape."""

import numpy as np
from jaxtyping import Bool as Bools
from jaxtyping import Float32 as Floats32
from jaxtyping import Float64 as Floats
from jaxtyping import Int64 as Ints

Array = np.ndarray

__all__ = ["Array", "Bools", "Floats", "Floats32", "Ints"]
