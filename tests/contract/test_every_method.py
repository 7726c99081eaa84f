"""Every method of the registry keeps the contract, on every kind of layout; and a broken one is told."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from every_method import EVERY, model_of
from poseloom.library import build_library
from poseloom.live.virtual import virtual_recording
from poseloom.methods import Frame, Health, InverseKinematics, choose, needs_library
from poseloom.sensors import Recording, layout
from poseloom.skeleton import Pose
from poseloom.testing import check_method


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("contract")
    build_library(["samples"], path / "library", mirror=False, workers=1, exclude=("walk",))
    return path


def recorded(worn: str) -> Recording:
    return virtual_recording("sample:walk", layout(worn), seed=4, endless=False).cut(10, 80)


@pytest.mark.parametrize(("name", "worn"), EVERY)
def test_every_method_keeps_the_contract(name: str, worn: str, folder: Path) -> None:
    given: dict[str, Any] = {"library": folder / "library"} if needs_library(name) else {}
    method = choose(layout(worn), name, model=model_of(name, worn, folder), **given).method
    check_method(method, recorded(worn))


class Remembering(InverseKinematics):
    """Keeps the samples heard in the object, where nothing may change."""

    heard = 0

    def step(self, state: Any, sample: Any) -> Any:
        self.heard += 1
        following, frame = super().step(state, sample)
        return following, replace(frame, spread=frame.spread + 1e-9 * self.heard)


def _changes(change: Callable[[Any, Any, Frame], Frame | None]) -> Callable[[], InverseKinematics]:
    """Inverse kinematics whose steps do something else besides."""

    class Changed(InverseKinematics):
        def step(self, state: Any, sample: Any) -> Any:
            following, frame = super().step(state, sample)
            return following, change(state, sample, frame)

    return lambda: Changed(layout("six-trackers"))


def _spoil_sample(state: Any, sample: Any, frame: Frame) -> Frame:
    object.__setattr__(sample, "arrival", sample.arrival + 1.0)
    return frame


def _spoil_state(state: Any, sample: Any, frame: Frame) -> Frame:
    object.__setattr__(state, "extra", 1)
    return frame


def _spoil_pose(state: Any, sample: Any, frame: Frame) -> Frame:
    return replace(frame, pose=Pose(frame.pose.skeleton, frame.pose.q * np.nan))


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        (lambda: Remembering(layout("six-trackers")), "another spread"),
        (_changes(_spoil_sample), "changed the sample"),
        (_changes(_spoil_state), "changed the state"),
        (_changes(lambda state, sample, frame: None), "no frame at sample 0"),
        (_changes(lambda state, sample, frame: replace(frame, time=frame.time + 1)), "the time"),
        (_changes(lambda state, sample, frame: replace(frame, spread=-frame.spread)), "spread is negative"),
        (_changes(lambda state, sample, frame: replace(frame, spread=frame.spread[:5])), "shape"),
        (_changes(lambda state, sample, frame: replace(frame, health=Health())), "health is ok"),
        (_changes(lambda state, sample, frame: replace(frame, health=Health(sensors=("ear",)))), "names ear"),
        (_changes(_spoil_pose), "not finite"),
        (lambda: InverseKinematics(layout("three-trackers")), "listens to"),
    ],
)
def test_a_broken_method_is_told(broken: Callable[[], InverseKinematics], words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_method(broken(), recorded("six-trackers"))
