"""Looking at a calibration session before anything is solved: units, axes, silent, stuck and exchanged sensors."""

from collections.abc import Mapping, Sequence

import numpy as np

from poseloom.arrays import Array, Floats, Ints
from poseloom.calibration.calibration import Level, Verdict
from poseloom.calibration.holds import all_orders, match_in_order, pose_costs
from poseloom.calibration.poses import GuidedPose
from poseloom.rotations import aligning_matrix
from poseloom.sensors import Recording, default_placements, place_sensors
from poseloom.sensors.layout import SensorLayout
from poseloom.skeleton.body import MIRROR, average_body
from poseloom.skeleton.kinematics import forward_kinematics

_UNITS = (("millimetres", 1000.0), ("centimetres", 100.0), ("inches", 39.37), ("feet", 3.281))
_LARGEST_RATIO = 1.6
"""By how much a person may be larger or smaller than the average body, arms and legs in any pose."""

_CLEARLY_BETTER = 0.8
"""Share of the cost below which another order of the sensors is believed."""

_CLEARLY_UP = 0.6
"""Share of the cost below which another axis is believed to be the vertical."""

_MOST_SENSORS = 6
"""Sensors above which not every order is tried, but every exchange of two."""

_UPS: Mapping[str, tuple[float, float, float]] = {
    "+Y": (0.0, 1.0, 0.0),
    "-Y": (0.0, -1.0, 0.0),
    "+Z": (0.0, 0.0, 1.0),
    "-Z": (0.0, 0.0, -1.0),
    "+X": (1.0, 0.0, 0.0),
    "-X": (-1.0, 0.0, 0.0),
}


def expected_positions(layout: SensorLayout, poses: Sequence[GuidedPose]) -> Floats[Array, "poses sensors 3"]:
    """Where the sensors are when the average body holds poses, metres."""
    body = average_body()
    worn = default_placements(layout, body)
    return np.stack([place_sensors(forward_kinematics(body, pose.q), body, worn).positions for pose in poses])


def unit_verdict(recording: Recording, expected: Floats[Array, "poses sensors 3"]) -> Verdict | None:
    """Whether positions are in another unit than metres, by how far apart the sensors are."""
    with np.errstate(all="ignore"):
        middle = np.nanmean(recording.positions, axis=1, keepdims=True)
        sizes = np.sqrt(np.nanmean(((recording.positions - middle) ** 2).sum(axis=-1), axis=1))
    size = float(np.nanmedian(sizes)) if np.isfinite(sizes).any() else np.nan
    usual = float(np.sqrt(((expected - expected.mean(axis=1, keepdims=True)) ** 2).sum(axis=-1).mean()))
    ratio = size / usual
    if not np.isfinite(ratio) or 1 / _LARGEST_RATIO < ratio < _LARGEST_RATIO:
        return None
    near = [name for name, factor in _UNITS if 1 / _LARGEST_RATIO < ratio / factor < _LARGEST_RATIO]
    return Verdict(
        Level.UNUSABLE,
        "unit",
        f"the trackers are {ratio:.3g} times as far apart as on a person",
        f"positions seem to be in {near[0]}, not in metres" if near else "positions are not in metres",
        "Convert positions to metres when recording",
    )


def axis_verdict(
    measured: Floats[Array, "windows sensors 3"], expected: Floats[Array, "poses sensors 3"]
) -> Verdict | None:
    """Whether another axis than Y points up, by which of the six makes still moments look like poses.

    Exchanges of two sensors are allowed for, lest an exchanged head and ankle pass for a person upside down.
    """
    orders = _exchanges(measured.shape[1])
    fits: dict[str, float] = {}
    for name, up in _UPS.items():
        R_up_world = aligning_matrix(np.array(up), np.array([0.0, 1.0, 0.0]))
        fits[name] = float(pose_costs(measured @ R_up_world.T, expected, orders).min(axis=2).mean(axis=1).min())
    best = min(fits, key=lambda name: fits[name])
    if best == "+Y" or fits[best] > _CLEARLY_UP * fits["+Y"]:
        return None
    return Verdict(
        Level.UNUSABLE,
        "axis",
        f"the person stands along {best}",
        "the coordinates' vertical is not +Y",
        "Turn coordinates so that Y points up (from Z up: x, y, z becomes x, z, -y) when recording",
    )


def silence_verdicts(
    layout: SensorLayout, positions: Floats[Array, "windows sensors 3"], stuck: Ints[Array, "sensors"]
) -> list[Verdict]:
    """Sensors that said nothing in half of the still moments or more."""
    verdicts: list[Verdict] = []
    silent = ~np.isfinite(positions[..., 0])
    for sensor, name in enumerate(layout.names):
        share = silent[:, sensor].mean() if len(silent) else 0.0
        if stuck[sensor] and share >= 0.5:
            fact, cause = f"tracker {name!r} is stuck", "it repeats one reading while the others move"
        elif share >= 0.5:
            fact, cause = f"tracker {name!r} is silent", f"it was not seen in {share:.0%} of the held poses"
        else:
            continue
        verdicts.append(
            Verdict(
                Level.WARNING,
                "stuck" if stuck[sensor] and share >= 0.5 else "silent",
                fact,
                cause,
                "Check its battery, its pairing and whether it can be seen, and calibrate anew: its place is a guess",
            )
        )
    return verdicts


def order_verdict(
    layout: SensorLayout,
    measured: Floats[Array, "windows sensors 3"],
    expected: Floats[Array, "poses sensors 3"],
    rounds: int,
) -> Verdict | None:
    """Whether sensors are exchanged, or all is mirrored, by trying that against the whole sequence of poses."""
    orders = _orders(len(layout))
    costs = pose_costs(measured, expected, orders)
    # Most orders are hopeless whatever the sequence; only the best are matched in order.
    promising = np.argsort(costs.min(axis=2).sum(axis=1))[:24]
    totals = {int(each): match_in_order(np.tile(costs[each], (1, rounds)))[1] for each in {0, *promising.tolist()}}
    best = min(totals, key=lambda each: totals[each])
    mirrored = match_in_order(np.tile(pose_costs(measured * MIRROR, expected)[0], (1, rounds)))[1]
    if mirrored < min(_CLEARLY_BETTER * totals[0], totals[best]):
        return Verdict(
            Level.UNUSABLE,
            "handedness",
            "the person moves as in a mirror",
            "the coordinates are left-handed",
            "Turn one axis round (from x, y, z to x, y, -z, and the turns with it) when recording",
        )
    if best == 0 or totals[best] > _CLEARLY_BETTER * totals[0]:
        return None
    moved = {layout.names[place]: layout.names[source] for place, source in enumerate(orders[best]) if place != source}
    names = list(moved)
    if len(names) == 2:
        fact = f"trackers {names[0]!r} and {names[1]!r} are exchanged"
    else:
        fact = "trackers are exchanged: " + ", ".join(f"{moved[name]!r} is worn as {name!r}" for name in names)
    cause = "they were strapped on, or named, the other way round"
    return Verdict(Level.UNUSABLE, "swapped", fact, cause, "Exchange them (or their names) and hold the poses again")


def _orders(sensors: int) -> list[tuple[int, ...]]:
    if sensors <= _MOST_SENSORS:
        return all_orders(sensors)
    return _exchanges(sensors)


def _exchanges(sensors: int) -> list[tuple[int, ...]]:
    """The order as it should be, then every exchange of two."""
    same = tuple(range(sensors))
    swaps = [same]
    for a in range(sensors):
        for b in range(a + 1, sensors):
            order = list(same)
            order[a], order[b] = b, a
            swaps.append(tuple(order))
    return swaps
