"""The viewer without a browser: who is let in, what is drawn where, and what is shown of files."""

import contextlib
import dataclasses
import http.client
import itertools
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import viser
import websockets.exceptions
from hypothesis import example, given, settings
from hypothesis import strategies as st
from websockets.datastructures import Headers
from websockets.http11 import Request
from websockets.sync.client import ClientConnection, connect

from poseloom.calibration.poses import guided_pose
from poseloom.cli._app import run
from poseloom.errors import MethodError, PoseloomError, ViewerError
from poseloom.formats.recording import write_recording
from poseloom.live.contract import (
    ArrivalStatus,
    CalibrationProgress,
    Command,
    Counters,
    Finding,
    Latency,
    Level,
    Notice,
    SessionFacts,
    Sink,
    Trouble,
    Update,
)
from poseloom.methods.contract import Frame, Health, HealthState
from poseloom.rotations import matrix_from_quat
from poseloom.samples import sample_motions
from poseloom.sensors import Sample, default_placements, layout, make_recording
from poseloom.sensors.recording import CHANNEL_SHAPES
from poseloom.skeleton import make_skeleton
from poseloom.skeleton.body import average_body
from poseloom.skeleton.contacts import contacts
from poseloom.skeleton.kinematics import forward_kinematics, motion_frames
from poseloom.skeleton.motion import Pose, make_motion
from poseloom.skeleton.resample import resample
from poseloom.synthesis import simulate_trackers
from poseloom.viewer import server as server_module
from poseloom.viewer.access import Access, access_for
from poseloom.viewer.colours import LEVELS, METHODS, UNSURE, doubtful
from poseloom.viewer.figure import Figure, FigureLook
from poseloom.viewer.markers import SoleContacts, Trail
from poseloom.viewer.player import Player
from poseloom.viewer.playing_clock import PlayingClock
from poseloom.viewer.plots import POINTS, Rolling, decimated
from poseloom.viewer.server import OpenServer, open_server
from poseloom.viewer.session import SessionViewer
from poseloom.viewer.stage import WORLD, Stage, framing
from poseloom.viewer.tracks import Take, Wanted, load_take, position_errors_cm, track_of
from poseloom.viewer.words import box, findings_text

SUBPROTOCOL = f"viser-v{viser.__version__}"


# --- who is let in ---------------------------------------------------------------------------------------------------


def request(path: str = "/", **fields: str) -> Request:
    return Request(path, Headers({name.replace("_", "-"): value for name, value in fields.items()}))


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        (request(Host="127.0.0.1:8080"), None),
        (request(Host="localhost:8080"), None),
        (request(Host="[::1]:8080"), None),
        (request(Host="127.0.0.1:8080", Origin="http://127.0.0.1:8080", Upgrade="websocket"), None),
        # A name of somebody else's that was made to mean this machine.
        (request(Host="evil.example:8080"), 403),
        (request(), 403),
        # Another page in the same browser.
        (request(Host="127.0.0.1:8080", Origin="https://evil.example", Upgrade="websocket"), 403),
        (request(Host="127.0.0.1:8080", Origin="http://127.0.0.1:9999", Upgrade="websocket"), 403),
        (request(Host="127.0.0.1:8080", Origin="null", Upgrade="websocket"), 403),
    ],
)
def test_on_the_loopback_only_the_viewers_own_page_is_answered(asked: Request, status: int | None):
    answer = access_for("127.0.0.1").answer(asked)
    assert (answer and answer.status_code) == status


@pytest.mark.parametrize(
    ("asked", "status"),
    [
        (request(Host="host:8080"), 401),
        (request("/?token=wrong", Host="host:8080"), 401),
        (request("/?token=", Host="host:8080"), 401),
        (request("/?token=secret", Host="host:8080"), 303),
        (request(Host="host:8080", Cookie="poseloom-8080=secret"), None),
        (request(Host="host:8080", Cookie="a=b; poseloom-8080=secret; c=d"), None),
        (request(Host="host:8080", Cookie="poseloom-8081=secret"), 401),
        (request(Host="host:8080", Cookie="poseloom-8080=secre"), 401),
        (request(Host="host:8080", Cookie="poseloom-8080=sécret"), 401),
        (request(Host="host:8080", Cookie=";;=;,[]"), 401),
        (request("/any?token=secret", Host="host:8080", Upgrade="websocket"), None),
        (request(Host="host:8080", Upgrade="websocket"), 401),
        (request(Host="host:8080", Cookie="poseloom-8080=secret", Origin="http://other:8080"), 403),
        (request(Host="host:port", Cookie="poseloom-8080=secret"), 401),
    ],
)
def test_elsewhere_the_token_is_needed(asked: Request, status: int | None):
    answer = Access("secret", local=False).answer(asked)
    assert (answer and answer.status_code) == status


