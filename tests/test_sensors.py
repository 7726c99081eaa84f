"""Layouts, placements and the builder of recordings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poseloom.errors import SensorError
from poseloom.rotations import matrix_from_rotvec
from poseloom.sensors import (
    Recording,
    SensorKind,
    SensorSpec,
    SensorStatus,
    default_placements,
    layout,
    layout_names,
    make_layout,
    make_placement,
    make_recording,
    place_sensors,
)
from poseloom.sensors.summary import summarise
from poseloom.skeleton.body import BODY_BONES, MIRROR, average_body
from poseloom.skeleton.kinematics import forward_kinematics, motion_frames
from poseloom.skeleton.motion import make_motion
from poseloom.skeleton.skeleton import make_skeleton

specs = st.builds(
    SensorSpec, name=st.text(min_size=1), kind=st.sampled_from(SensorKind), bone=st.sampled_from(BODY_BONES)
)
parts_of_layouts = st.tuples(
    st.text(), st.lists(specs, min_size=1, max_size=12, unique_by=lambda spec: spec.name), st.floats(1e-3, 1e4)
)


def small_recording(samples: int = 5) -> Recording:
    six, body = layout("six-trackers"), average_body()
    shape = (samples, len(six))
    quats = np.zeros((*shape, 4))
    quats[..., 0] = 1.0
    truth = make_motion(body, np.arange(samples * body.size, dtype=np.float64).reshape(samples, -1), six.rate)
    return make_recording(
        six,
        default_placements(six, body),
        body,
        np.arange(samples) / six.rate,
        positions=np.arange(samples * len(six) * 3, dtype=np.float64).reshape(*shape, 3),
        quats_wxyz=quats,
        truth=truth,
    )


def with_columns(recording: Recording, **columns: object) -> Recording:
    parts = {"positions": recording.positions, "quats_wxyz": recording.quats_wxyz, "truth": recording.truth} | columns
    times = parts.pop("times", recording.times)
    skeleton = parts.pop("skeleton", recording.skeleton)
    return make_recording(recording.layout, recording.placements, skeleton, times, **parts)  # type: ignore[arg-type]


def test_built_in_layouts_stand_on_the_body():
    body = average_body()
    for name in layout_names():
        made = layout(name)
        assert made.name == name
        assert len(default_placements(made, body)) == len(made)
    six = layout("six-trackers")
    assert [sensor.bone for sensor in six.sensors] == [
        "head",
        "upperChest",
        "leftHand",
        "rightHand",
        "leftLowerLeg",
        "rightLowerLeg",
    ]
    assert six.rate == 40.0
    assert six.of_kind(SensorKind.TRACKER) == (0, 1, 2, 3, 4, 5)
    assert six.index("leftAnkle") == 4


def test_unknown_names_are_told_with_the_valid_ones():
    with pytest.raises(SensorError, match=r"Did you mean 'six-trackers'\? .*three-trackers"):
        layout("six-tracker")
    with pytest.raises(SensorError, match="Did you mean 'leftHand'"):
        layout("six-trackers").index("lefthand")


@given(parts=parts_of_layouts)
def test_any_layout_is_placed_within_reach_of_its_bones(parts: tuple[str, list[SensorSpec], float]):
    body, made = average_body(), make_layout(*parts)
    placements = default_placements(made, body)
    assert [placement.bone for placement in placements] == [sensor.bone for sensor in made.sensors]
    for sensor, placement in zip(made.sensors, placements, strict=True):
        np.testing.assert_array_equal(placement.R_bone_sensor, np.eye(3))
        assert np.linalg.norm(placement.p_bone_sensor) < 0.5
        assert made.sensors[made.index(sensor.name)] is sensor


@given(parts=parts_of_layouts, factor=st.floats(0.5, 2.0))
def test_placements_grow_with_the_body(parts: tuple[str, list[SensorSpec], float], factor: float):
    body, made = average_body(), make_layout(*parts)
    grown = body.with_offsets(body.offsets * factor, body.tips * factor)
    for small, large in zip(default_placements(made, body), default_placements(made, grown), strict=True):
        np.testing.assert_allclose(large.p_bone_sensor, small.p_bone_sensor * factor, atol=1e-12)


@pytest.mark.parametrize("kind", list(SensorKind))
def test_left_and_right_are_mirror_images(kind: SensorKind):
    bones = [bone for bone in BODY_BONES if bone.startswith("left")]
    for bone in bones:
        pair = make_layout("pair", [SensorSpec(b, kind, b) for b in (bone, bone.replace("left", "right"))], 40.0)
        left, right = default_placements(pair, average_body())
        np.testing.assert_allclose(right.p_bone_sensor, left.p_bone_sensor * MIRROR, atol=1e-12)


def test_trackers_sit_where_people_wear_them():
    six, body = layout("six-trackers"), average_body()
    q = np.zeros(body.size)
    q[1] = 1.0
    joints = forward_kinematics(body, q)
    at = dict(zip(six.names, place_sensors(joints, body, default_placements(six, body)).positions, strict=True))

    def joint(name: str):
        return joints.positions[body.index(name)]

    assert at["head"][1] > joint("head")[1] + 0.05
    assert at["head"][2] > joint("head")[2] + 0.05
    assert joint("upperChest")[1] < at["upperChest"][1] < joint("neck")[1]
    assert at["upperChest"][2] > 0.08
    assert at["leftAnkle"][0] > joint("leftFoot")[0]
    assert 0.0 < at["leftAnkle"][1] - joint("leftFoot")[1] < 0.06


def test_a_skeleton_without_the_bone_is_refused():
    stick = make_skeleton(["hips", "head"], [-1, 0], [[0, 0, 0], [0, 0.5, 0]])
    with pytest.raises(SensorError, match=r"no bone 'upperChest'.*hips, head"):
        default_placements(layout("six-trackers"), stick)


def test_a_placed_sensor_comes_back_to_its_placement():
    rng = np.random.default_rng(3)
    body = average_body()
    motion = make_motion(body, rng.normal(size=(20, body.size)), 40.0)
    placements = [
        make_placement(bone, rng.normal(size=3), matrix_from_rotvec(rng.normal(size=3)))
        for bone in ("head", "leftToes")
    ]
    frames = motion_frames(motion)
    sensors = place_sensors(frames, body, placements)
    for index, placement in enumerate(placements):
        bone = body.index(placement.bone)
        turned = np.swapaxes(frames.rotations[:, bone], -1, -2)
        back = np.einsum("fij,fj->fi", turned, sensors.positions[:, index] - frames.positions[:, bone])
        np.testing.assert_allclose(back, np.tile(placement.p_bone_sensor, (20, 1)), atol=1e-12)
        np.testing.assert_allclose(
            turned @ sensors.rotations[:, index], np.tile(placement.R_bone_sensor, (20, 1, 1)), atol=1e-12
        )


@pytest.mark.parametrize(
    ("place", "turn", "message"),
    [
        ([0.0, np.nan, 0.0], np.eye(3), "not three finite numbers"),
        ([0.0, 0.0], np.eye(3), "not three finite numbers"),
        (np.zeros(3), 2 * np.eye(3), "not a rotation"),
        (np.zeros(3), np.diag([1.0, 1.0, -1.0]), "not a rotation"),
        (np.zeros(3), np.full((3, 3), np.nan), "not a rotation"),
        (np.zeros(3), np.eye(4), "not a rotation"),
    ],
)
def test_impossible_placements_are_refused(place, turn, message: str):
    with pytest.raises(SensorError, match=message):
        make_placement("head", place, turn)


def test_impossible_layouts_are_refused():
    spec = SensorSpec("a", SensorKind.TRACKER, "head")
    with pytest.raises(SensorError, match="no sensors"):
        make_layout("x", [], 40.0)
    with pytest.raises(SensorError, match="doubled sensors a"):
        make_layout("x", [spec, spec], 40.0)
    with pytest.raises(SensorError, match="without a name"):
        make_layout("x", [replace(spec, name="")], 40.0)
    for rate in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(SensorError, match="rate"):
            make_layout("x", [spec], rate)


def test_samples_and_cuts_are_what_the_columns_say():
    recording = small_recording()
    sample = recording.sample(3)
    assert sample.time == recording.times[3] == sample.arrival
    np.testing.assert_array_equal(sample.positions, recording.positions[3])
    assert np.isnan(sample.counts).all()
    assert (sample.status == SensorStatus.OK).all()
    part = recording.cut(2, 4)
    assert len(part) == 2
    np.testing.assert_array_equal(part.times, recording.times[2:4])
    assert part.truth is not None
    assert recording.truth is not None
    np.testing.assert_array_equal(part.truth.q, recording.truth.q[2:4])
    with pytest.raises(SensorError, match="leave nothing"):
        recording.cut(5, 9)


def test_arrays_of_a_recording_cannot_be_written_to():
    recording = small_recording()
    for name in (
        "times",
        "arrivals",
        "positions",
        "quats_wxyz",
        "specific_forces",
        "angular_rates",
        "counts",
        "status",
    ):
        assert not getattr(recording, name).flags.writeable


def test_a_missing_sensor_is_marked():
    recording = small_recording()
    positions, quats = recording.positions.copy(), recording.quats_wxyz.copy()
    positions[1, 2], quats[1, 2] = np.nan, np.nan
    status = with_columns(recording, positions=positions, quats_wxyz=quats).status
    expected = np.zeros((5, 6), dtype=np.int64)
    expected[1, 2] = SensorStatus.MISSING
    np.testing.assert_array_equal(status, expected)


def test_what_does_not_fit_is_refused():
    good = small_recording()
    half, endless, long = good.positions.copy(), good.positions.copy(), good.quats_wxyz * 1.1
    half[0, 0, 1], endless[4, 5, 0] = np.nan, np.inf
    assert good.truth is not None
    cases: list[tuple[dict[str, object], str]] = [
        ({"positions": half}, "sample 0, sensor 0, is infinite or half missing"),
        ({"positions": endless}, "sample 4, sensor 5, is infinite or half missing"),
        ({"positions": good.positions[:, :5]}, r"shape \(5, 5, 3\), not \(5, 6, 3\)"),
        ({"quats_wxyz": long}, "not of unit length"),
        ({"times": np.array([0.0, 1, 1, 2, 3])}, "time of sample 2 is not after"),
        ({"times": np.array([0.0, 1, np.nan, 2, 3])}, "time of sample 2 is not finite"),
        ({"times": np.zeros(0)}, "no samples"),
        ({"arrivals": np.zeros(4)}, "arrival times"),
        ({"status": np.ones((5, 6), dtype=np.int64)}, "status MISSING but a value"),
        ({"status": np.full((5, 6), 9)}, "a status is unknown"),
        ({"status": np.zeros((5, 5), dtype=np.int64)}, r"status has shape \(5, 5\)"),
        ({"truth": good.truth.cut(0, 4)}, "truth has 4 frames"),
        ({"truth": make_motion(good.skeleton, good.truth.q, 50.0)}, "at 50 Hz"),
    ]
    for columns, message in cases:
        with pytest.raises(SensorError, match=message):
            with_columns(good, **columns)
    gone = {"positions": good.positions * np.nan, "quats_wxyz": good.quats_wxyz * np.nan}
    with pytest.raises(SensorError, match="status OK but no value"):
        with_columns(good, **gone, status=np.zeros((5, 6), dtype=np.int64))
    stick = make_skeleton(["hips", "head"], [-1, 0], [[0, 0, 0], [0, 0.5, 0]])
    with pytest.raises(SensorError, match="no bone 'upperChest'"):
        with_columns(good, skeleton=stick, truth=None)
    with pytest.raises(SensorError, match=r"placements on .* do not fit layout"):
        make_recording(good.layout, good.placements[:3], good.skeleton, good.times)
    other = average_body()
    renamed = make_skeleton([n.upper() for n in other.names], other.parents, other.offsets)
    with pytest.raises(SensorError, match="moves other bones"):
        with_columns(good, truth=make_motion(renamed, good.truth.q, 40.0))


def test_the_summary_names_sensors_gaps_and_settings():
    recording = replace(small_recording(), settings={"long": "x" * 500}, name="walk")
    told = dict(summarise(recording))
    assert told["name"] == "walk"
    assert "leftAnkle (tracker)" in told["sensors"]
    assert told["missing"] == "none"
    assert len(told["long"]) == 60
