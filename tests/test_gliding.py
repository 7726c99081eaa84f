"""What is shown while an estimate finds itself anew: no jump, a bounded way, and nothing without trouble."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from poseloom.arrays import frozen
from poseloom.library import MotionLibrary, build_library, open_library
from poseloom.methods import HealthState, make_method, reconstruct
from poseloom.methods.gliding import GlideSettings, glide_to
from poseloom.samples import sample_motions
from poseloom.sensors import Recording, layout
from poseloom.skeleton import average_body, make_motion, motion_frames
from poseloom.synthesis import Fault, simulate_trackers

RATE = 60.0
BODY = average_body()
SETTINGS = GlideSettings()


def glided(poses: np.ndarray, back_at: int | None):
    """What is shown of estimates, and whether each was added to."""
    glide, shown, added = None, [], []
    for index, q in enumerate(poses):
        glide, pose = glide_to(glide, BODY, q, index / RATE, index == back_at, SETTINGS)
        shown.append(pose)
        added.append(glide.offset is not None)
    return np.stack(shown), np.array(added)


def steps(poses: np.ndarray) -> np.ndarray:
    """Longest way of a joint between each two poses, metres."""
    places = motion_frames(make_motion(BODY, poses, RATE)).positions
    return np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1)


def standing(frames: int) -> np.ndarray:
    return np.tile(np.r_[0.0, 1.0, 0.0, np.zeros(BODY.size - 3)], (frames, 1))


@settings(deadline=None, max_examples=40)
@given(
    place=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    heading=st.floats(-np.pi, np.pi),
    bends=st.lists(st.floats(-1.5, 1.5), min_size=8, max_size=8),
)
def test_a_leap_becomes_a_glide_of_bounded_speed(place, heading, bends) -> None:
    poses = standing(300)
    poses[10:, :3] += place
    poses[10:, 4] += heading
    poses[10:, 9 : 9 + 24 : 3] += bends
    shown, added = glided(poses, back_at=10)
    np.testing.assert_array_equal(shown[:10], poses[:10])
    # Before the speed limit gives way to the longest time.
    assert steps(shown).max() <= 1.1 * max(SETTINGS.speed / RATE, SETTINGS.leap)
    np.testing.assert_array_equal(shown[-1], poses[-1])
    if steps(poses)[9] > 1.01 * SETTINGS.leap:
        assert added[10]
        assert added.sum() >= int(SETTINGS.shortest * RATE) - 1


def test_what_is_shown_goes_on_as_it_went() -> None:
    poses = standing(120)
    poses[:, 2] = np.arange(120) * 0.02
    poses[30:, 0] += 1.0
    shown, _ = glided(poses, back_at=30)
    np.testing.assert_allclose(np.diff(shown[28:32, 2]), 0.02, atol=1e-6)
    # No step of the speed either: each changes by less than a fifth of what the glide's own is at most.
    assert np.abs(np.diff(shown[:, 0], 2)).max() < 0.2 * SETTINGS.speed / RATE
    np.testing.assert_array_equal(shown[-30:], poses[-30:])


def test_the_longest_time_is_kept_however_far_the_figure_was_left() -> None:
    poses = standing(600)
    poses[10:, 0] += 50.0
    _, added = glided(poses, back_at=10)
    assert added.sum() == pytest.approx(SETTINGS.longest * RATE, abs=1)


@pytest.mark.parametrize("back_at", [None, 40])
def test_without_trouble_or_without_a_leap_nothing_is_changed(back_at) -> None:
    poses = standing(100)
    poses[:, 0] = np.linspace(0.0, 3.0, 100)
    if back_at is None:
        poses[50:, 0] += 2.0
    shown, added = glided(poses, back_at)
    np.testing.assert_array_equal(shown, poses)
    assert not added.any()


def test_a_second_leap_is_taken_up_in_the_glide() -> None:
    poses = standing(300)
    poses[10:, 0] += 1.0
    poses[16:, 0] -= 0.7
    shown, _ = glided(poses, back_at=10)
    assert steps(shown).max() <= 1.1 * SETTINGS.speed / RATE
    np.testing.assert_array_equal(shown[-1], poses[-1])


# The methods


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    folder = tmp_path_factory.mktemp("library") / "samples"
    build_library(["samples"], folder, rate=RATE, mirror=False, workers=1, exclude=("walk",))
    return open_library(folder)


WORN = replace(layout("six-trackers"), rate=RATE)


def walk(silence: tuple[float, float] | None = None) -> Recording:
    motion = sample_motions()["walk"].cut(0, 290)
    faults = () if silence is None else tuple(Fault(name, *silence) for name in WORN.names)
    return simulate_trackers(motion, WORN, faults=faults, seed=3)


@pytest.mark.parametrize("name", ["local-filter", "inverse-kinematics"])
def test_after_a_silence_of_all_sensors_the_figure_glides_to_them(name: str, library: MotionLibrary) -> None:
    recording = walk((1.0, 2.5))
    result = reconstruct(make_method(name, WORN, library), recording)
    estimate, truth = motion_frames(result.motion).positions, motion_frames(recording.truth).positions
    speeds = [np.linalg.norm(np.diff(places, axis=0), axis=2) for places in (estimate, truth)]
    gap = np.linalg.norm(estimate - truth, axis=2).mean(axis=1)
    back = 150
    assert gap[back - 1] > 0.5  # there is something to glide over
    # No joint goes much faster than the wearer's own, and none changes its speed much from frame to frame.
    assert (speeds[0] - speeds[1])[back - 2 :].max() < 0.1
    assert np.linalg.norm(np.diff(estimate, 2, axis=0), axis=2)[back - 3 :].max() < 0.1
    assert gap[-10:].max() < 1.5 * gap[30:60].max()
    states = [health.state for health in result.health]
    assert states[back] is HealthState.REJOINING
    assert states[-1] in (HealthState.OK, HealthState.DEGRADED)
    # The spread says how far off what is shown is known to be.
    assert result.spread[back, :3].max() > 0.3
    assert result.spread[-1, :3].max() < 0.1


def test_a_glide_is_in_the_state(library: MotionLibrary) -> None:
    recording, method = walk((1.0, 2.0)), make_method("local-filter", WORN, library)
    whole = reconstruct(method, recording).motion.q
    state, kept, poses = method.start(recording.skeleton, recording.placements), None, []
    for index in range(len(recording)):
        if index == 130:
            kept = state
        state, _ = method.step(state, recording.sample(index))
    for index in range(130, len(recording)):
        kept, frame = method.step(kept, recording.sample(index))
        poses.append(frame.pose.q)
    np.testing.assert_array_equal(np.stack(poses), whole[130:])


def test_sound_sensors_are_followed_as_if_nothing_could_glide(library: MotionLibrary) -> None:
    from poseloom.methods.trackers.state import TrackerSettings

    never = TrackerSettings(glide=GlideSettings(leap=np.inf))
    plain, other = make_method("local-filter", WORN, library), make_method("local-filter", WORN, library)
    other.settings = never
    recording = walk()
    late = np.arange(290)[:, None, None] == 90
    holed = replace(recording, positions=frozen(np.where(late, np.nan, recording.positions)))
    for each in (recording, holed):
        np.testing.assert_array_equal(reconstruct(plain, each).motion.q, reconstruct(other, each).motion.q)