HEADER_TEXT = st.text(st.characters(min_codepoint=0x20, max_codepoint=0xFF, exclude_categories=["Cc"]), max_size=30)


@given(HEADER_TEXT, HEADER_TEXT, HEADER_TEXT)
@settings(max_examples=60, deadline=None)
def test_no_request_upsets_the_guard_or_guesses_its_way_in(path: str, cookie: str, host: str):
    answer = Access("not to be guessed", local=False).answer(Request("/" + path, Headers(Host=host, Cookie=cookie)))
    assert answer is not None
    assert answer.status_code in (401, 403)


@given(HEADER_TEXT, HEADER_TEXT, HEADER_TEXT)
@example("/[", "", "")
@example("", "[", "")
@example("", "localhost:8080", "http://[")
@settings(max_examples=60, deadline=None)
def test_no_address_upsets_either_guard(path: str, host: str, origin: str):
    asked = Request("/" + path, Headers(Host=host, Origin=origin))
    assert Access("not to be guessed", local=False).answer(asked) is not None
    if origin != f"http://{host}":
        assert Access("", local=True).answer(asked) is not None


def test_every_viewer_has_a_token_of_its_own():
    tokens = {access_for("0.0.0.0").token for _ in range(5)}
    assert len(tokens) == 5
    assert min(map(len, tokens)) >= 20
    assert access_for("127.0.0.1").token == access_for("::1").token == access_for("localhost").token == ""


@pytest.fixture(scope="module")
def guarded() -> Iterator[OpenServer]:
    server = open_server("0.0.0.0", 0)
    yield server
    server.close()


def fetch(server: OpenServer, path: str, **fields: str) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.viser.get_port(), timeout=60)
    connection.request("GET", path, headers=fields)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, dict(answer.getheaders()), body


def dial(server: OpenServer, path: str = "/", **fields: str) -> ClientConnection:
    address = f"ws://127.0.0.1:{server.viser.get_port()}{path}"
    return connect(address, subprotocols=[SUBPROTOCOL], additional_headers=fields, compression=None)


@pytest.mark.parametrize("path", ["/", "/index.html", "/?token=x", "/../../secret", "/assets/x.js"])
def test_without_the_token_nothing_is_served(guarded: OpenServer, path: str):
    status, _, body = fetch(guarded, path)
    assert status == 401
    assert len(body) < 200


def test_without_the_token_no_websocket_opens(guarded: OpenServer):
    with pytest.raises(websockets.exceptions.InvalidStatus, match="401"):
        dial(guarded)
    with pytest.raises(websockets.exceptions.InvalidStatus, match="403"):
        dial(
            guarded, Origin="https://evil.example", Cookie=f"poseloom-{guarded.viser.get_port()}={guarded.access.token}"
        )
    assert guarded.viser.get_clients() == {}


def test_the_printed_address_lets_in_and_leaves_no_token_in_the_history(guarded: OpenServer):
    status, fields, _ = fetch(guarded, guarded.url.partition("/?")[1] + guarded.url.partition("/?")[2])
    assert (status, fields["Location"]) == (303, "/")
    assert "HttpOnly" in fields["Set-Cookie"]
    cookie = fields["Set-Cookie"].partition(";")[0]
    status, _, body = fetch(guarded, "/", Cookie=cookie)
    assert status == 200
    assert b"<!doctype html>" in body[:100].lower()
    with dial(guarded, Cookie=cookie) as visitor:
        assert len(visitor.recv(timeout=60)) > 100


def test_with_a_token_nobody_without_it_presses_buttons_on_the_loopback():
    posted: list[Command] = []
    viewer = SessionViewer(port=0, token="new")
    try:
        viewer.open(facts_of("six-trackers"), posted.append)
        server = viewer._server
        assert "?token=" in viewer.url
        assert viewer.exposure == ""
        for path in ("/", "/?token=wrong"):
            with pytest.raises(websockets.exceptions.InvalidStatus, match="401"):
                dial(server, path)
        with pytest.raises(websockets.exceptions.InvalidStatus, match="401"):
            dial(server, Origin=f"http://127.0.0.1:{server.viser.get_port()}")
        assert fetch(server, "/")[0] == 401
        assert server.viser.get_clients() == {}
        assert posted == []
        with dial(server, f"/?token={server.access.token}") as visitor:
            assert len(visitor.recv(timeout=5)) > 100
    finally:
        viewer.close()


