"""The viewer's colours."""

from poseloom.arrays import Array, Floats

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

TRUTH: Colour = (138, 143, 156)
METHODS: tuple[Colour, ...] = ((0, 114, 178), (213, 94, 0), (107, 91, 149))
"""Distinct for the colour-blind too, and the same as in the reports."""

GUIDE: Colour = (0, 158, 115)
UNSURE: Colour = (230, 159, 0)
LOST: Colour = (204, 61, 61)
_PALE: Colour = (232, 232, 226)
SILENT: Colour = (150, 150, 155)
STANDING: Colour = (0, 158, 115)
WELL: Colour = (245, 246, 248)

SURE_DEG, UNSURE_DEG = 4.0, 30.0
"""Spread, in degrees, up to which a bone has its own colour, and from which on it has the colour of doubt."""

LEVELS = 6
"""Steps of the colours of doubt: a bone is painted anew only when it enters another, for that costs a message."""


def mixed(colour: Colour, other: Colour, share: float) -> Colour:
    """A colour on the way from one to another."""
    r, g, b = (round(a + (o - a) * share) for a, o in zip(colour, other, strict=True))
    return r, g, b


def doubtful(colour: Colour, level: int) -> Colour:
    """A figure's colour at a step of doubt: it pales, and then turns yellow.

    On the straight way there it would turn into colours that mean something else.
    """
    share = 2.0 * level / LEVELS
    return mixed(colour, _PALE, share) if share <= 1.0 else mixed(_PALE, UNSURE, share - 1.0)


def hexadecimal(colour: Colour) -> str:
    """The colour as web pages write it."""
    return "#" + "".join(f"{channel:02x}" for channel in colour)


def doubt_levels(degrees: Floats[Array, "joints"]) -> list[int]:
    """For each joint's spread the step of doubt, from 0 to `LEVELS`."""
    shares = ((degrees - SURE_DEG) / (UNSURE_DEG - SURE_DEG)).clip(0.0, 1.0)
    return [round(float(share) * LEVELS) for share in shares]
