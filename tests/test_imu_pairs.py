"""Training pairs of motion and IMU signal, and what clips are called."""

from pathlib import Path

import numpy as np
import pytest

from poseloom.errors import MethodError
from poseloom.library import MotionLibrary, build_library, open_library
from poseloom.methods.imus.behaviours import Behaviour, behaviour_of, behaviour_of_movement, movement_of
from poseloom.methods.imus.pairs import library_pairs, pair_of_recording, pairs_digest, recording_signal
from poseloom.samples import sample_motions
from poseloom.sensors import layout
from poseloom.skeleton import Motion, average_body, make_motion, retarget
from poseloom.synthesis import Fault, simulate_imus

FOOT = layout("right-foot-imu")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> MotionLibrary:
    folder = Path(tmp_path_factory.mktemp("pairs")) / "library"
    build_library(["samples"], folder, 60.0, mirror=True, workers=1)
    return open_library(folder)


def on_body(name: str) -> Motion:
    return retarget(sample_motions()[name], average_body())


def test_pairs_hold_motion_and_signal_frame_by_frame(library: MotionLibrary) -> None:
    pairs = library_pairs(library, FOOT, choose=lambda clip: "walk" in clip.name)
    assert pairs
    for pair in pairs:
        assert pair.motion.rate == FOOT.rate
        assert pair.signal.shape == (len(pair.motion), 6)
        assert np.isfinite(pair.signal).all()
        # Over whole cycles the specific force has gravity as its mean size, within what steps add.
        assert 8 < np.linalg.norm(pair.signal[:, :3], axis=1).mean() < 25


def test_a_pair_does_not_depend_on_the_others(library: MotionLibrary) -> None:
    everything = {pair.clip: pair for pair in library_pairs(library, FOOT)}
    few = library_pairs(library, FOOT, choose=lambda clip: "walk" in clip.name)
    for pair in few:
        np.testing.assert_array_equal(pair.signal, everything[pair.clip].signal)
    assert pairs_digest(few) == pairs_digest(library_pairs(library, FOOT, choose=lambda clip: "walk" in clip.name))
    assert pairs_digest(few) != pairs_digest(library_pairs(library, FOOT, seed=1, choose=lambda c: "walk" in c.name))


def test_takes_are_left_out_with_their_mirror_images(library: MotionLibrary) -> None:
    take = next(clip.take for clip in library.clips if "walk" in clip.name)
    pairs = library_pairs(library, FOOT, without_takes=[take])
    assert pairs
    assert take not in {pair.take for pair in pairs}
    assert all(not pair.clip.startswith(f"{take}~") for pair in pairs)


def test_other_sensors_are_refused(library: MotionLibrary) -> None:
    with pytest.raises(MethodError, match="no IMUs"):
        library_pairs(library, layout("flex-four+hips-imu"))


def test_gaps_are_bridged() -> None:
    motion = on_body("walk")
    broken = simulate_imus(motion, FOOT, faults=[Fault("rightFoot", 0.2, 0.3)])
    assert np.isnan(recording_signal(broken)).any()
    pair = pair_of_recording(broken)
    assert np.isfinite(pair.signal).all()
    heard = np.isfinite(recording_signal(broken)).all(axis=1)
    np.testing.assert_array_equal(pair.signal[heard], recording_signal(broken)[heard])


def test_names_tell_the_behaviour_and_movement_where_they_do_not() -> None:
    walk, run, jump = on_body("walk"), on_body("run"), on_body("jump")
    assert behaviour_of(("walk",), run) is Behaviour.WALKING
    assert behaviour_of((), walk) is Behaviour.WALKING
    assert behaviour_of((), run) is Behaviour.RUNNING
    assert behaviour_of((), jump) is Behaviour.JUMPING
    assert behaviour_of(("playground", "climb", "swing", "jump"), walk) is Behaviour.WALKING
    standing = make_motion(average_body(), np.repeat(walk.q[:1], 60, axis=0), 60.0)
    assert behaviour_of((), standing) is Behaviour.IDLE


def test_a_way_that_goes_to_the_side_is_side_stepping() -> None:
    ahead = movement_of(on_body("walk"))
    assert ahead.sideways < 0.3
    assert behaviour_of_movement(ahead._replace(sideways=0.9)) is Behaviour.SIDE_STEPPING
    assert behaviour_of_movement(ahead._replace(speed=0.0, turning=1.0)) is Behaviour.TURNING
    assert behaviour_of_movement(ahead._replace(speed=0.5, flight=0.3, one_legged=1.0)) is Behaviour.HOPPING