def test_a_token_can_be_chosen_and_is_refused_where_it_can_be_guessed():
    assert access_for("127.0.0.1", "mine") == Access("mine", True)
    assert len(access_for("127.0.0.1", "new").token) >= 20
    assert access_for("0.0.0.0", "a-long-secret-1234") == Access("a-long-secret-1234", False)
    for bind, token in (("0.0.0.0", "mine"), ("127.0.0.1", "a b"), ("127.0.0.1", "a;b"), ("127.0.0.1", "x" * 200)):
        with pytest.raises(ViewerError, match="--token new"):
            access_for(bind, token)


def test_a_viewer_off_the_loopback_says_what_others_can_do(guarded: OpenServer):
    assert "press every button" in guarded.exposure
    assert "--bind 127.0.0.1" in guarded.exposure


def test_nobody_can_open_a_tunnel_to_the_outside(guarded: OpenServer):
    assert guarded.viser.request_share_url() is None


def test_a_taken_port_and_a_foreign_address_are_refused(guarded: OpenServer):
    with pytest.raises(ViewerError, match=r"port \d+.*Choose another --port"):
        open_server("127.0.0.1", guarded.viser.get_port())
    with pytest.raises(ViewerError, match=r"203\.0\.113\.5"):
        open_server("203.0.113.5")
    with pytest.raises(ViewerError, match="no-such-host"):
        open_server("no-such-host.invalid", 0)


