"""How many values may be filled in between those that a file holds: a gap in its times must not ask for terabytes."""

_ROOM = 1 << 28
"""Bytes that values at even instants may always have: three hours of full-body motion at 40 Hz."""
_MOST_FILLED = 4
"""Times as many as were given they may be beyond that."""


def exceeds_room(instants: float, given: int, width: int) -> bool:
    """Whether values at even instants would take far more memory than those between which they are filled in.

    Args:
        instants: How many there would be; may be infinite or NaN, as it comes from times that a file states.
        given: How many rows there are now.
        width: Doubles a row.
    """
    return not 8.0 * width * instants <= max(_ROOM, 8.0 * width * _MOST_FILLED * given)
