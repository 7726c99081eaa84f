"""Phases of locomotion, told from contacts and crossings."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from poseloom.cli._app import run
from poseloom.errors import MethodError
from poseloom.formats import read_motion
from poseloom.formats.npz import write_npz
from poseloom.methods.imus.behaviours import Behaviour
from poseloom.methods.imus.phases import (
    GAIT_CYCLE,
    LEAP_CYCLE,
    MIRRORED,
    Phase,
    ankle_lead,
    label_phases,
)
from poseloom.samples import sample_motions
from poseloom.skeleton import Motion, average_body, make_motion, mirror_motion, resample, retarget

BODY = average_body()
WALKS = (
    "mocap/cmu_asfamc/35/35_01.amc",
    "mocap/cmu_asfamc/02/02_01.amc",
    "mocap/cmu_bvh/16/16_15.bvh",
)


def walk() -> Motion:
    return retarget(sample_motions()["walk"], BODY)


def steps_of(phases: np.ndarray) -> list[Phase]:
    return [Phase(int(phases[0])), *(Phase(int(b)) for a, b in pairwise(phases) if a != b)]


def test_a_walk_goes_through_the_cycle_in_order() -> None:
    order = steps_of(label_phases(walk(), Behaviour.WALKING).phases)
    gait = [phase for phase in order if phase in GAIT_CYCLE]
    assert len(gait) > 30
    ahead = [(b - a) % 8 for a, b in pairwise(gait)]
    # A phase may be skipped where it is shorter than a flicker; none is entered backwards.
    assert sum(step == 1 for step in ahead) > 0.8 * len(ahead)
    assert all(step <= 2 for step in ahead)


def test_double_support_is_initial_contact_or_pre_swing_and_single_support_is_not() -> None:
    track = label_phases(walk(), Behaviour.WALKING)
    stands = track.contacts
    both, double = stands.left & stands.right, np.isin(track.phases, [Phase.INITIAL_CONTACT, Phase.PRE_SWING])
    assert (double == both).mean() > 0.97
    right_alone = np.isin(track.phases, [Phase.LOADING_RESPONSE, Phase.MID_STANCE, Phase.TERMINAL_STANCE])
    assert (right_alone == (stands.right & ~stands.left)).mean() > 0.97


def test_ankles_cross_where_loading_response_ends() -> None:
    motion = walk()
    track = label_phases(motion, Behaviour.WALKING)
    lead = ankle_lead(motion)
    ends = np.flatnonzero((track.phases[:-1] == Phase.LOADING_RESPONSE) & (track.phases[1:] == Phase.MID_STANCE))
    assert len(ends) > 4
    assert (lead[ends - 2] > 0).all()
    assert (lead[ends + 3] < 0).all()


def test_the_mirror_image_is_in_the_other_legs_phase() -> None:
    motion = walk()
    phases = label_phases(motion, Behaviour.WALKING).phases
    image = label_phases(mirror_motion(motion), Behaviour.WALKING).phases
    expected = np.array([MIRRORED[Phase(int(phase))] for phase in phases])
    assert (image == expected).mean() > 0.97


def leaping(flights: list[tuple[float, float]], seconds: float = 4.0, rate: float = 60.0) -> Motion:
    """A body that stands, crouches and flies; both feet leave and land together."""
    times = np.arange(int(seconds * rate)) / rate
    knee = np.full(len(times), 0.6)
    up = np.zeros(len(times))
    for begin, end in flights:
        inside = (times >= begin) & (times <= end)
        up += np.where(inside, 4.9 * (times - begin) * (end - times), 0.0)
        knots = (begin - 0.5, begin - 0.15, begin, end, end + 0.15, end + 0.6)
        knee += np.interp(times, knots, (0.0, 1.0, 0.0, 0.0, 1.0, 0.0))
    q = np.zeros((len(times), BODY.size))
    for side in ("left", "right"):
        for bone, angle in (("UpperLeg", -0.6), ("LowerLeg", 1.2), ("Foot", -0.6)):
            q[:, 3 + 3 * BODY.index(f"{side}{bone}")] = angle * knee
    leg = 0.403 * np.cos(0.6 * knee) + 0.426 * np.cos(0.6 * knee)
    q[:, 1] = 0.099 + leg + 0.08 + up
    return make_motion(BODY, q, rate)


def test_a_jump_is_push_off_flight_and_landing() -> None:
    motion = leaping([(1.5, 2.0)])
    track = label_phases(motion, Behaviour.JUMPING)
    assert [p for p in steps_of(track.phases) if p in LEAP_CYCLE] == list(LEAP_CYCLE)
    flight = np.flatnonzero(track.phases == Phase.FLIGHT) / 60
    assert abs(flight[0] - 1.5) < 0.08
    assert abs(flight[-1] - 2.0) < 0.08
    assert track.phases[10] == Phase.REST
    assert track.phases[-10] == Phase.REST


def test_standing_still_is_rest() -> None:
    still = make_motion(BODY, np.repeat(leaping([]).q[:1], 120, axis=0), 60.0)
    assert set(label_phases(still, Behaviour.WALKING).phases) == {Phase.REST}
    assert set(label_phases(still, Behaviour.JUMPING).phases) == {Phase.REST}


def test_segments_cover_every_frame_once_and_are_cut_where_they_are_long() -> None:
    track = label_phases(walk(), Behaviour.WALKING)
    for longest in (None, 7):
        segments = track.segments(longest)
        frames = np.concatenate([np.arange(s.start, s.stop) for s in segments])
        np.testing.assert_array_equal(frames, np.arange(len(track.phases)))
        for segment in segments:
            assert (track.phases[segment.start : segment.stop] == segment.phase).all()
            assert longest is None or segment.stop - segment.start <= longest


def test_too_short_a_motion_is_refused() -> None:
    with pytest.raises(MethodError, match="no phases"):
        label_phases(walk().cut(0, 2), Behaviour.WALKING)


def test_the_page_shows_every_phase_and_needs_no_network(tmp_path: Path) -> None:
    clip, page = tmp_path / "walk.npz", tmp_path / "phases.html"
    write_npz(walk(), clip)
    assert run(["phases", str(clip), "-o", str(page)]) == 0
    text = page.read_text()
    for phase in GAIT_CYCLE:
        assert phase.title in text
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
    assert run(["phases", str(clip), "-o", str(page), "--behaviour", "swimming"]) == 2
    assert run(["phases", str(clip), "-o", str(tmp_path / "phases.png")]) == 2


@pytest.mark.recordings
@pytest.mark.parametrize("file", WALKS)
def test_real_walks_go_through_the_cycle(recordings: Path, file: str) -> None:
    motion = resample(retarget(read_motion(recordings / file), BODY), 60.0)
    order = steps_of(label_phases(motion, Behaviour.WALKING).phases)
    gait = [phase for phase in order if phase in GAIT_CYCLE]
    ahead = [(b - a) % 8 for a, b in pairwise(gait)]
    assert len(ahead) > 10
    assert all(step in (1, 2) for step in ahead)
    assert sum(step == 1 for step in ahead) > 0.8 * len(ahead)