def test_a_server_that_the_guard_does_not_reach_is_not_left_open(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(server_module, "_guarding", lambda _access: contextlib.nullcontext([]))
    with pytest.raises(ViewerError, match="guard"):
        open_server("127.0.0.1", 0)


def test_a_visitor_who_does_not_read_fills_no_memory(guarded: OpenServer):
    figure = Figure(guarded.viser.scene, "/slow", average_body(), FigureLook(METHODS[0]))
    buffer = guarded.viser._websock_server._broadcast_buffer
    cookie = f"poseloom-{guarded.viser.get_port()}={guarded.access.token}"
    with dial(guarded, Cookie=cookie):
        rng = np.random.default_rng(0)
        sizes: list[int] = []
        for _ in range(60):
            figure.pose(0.3 * rng.standard_normal(average_body().size))
            sizes.append(len(buffer.message_from_id))
    # The newest pose of each bone replaces the one that still waits.
    assert sizes[-1] <= sizes[1]
    figure.remove()


# --- figures ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scene() -> Iterator[viser.ViserServer]:
    server = open_server("127.0.0.1", 0)
    yield server.viser
    server.close()


def world_of(figure: Figure) -> tuple[np.ndarray, np.ndarray]:
    """Where the scene's nodes put the bones: each hangs on its parent."""
    parents = figure.skeleton.parents
    places, turns = np.zeros((len(parents), 3)), np.zeros((len(parents), 3, 3))
    for joint, (node, parent) in enumerate(zip(figure._nodes, parents, strict=True)):
        turn, place = matrix_from_quat(np.asarray(node.wxyz)), np.asarray(node.position)
        places[joint] = place if parent < 0 else places[parent] + turns[parent] @ place
        turns[joint] = turn if parent < 0 else turns[parent] @ turn
    return places, turns


def test_a_figure_stands_as_forward_kinematics_says(scene: viser.ViserServer):
    figure = Figure(scene.scene, "/oracle", average_body(), FigureLook(METHODS[0]))
    rng = np.random.default_rng(1)
    for _ in range(3):
        q = rng.standard_normal(average_body().size)
        figure.pose(q)
        expected = forward_kinematics(average_body(), q)
        places, turns = world_of(figure)
        np.testing.assert_allclose(places, expected.positions, atol=1e-6)
        np.testing.assert_allclose(turns, expected.rotations, atol=1e-6)
    figure.remove()


def test_a_figure_of_any_skeleton_takes_moved_joints(scene: viser.ViserServer):
    skeleton = make_skeleton(("root", "a/b", "tip"), [-1, 0, 1], [[0, 0, 0], [0, 0.5, 0], [0, 0.4, 0]])
    rng = np.random.default_rng(2)
    moved = 0.05 * rng.standard_normal((1, 3, 3))
    moved[:, 0] = 0
    motion = make_motion(skeleton, rng.standard_normal((1, skeleton.size)), 30.0, displacements=moved)
    figure = Figure(scene.scene, "/chain", skeleton, FigureLook(METHODS[1]))
    figure.pose(motion.q[0], skeleton.offsets + moved[0])
    np.testing.assert_allclose(world_of(figure)[0], motion_frames(motion).positions[0], atol=1e-6)
    figure.remove()


def test_doubt_colours_the_bones_that_are_doubtful(scene: viser.ViserServer):
    body = average_body()
    figure = Figure(scene.scene, "/doubt", body, FigureLook(METHODS[0]))
    spread = np.full(body.size, np.radians(1.0))
    hand = body.index("leftHand")
    spread[3 + 3 * hand : 6 + 3 * hand] = np.radians(40.0)
    figure.doubt(spread)
    assert tuple(figure._nodes[hand].color) == UNSURE
    assert tuple(figure._nodes[body.index("head")].color) == METHODS[0]
    figure.doubt(None)
    assert tuple(figure._nodes[hand].color) == METHODS[0]
    figure.remove()


def test_doubt_has_as_many_colours_as_steps():
    assert doubtful(METHODS[0], 0) == METHODS[0]
    assert doubtful(METHODS[0], LEVELS) == UNSURE
    assert len({doubtful(METHODS[0], level) for level in range(LEVELS + 1)}) == LEVELS + 1


@given(st.integers(300, 2600), st.integers(300, 1800), st.integers(1, 3))
@settings(max_examples=80, deadline=None)
def test_every_screen_shows_every_figure_whole(width: int, height: int, figures: int):
    view = framing(width, height, figures, 1.25)
    forward = (view.look_at - view.position) / np.linalg.norm(view.look_at - view.position)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    middle = 0.5 * (figures - 1) * 1.25
    for index, x, y in itertools.product(range(figures), (-0.45, 0.45), (0.0, 1.8)):
        point = np.array([index * 1.25 - middle + x, y, 0.0]) - view.position
        half = np.tan(np.radians(16.0)) * (point @ forward)
        across, above = (point @ right) / half * height / width, (point @ up) / half
        assert abs(across) <= 1.0
        assert abs(above) <= 1.0
        if width < 576 and height > 1.25 * width:
            assert above > -0.12, "on a phone the panel lies below"


def test_the_world_moves_under_who_walks(scene: viser.ViserServer):
    stage = Stage(scene)
    stage.face(0.7)
    for step in np.linspace(0.0, 10.0, 50):
        root = np.array([step, 1.0, -2 * step])
        stage.follow(root)
    seen = matrix_from_quat(np.asarray(stage.world.wxyz)) @ root + np.asarray(stage.world.position)
    assert np.linalg.norm(seen[[0, 2]]) < 0.3
    assert seen[1] == pytest.approx(1.0)
    right = matrix_from_quat(np.asarray(stage.world.wxyz)) @ stage.across(2.0)
    np.testing.assert_allclose(right, [2.0, 0.0, 0.0], atol=1e-9)


def test_standing_feet_are_told_at_once_much_as_from_the_whole():
    walk = sample_motions()["walk"]
    frames, whole = motion_frames(walk), contacts(walk)
    soles = SoleContacts(walk.skeleton)
    told = np.zeros((len(walk), 4), dtype=bool)
    for index in range(len(walk)):
        now = frames._replace(positions=frames.positions[index], rotations=frames.rotations[index])
        told[index] = soles.step(index / walk.rate, soles.places(now))
    expected = np.stack([whole.left_heel, whole.left_toe, whole.right_heel, whole.right_toe], axis=1)
    assert (told == expected)[30:].mean() > 0.93
    assert 0.2 < told[30:].mean() < 0.8


def test_a_trail_begins_anew_after_a_jump(scene: viser.ViserServer):
    trail = Trail(scene.scene, f"{WORLD}/trail", METHODS[0])
    for index in range(40):
        trail.add(0.1 * index, np.array([0.05 * index, 1.0, 0.0]))
    pieces = np.asarray(trail._line.points)
    assert np.abs(np.diff(pieces, axis=1)).max() < 0.2
    assert pieces[:, :, 1].max() < 0.05
    trail.add(4.0, np.array([50.0, 1.0, 0.0]))
    assert np.asarray(trail._line.points)[:, :, 0].min() == 50.0
    trail.remove()


# --- plots and words -------------------------------------------------------------------------------------------------


@given(st.floats(20.0, 1000.0), st.integers(1, 3000), st.booleans())
@settings(max_examples=30, deadline=None)
def test_a_rolling_plot_is_never_longer_than_it_can_show(rate: float, count: int, peaks: bool):
    series = Rolling(2, seconds=2.0, peaks=peaks)
    for index in range(count):
        series.add(index / rate, np.array([float(index), 1.0]))
    times, rising, level = series.lines()
    assert len(times) == len(rising) == len(level) <= POINTS
    assert times[-1] == 0.0
    assert times[0] >= -2.0
    assert (np.diff(times) > 0).all()
    assert rising[-1] == count - 1
    assert (level == 1.0).all()


def test_a_peak_between_two_points_is_seen():
    kept, lost = Rolling(1, seconds=12.0, peaks=True), Rolling(1, seconds=12.0)
    for index in range(1000):
        for series in (kept, lost):
            series.add(index / 1000, np.array([50.0 if index == 777 else 1.0]))
    assert kept.lines()[1].max() == 50.0
    assert lost.lines()[1].max() == 1.0


def test_a_silent_sensor_keeps_its_last_value_and_a_restarted_clock_begins_anew():
    series = Rolling(1, seconds=2.0)
    series.add(100.0, np.array([3.0]))
    series.add(101.0, np.array([np.nan]))
    assert series.lines()[1].tolist() == [3.0, 3.0]
    series.add(0.0, np.array([4.0]))
    assert series.lines()[1].tolist() == [4.0]
    assert all(np.isfinite(line).all() for line in Rolling(3).lines())


def test_long_series_are_decimated():
    times = np.linspace(0, 600, 36_000)
    values = np.stack([np.sin(times), np.full_like(times, np.nan)], axis=1)
    shown = decimated(times, values)
    assert len(shown) == 3
    assert len(shown[0]) == 2 * POINTS
    np.testing.assert_allclose(shown[1], np.sin(shown[0]))
    assert (shown[2] == 0).all()


def test_what_devices_say_is_text_and_never_markup():
    text = findings_text([Finding("x", Trouble.SILENT, "<script>alert(1)</script>", 0.0)])
    assert "<script>" not in text
    assert "&lt;script&gt;" in text
    assert findings_text([]) == ""
    assert "a" in box("a")


# --- what is shown of files ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def walk_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("take") / "walk.mcap"
    walk = resample(sample_motions()["walk"].cut(0, 90), 40.0)
    write_recording(simulate_trackers(walk, layout("six-trackers"), seed=1), path)
    return path


def without_truth(path: Path, kind: str, tmp_path: Path) -> Path:
    worn = layout(kind)
    count = len(worn)
    if kind == "flex-four":
        values = {"counts": np.full((5, count), 500.0)}
    else:
        values = {
            "positions": np.tile([0.0, 1.0, 0.0], (5, count, 1)),
            "quats_wxyz": np.tile([1.0, 0.0, 0.0, 0.0], (5, count, 1)),
        }
    body = average_body()
    made = make_recording(worn, default_placements(worn, body), body, np.arange(5) / worn.rate, **values)
    write_recording(made, tmp_path / path)
    return tmp_path / path


def test_a_recording_is_shown_with_its_truth_and_methods(walk_file: Path):
    told: list[tuple[str, int, int]] = []
    take = load_take([walk_file], Wanted(("inverse-kinematics",)), lambda *step: told.append(step))
    assert [track.label for track in take.tracks] == ["truth", "inverse-kinematics"]
    assert take.truth
    assert told[-1][1] == told[-1][2]
    errors = position_errors_cm(take, take.tracks[1])
    assert errors is not None
    assert 0 < errors[1].mean() < 30
    assert position_errors_cm(take, take.tracks[0]) is None
    assert take.tracks[1].health is not None


def test_the_same_motion_twice_differs_in_nothing():
    take = load_take(["sample:walk", "sample:walk"])
    errors = position_errors_cm(take, take.tracks[1])
    assert errors is not None
    assert errors[1].max() == 0


def test_motions_of_other_rates_are_compared_at_the_same_times():
    walk = sample_motions()["walk"]
    half = make_motion(walk.skeleton, walk.q[::2], walk.rate / 2, "half")
    tracks = (track_of("whole", METHODS[0], walk), track_of("half", METHODS[1], half))
    take = Take("both", tracks, False, None, 1.0)
    errors = position_errors_cm(take, tracks[1])
    assert errors is not None
    assert errors[1].max() < 1e-9
    assert tracks[1].frame_at(0.0) == 0
    assert tracks[1].frame_at(2.0 / walk.rate) == 1
    assert tracks[1].frame_at(1e9) == len(half) - 1
    assert tracks[1].frame_at(-1.0) == 0


def test_trackers_alone_are_shown_by_the_method_that_needs_nothing(tmp_path: Path):
    take = load_take([without_truth(Path("bare.mcap"), "six-trackers", tmp_path)])
    assert [track.label for track in take.tracks] == ["inverse-kinematics"]


def test_what_cannot_be_shown_is_refused(walk_file: Path, tmp_path: Path):
    with pytest.raises(ViewerError, match="two recordings"):
        load_take([walk_file, walk_file])
    with pytest.raises(ViewerError, match="at most 3"):
        load_take([walk_file, "sample:walk", "sample:run"], Wanted(("inverse-kinematics",)))
    with pytest.raises(ViewerError, match="needs a recording"):
        load_take(["sample:walk"], Wanted(("inverse-kinematics",)))
    with pytest.raises(ViewerError, match="Did you mean 'walk'"):
        load_take(["sample:wakl"])
    with pytest.raises(MethodError, match="needs a motion library"):
        load_take([walk_file], Wanted(("local-gaussian",)))
    with pytest.raises(ViewerError, match="--method"):
        load_take([without_truth(Path("imu.mcap"), "right-foot-imu", tmp_path)])
    with pytest.raises(PoseloomError, match="no such file"):
        load_take([tmp_path / "none.mcap"])


def test_the_clock_plays_seeks_and_stops_at_the_end(monkeypatch: pytest.MonkeyPatch):
    now = [0.0]
    monkeypatch.setattr("poseloom.viewer.playing_clock.time.monotonic", lambda: now[0])
    clock = PlayingClock(10.0)
    now[0] = 5.0
    assert clock.now() == 0.0
    clock.toggle()
    now[0] = 6.0
    assert clock.now() == pytest.approx(1.0)
    clock.faster(2.0)
    now[0] = 7.0
    assert clock.now() == pytest.approx(3.0)
    clock.seek(9.5)
    now[0] = 8.0
    assert clock.now() == 10.0
    assert not clock.playing
    clock.toggle()
    assert clock.playing
    assert clock.now() == 0.0
    clock.seek(-3.0)
    assert clock.now() == 0.0
    clock.toggle()
    clock.close()
    assert not clock.wait(0.0)


def test_a_player_plays_without_anybody_looking(walk_file: Path):
    player = Player(load_take([walk_file]), port=0)
    try:
        player._clock.toggle()
        player._clock.seek(1.0)
        deadline = 100
        while player._controls._time.value < 1.05 and deadline:
            player._thread.join(0.05)
            deadline -= 1
        assert player._controls._time.value >= 1.05
        assert player._thread.is_alive()
    finally:
        player.close()
    assert not player._thread.is_alive()


# --- a live session --------------------------------------------------------------------------------------------------


def facts_of(kind: str, **changes: object) -> SessionFacts:
    worn, body = layout(kind), average_body()
    facts = SessionFacts(
        worn, body, tuple(default_placements(worn, body)), False, "a", ("a", "b"), 0, ("a source",), kind[-1] == "s"
    )
    return dataclasses.replace(facts, **changes)


def update_of(facts: SessionFacts, number: int, **changes: object) -> Update:
    count = len(facts.layout)
    values = {name: np.full((count, *shape), np.nan) for name, shape in CHANNEL_SHAPES.items()}
    sample = Sample(number / 60.0, 0.0, **values, status=np.full(count, 1))
    q = np.full(facts.skeleton.size, 0.01 * number)
    frame = Frame(number / 60.0, Pose(facts.skeleton, q), np.full_like(q, 0.1), Health(HealthState.COASTING))
    made = Update(number, sample, frame, number / 60.0, Latency(1.0, 2.0, 3.0, 1.0, 0.5, 0.0), Counters())
    return dataclasses.replace(made, **changes)


def visitor() -> Mock:
    """Somebody who looks."""
    client = Mock(spec=viser.ClientHandle)
    client.client_id = 0
    client.camera = Mock(image_width=1280, image_height=800)
    client.atomic.return_value = contextlib.nullcontext()
    return client


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Iterator[SessionViewer]:
    """A viewer that takes itself for watched, and draws every update."""
    viewer = SessionViewer(port=0, frame_rate=1e9)
    monkeypatch.setattr(viewer._server.viser, "get_clients", dict.fromkeys([0], visitor()).copy)
    yield viewer
    viewer.close()


@pytest.mark.parametrize("kind", ["six-trackers", "right-foot-imu", "flex-four", "flex-four+hips-imu"])
def test_every_layout_is_drawn_with_and_without_readings(watched: SessionViewer, kind: str):
    facts = facts_of(kind)
    watched.open(facts, lambda _command: None)
    for number in range(3):
        watched.show(update_of(facts, number))
    watched.show(update_of(facts, 3, frame=None))
    places = [np.asarray(mark.position) for mark in watched._scene._sensors._marks]
    # A tracker that never said where it is is not shown; the others are where they are worn.
    assert all(place.any() == (kind != "six-trackers") for place in places)
    assert watched.frames == 4
    assert isinstance(watched, Sink)


def test_what_is_wrong_stands_in_the_panel(watched: SessionViewer):
    facts = facts_of("six-trackers")
    watched.open(facts, lambda _command: None)
    finding = Finding("leftHand", Trouble.SILENT, "leftHand is silent: check its battery", 1.0)
    levels = {1: Level.ERROR, 2: Level.ERROR, 3: Level.WARNING}
    notices = tuple(Notice(n, level, f"notice {n}", time.monotonic()) for n, level in levels.items())
    watched.show(update_of(facts, 1, findings=(finding,), notices=notices))
    assert "check its battery" in watched._panel._findings.content
    assert watched._panel._findings.visible
    assert "silent" in watched._panel._sensors.content
    assert "notice 3" in watched._panel._said.content
    (client,) = watched._server.viser.get_clients().values()
    watched._panel._written = 0.0
    watched.show(update_of(facts, 2, notices=notices))
    assert not watched._panel._findings.visible
    assert [call.args[1] for call in client.add_notification.call_args_list] == ["notice 1", "notice 2"]


def test_what_arrives_stands_in_the_panel_without_a_single_pose(watched: SessionViewer):
    facts = facts_of("six-trackers")
    watched.open(facts, lambda _command: None)
    assert not watched._panel._arrivals.visible
    text = "only bones come from <x> at 60 packets/s; switch on 'send trackers'"
    notices = tuple(Notice(n, Level.WARNING, said, time.monotonic()) for n, said in ((1, "a port is open"), (2, text)))
    watched.changed(dataclasses.replace(facts, arrivals=ArrivalStatus(Level.WARNING, text, ""), notices=notices))
    assert "Only bones come from &lt;x&gt;" in watched._panel._arrivals.content
    assert watched._panel._arrivals.visible
    assert "a port is open" in watched._panel._said.content  # and not the same text twice
    newer = ArrivalStatus(Level.NOTE, "all 6 sensors come", "")
    again = (*notices, Notice(3, Level.NOTE, newer.text, time.monotonic()))
    watched.changed(dataclasses.replace(facts, arrivals=newer, notices=again))
    assert "All 6 sensors come" in watched._panel._arrivals.content
    assert "a port is open" in watched._panel._said.content  # nor what arrived before


def test_new_facts_change_body_and_buttons(watched: SessionViewer):
    facts = facts_of("six-trackers")
    watched.open(facts, lambda _command: None)
    watched.show(update_of(facts, 0))
    body = average_body()
    taller = dataclasses.replace(
        facts, skeleton=body.with_offsets(1.1 * body.offsets), method="b", recording=Path("x.mcap"), calibrated=True
    )
    watched.changed(taller)
    watched.show(update_of(taller, 1))
    assert watched._panel._record.label == "Stop recording"
    assert watched._panel._method.value == "b"
    hips = watched._scene._figure._nodes[body.index("leftLowerLeg")]
    np.testing.assert_allclose(hips.position, 1.1 * body.offsets[body.index("leftLowerLeg")])


def test_a_calibration_is_led_through(watched: SessionViewer):
    facts = facts_of("six-trackers")
    watched.open(facts, lambda _command: None)
    hold = CalibrationProgress("Left heel up", "Stand on your right leg.", "left-heel", "hold", 1.2, 3, 8)
    watched.show(update_of(facts, 0, calibration=hold))
    panel, scene = watched._panel, watched._scene
    assert "Stand on your right leg." in panel._guide.content
    assert ">2<" in panel._guide.content
    assert (panel._guide.visible, panel._cancel.visible, panel._record.visible) == (True, True, False)
    assert scene._guide._place.visible
    np.testing.assert_allclose(scene._guide._nodes[0].position, guided_pose("left-heel").q[:3])
    computing = CalibrationProgress("", "", "", "computing", 0.0, 8, 8)
    watched.show(update_of(facts, 1, calibration=computing))
    assert not scene._guide._place.visible
    watched.show(update_of(facts, 2))
    assert (panel._guide.visible, panel._cancel.visible, panel._record.visible) == (False, False, True)


def test_nothing_is_drawn_while_nobody_looks_and_not_faster_than_can_be_seen(monkeypatch: pytest.MonkeyPatch):
    facts, clock = facts_of("six-trackers"), [0.0]  # a machine that was switched on just now
    monkeypatch.setattr("poseloom.viewer.session.time.monotonic", lambda: clock[0])
    viewer = SessionViewer(port=0, frame_rate=40.0)
    try:
        viewer.open(facts, lambda _command: None)
        viewer.show(update_of(facts, 0))
        assert viewer.frames == 0
        viewer._server.viser.get_clients = lambda: {0: visitor()}
        for number in range(50):
            viewer.show(update_of(facts, number))
        assert viewer.frames == 1
        for number in range(50, 100):
            clock[0] += 0.01
            viewer.show(update_of(facts, number))
        assert viewer.frames == 17
        assert len(viewer._plots._latency.lines()[0]) > 5
    finally:
        viewer.close()


def test_a_viewer_that_cannot_be_built_stops_listening(monkeypatch: pytest.MonkeyPatch):
    viewer = SessionViewer(port=0)
    port = viewer._server.viser.get_port()
    monkeypatch.setattr("poseloom.viewer.session.LivePanel", Mock(side_effect=ValueError("no panel")))
    with pytest.raises(ValueError, match="no panel"):
        viewer.open(facts_of("six-trackers"), lambda _command: None)
    with pytest.raises(ConnectionRefusedError):
        http.client.HTTPConnection("127.0.0.1", port, timeout=2).request("GET", "/")


def test_twenty_visits_leave_nothing_behind(guarded: OpenServer):
    server = guarded.viser._websock_server
    cookie = f"poseloom-{guarded.viser.get_port()}={guarded.access.token}"
    kept = len(server._broadcast_buffer.message_from_id)
    threads = threading.active_count()
    for _ in range(20):
        with dial(guarded, Cookie=cookie) as visitor:
            assert len(visitor.recv(timeout=60)) > 100
    deadline = time.monotonic() + 60
    while server._client_state_from_id and time.monotonic() < deadline:
        time.sleep(0.02)
    assert server._client_state_from_id == {}
    assert server._broadcast_buffer.generator_cursors == {}
    # Less than one a visit: what the server still set up when counting began is no leak.
    assert len(server._broadcast_buffer.message_from_id) < kept + 20
    assert threading.active_count() < threads + 20


# --- the command -----------------------------------------------------------------------------------------------------


def test_the_command_says_where_to_look_serves_it_and_ends_quietly(walk_file: Path):
    command = [sys.executable, "-m", "poseloom", "view", str(walk_file), "--port", "0"]
    # Who starts the tests in the background may have them ignore Ctrl-C, and children with them.
    heeding = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, preexec_fn=heeding) as process:
        try:
            assert process.stdout is not None
            address = re.search(r"http://127\.0\.0\.1:(\d+)/", process.stdout.readline())
            if address:
                connection = http.client.HTTPConnection("127.0.0.1", int(address[1]), timeout=10)
                connection.request("GET", "/")
                assert connection.getresponse().status == 200
            process.send_signal(signal.SIGINT)
            rest, errors = process.communicate(timeout=60)
        finally:
            process.kill()
    assert address, errors
    assert process.returncode == 0
    assert "Ended." in rest
    assert "Traceback" not in errors


