"""Where the root goes without positions: standing soles stay where they are, flights go as the network estimates."""

from dataclasses import dataclass

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.skeleton.contacts import sole_points
from poseloom.skeleton.skeleton import Skeleton


@dataclass(frozen=True)
class RootSettings:
    """How the root is carried.

    Attributes:
        sharpness: Power of a sole's contact probability that weighs its speed.
        fade_from: Greatest contact probability up to which the learnt velocity alone counts ...
        fade_to: ... and from which on the soles alone do.
        smooth_s: Time constant in which the root's speed follows, seconds: soles take over from each other in jerks.
        floor_s: Time constant in which the lowest standing sole is drawn to the floor, seconds.
        place_share: Standard deviation of the root's place as a share of the path.
        height: Standard deviation of the root's height, metres.
        place: Standard deviation of the root's place to begin with.
    """

    sharpness: float = 3.0
    fade_from: float = 0.3
    fade_to: float = 0.7
    smooth_s: float = 0.05
    floor_s: float = 0.25
    place_share: float = 0.1
    height: float = 0.05
    place: float = 0.01


@dataclass(frozen=True, eq=False)
class RootState:
    """What must be remembered.

    Attributes:
        place: The root's, metres.
        soles: Left heel, left toe, right heel, right toe relative to the root, world axes.
        velocity: The root's, smoothed, m/s.
        walked: Metres on the level so far.
    """

    place: Floats[Array, "3"]
    soles: Floats[Array, "4 3"]
    velocity: Floats[Array, "3"]
    walked: float = 0.0


class RootCarrier:
    """Carries a wearer's root.

    Args:
        skeleton: The wearer's.
        settings: How.
    """

    def __init__(self, skeleton: Skeleton, settings: RootSettings = RootSettings()) -> None:
        self.settings = settings
        points = [sole_points(skeleton, side) for side in ("left", "right")]
        self._bones = np.array([skeleton.index(f"{side}{b}") for side in ("left", "right") for b in ("Foot", "Toes")])
        self._locals = np.stack([point for foot in points for point in (foot.heel, foot.toe)])

    def soles(
        self, positions: Floats[Array, "joints 3"], rotations: Floats[Array, "joints 3 3"]
    ) -> Floats[Array, "4 3"]:
        """The soles' points relative to the root."""
        places = positions[self._bones] + (rotations[self._bones] @ self._locals[:, :, None])[:, :, 0]
        return places - positions[0]

    def start(self, soles: Floats[Array, "4 3"]) -> RootState:
        """The root over the world's origin, the lowest sole on the floor."""
        return RootState(np.array([0.0, -soles[:, 1].min(), 0.0]), soles, np.zeros(3))

    def step(
        self,
        state: RootState,
        soles: Floats[Array, "4 3"],
        contacts: Floats[Array, "4"],
        velocity: Floats[Array, "3"],
        seconds: float,
    ) -> RootState:
        """The root after a step.

        Args:
            state: Before it.
            soles: The soles' points now, relative to the root.
            contacts: Probability of each that it stands.
            velocity: The learnt velocity of the root, world, m/s.
            seconds: Since the last step.
        """
        how = self.settings
        weights = contacts**how.sharpness
        held = -(weights @ (soles - state.soles)) / max(float(weights.sum()), 1e-9)
        share = np.clip((float(contacts.max()) - how.fade_from) / (how.fade_to - how.fade_from), 0.0, 1.0)
        share = share * share * (3 - 2 * share)
        told = share * held / seconds + (1 - share) * velocity
        smooth = state.velocity + (1 - np.exp(-seconds / how.smooth_s)) * (told - state.velocity)
        moved = smooth * seconds
        place = state.place + moved
        place[1] -= share * (1 - np.exp(-seconds / how.floor_s)) * (place[1] + float(soles[:, 1].min()))
        return RootState(place, soles, smooth, state.walked + float(np.hypot(moved[0], moved[2])))

    def sigma(self, state: RootState) -> Floats[Array, "3"]:
        """Standard deviation of the root's place."""
        level = self.settings.place + self.settings.place_share * state.walked
        return np.array([level, self.settings.height, level])