def test_the_command_tells_what_cannot_be_shown(capsys: pytest.CaptureFixture[str], tmp_path: Path):
    assert run(["view", str(tmp_path / "none.mcap")]) == 2
    assert "there is no such file" in capsys.readouterr().err
    assert run(["view", "sample:walk", "-m", "inverse-kinematics"]) == 2
    assert "needs a recording" in capsys.readouterr().err
    assert run(["view", "sample:walk", "--bind", "203.0.113.5"]) == 2
    assert "cannot listen" in capsys.readouterr().err


def test_a_page_that_changes_its_shape_is_framed_anew_unless_the_camera_was_moved(scene: viser.ViserServer):
    stage, client = Stage(scene), visitor()
    camera = client.camera
    camera.position = np.array([3.0, 3.0, 3.0])
    stage._welcome(client)
    first = camera.position
    # The panel takes its place before the camera has come to where it was sent.
    camera.position, camera.image_width = np.array([3.0, 3.0, 3.0]), 956
    stage._looked(client)
    np.testing.assert_allclose(camera.position, framing(956, 800).position)
    stage._looked(client)
    camera.image_width, camera.image_height = 390, 844
    stage._looked(client)
    np.testing.assert_allclose(camera.position, framing(390, 844).position)
    assert not np.allclose(camera.position, first)
    stage._looked(client)
    camera.position = moved = np.array([0.0, 5.0, 0.1])
    stage._looked(client)
    camera.image_width, camera.image_height = 844, 390
    stage._looked(client)
    np.testing.assert_array_equal(camera.position, moved)
