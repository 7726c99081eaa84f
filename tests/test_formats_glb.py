"""GLB: read with pygltflib and moved by hand, its animation is the motion and its body a closed surface around it."""

import contextlib
import json
import struct
from pathlib import Path

import numpy as np
import pygltflib
import pytest
from scipy.spatial.transform import Rotation

from poseloom.errors import FormatError, PoseloomError
from poseloom.formats.deepmimic import deepmimic_skeleton
from poseloom.formats.glb import write_glb
from poseloom.formats.glb_reading import read_glb
from poseloom.skeleton.body import average_body
from poseloom.skeleton.kinematics import motion_frames
from poseloom.skeleton.motion import Motion, make_motion
from poseloom.skeleton.skeleton import Skeleton, make_skeleton

WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TYPES = {pygltflib.FLOAT: np.float32, pygltflib.UNSIGNED_SHORT: np.uint16, pygltflib.UNSIGNED_INT: np.uint32}


def lively(skeleton: Skeleton, frames: int = 25, moving: bool = False) -> Motion:
    rng = np.random.default_rng(len(skeleton))
    q = rng.normal(size=skeleton.size) + np.cumsum(rng.normal(size=(frames, skeleton.size)) * 0.2, axis=0)
    q[:, 12:15] = 0.3  # a joint that never turns
    moves = rng.normal(size=(frames, len(skeleton), 3)) * 0.05 if moving else None
    if moves is not None:
        moves[:, ::2] = 0
    return make_motion(skeleton, q, 30.0, "lively", moves)


def values(document: pygltflib.GLTF2, index: int) -> np.ndarray:
    accessor = document.accessors[index]
    view = document.bufferViews[accessor.bufferView]
    width = WIDTHS[accessor.type]
    kind = TYPES[accessor.componentType]
    assert view.byteOffset % 4 == 0
    assert view.byteLength == accessor.count * width * np.dtype(kind).itemsize
    array = np.frombuffer(document.binary_blob(), kind, accessor.count * width, view.byteOffset)
    array = array.reshape(accessor.count, width)
    if accessor.min:
        np.testing.assert_array_equal(array.min(axis=0), np.array(accessor.min, dtype=kind))
        np.testing.assert_array_equal(array.max(axis=0), np.array(accessor.max, dtype=kind))
    return array


def world_matrices(document: pygltflib.GLTF2, frame: int) -> dict[int, np.ndarray]:
    """World matrices of all nodes at a frame, by the definition of glTF 2.0."""
    places = {i: np.array(node.translation or (0, 0, 0)) for i, node in enumerate(document.nodes)}
    turns = {i: np.array(node.rotation or (0, 0, 0, 1)) for i, node in enumerate(document.nodes)}
    (animation,) = document.animations
    for channel in animation.channels:
        sampler = animation.samplers[channel.sampler]
        assert sampler.interpolation == "LINEAR"
        moved = places if channel.target.path == "translation" else turns
        moved[channel.target.node] = values(document, sampler.output)[frame]
    world: dict[int, np.ndarray] = {}

    def visit(node: int, parent: np.ndarray) -> None:
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = Rotation.from_quat(turns[node]).as_matrix(), places[node]
        world[node] = parent @ local
        for child in document.nodes[node].children or []:
            visit(child, world[node])

    for root in document.scenes[document.scene].nodes:
        visit(root, np.eye(4))
    return world


def written(motion: Motion, folder: Path) -> pygltflib.GLTF2:
    write_glb(motion, folder / "motion.glb")
    return pygltflib.GLTF2().load(str(folder / "motion.glb"))


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("skeleton", [average_body(), deepmimic_skeleton()], ids=["body", "humanoid"])
def test_the_animation_is_the_motion(tmp_path, skeleton, moving):
    motion = lively(skeleton, moving=moving)
    document = written(motion, tmp_path)
    expected = motion_frames(motion)
    for frame in (0, 7, 24):
        world = world_matrices(document, frame)
        for joint, name in enumerate(skeleton.names):
            assert document.nodes[joint].name == name
            np.testing.assert_allclose(world[joint][:3, 3], expected.positions[frame, joint], atol=2e-6)
            np.testing.assert_allclose(world[joint][:3, :3], expected.rotations[frame, joint], atol=2e-6)
    (animation,) = document.animations
    times = values(document, animation.samplers[0].input)[:, 0]
    np.testing.assert_allclose(times, np.arange(25) / 30, rtol=1e-6)
    for channel in animation.channels:
        if channel.target.path == "rotation":
            quats = values(document, animation.samplers[channel.sampler].output)
            np.testing.assert_allclose(np.linalg.norm(quats, axis=1), 1, atol=1e-6)
            assert (np.sum(quats[1:] * quats[:-1], axis=1) > 0).all()


def test_joints_that_never_turn_have_no_channel(tmp_path):
    document = written(lively(average_body()), tmp_path)
    turning = {c.target.node for c in document.animations[0].channels if c.target.path == "rotation"}
    assert turning == set(range(22)) - {3}


def skinned(document: pygltflib.GLTF2, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices of the body at a frame, its triangles, and the joint of each vertex."""
    (primitive,) = document.meshes[0].primitives
    vertices = values(document, primitive.attributes.POSITION)
    joints = values(document, primitive.attributes.JOINTS_0)
    weights = values(document, primitive.attributes.WEIGHTS_0)
    normals = values(document, primitive.attributes.NORMAL)
    triangles = values(document, primitive.indices).reshape(-1, 3)
    assert (weights == [1, 0, 0, 0]).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    (skin,) = document.skins
    binds = values(document, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    world = world_matrices(document, frame)
    moves = np.stack([world[node] @ bind for node, bind in zip(skin.joints, binds, strict=True)])[joints[:, 0]]
    places = np.einsum("vab,vb->va", moves[:, :3, :3], vertices) + moves[:, :3, 3]
    return places, triangles, joints[:, 0]


@pytest.mark.parametrize("skeleton", [average_body(), deepmimic_skeleton()], ids=["body", "humanoid"])
def test_the_body_is_a_body(tmp_path, skeleton):
    """As wide and tall as the skeleton with flesh on it, closed, turned outside, and as heavy as a person."""
    rest = make_motion(skeleton, np.zeros((1, skeleton.size)), 30.0, "rest")
    places, triangles, joints = skinned(written(rest, tmp_path), 0)
    ends = skeleton.rest_positions() + np.where(np.isfinite(skeleton.tips), skeleton.tips, 0)
    low, high = ends.min(axis=0), ends.max(axis=0)
    assert (places.min(axis=0) < low + 0.03).all()
    assert (places.min(axis=0) > low - 0.15).all()
    assert (places.max(axis=0) > high - 0.03).all()
    assert (places.max(axis=0) < high + 0.15).all()
    assert set(joints.tolist()) >= {j for j in range(len(skeleton)) if not skeleton.children(j)}
    corners = places[triangles].astype(float)
    volumes = np.einsum("ta,ta->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert 0.02 < volumes.sum() < 0.12
    # Each piece is closed: every edge is walked once in each direction, by place (poles are rings of one place).
    spots = np.unique(np.round(places[triangles], 6).reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(-1, 3)
    edges = np.concatenate([spots[:, [0, 1]], spots[:, [1, 2]], spots[:, [2, 0]]])
    forth = np.unique(edges, axis=0, return_counts=True)
    back = np.unique(edges[:, ::-1], axis=0, return_counts=True)
    np.testing.assert_array_equal(forth[0], back[0])
    np.testing.assert_array_equal(forth[1], back[1])


def test_the_body_goes_with_its_bones(tmp_path):
    motion = lively(average_body())
    document = written(motion, tmp_path)
    frames = motion_frames(motion)
    for frame in (3, 20):
        places, _, joints = skinned(document, frame)
        apart = np.linalg.norm(places - frames.positions[frame, joints], axis=1)
        assert apart.max() < 0.6
        hand = average_body().index("leftHand")
        tip = frames.positions[frame, hand] + frames.rotations[frame, hand] @ average_body().tips[hand]
        assert np.linalg.norm(places - tip, axis=1).min() < 0.03


def test_skeletons_that_are_no_person(tmp_path):
    point = make_skeleton(["point"], [-1], [[0, 0, 0]])
    document = written(make_motion(point, np.ones((1, 6)), 30.0), tmp_path)
    assert not document.meshes
    stick = make_skeleton(["a", "b"], [-1, 0], [[0, 0, 0], [0, 0, 2]])
    places, _, _ = skinned(written(make_motion(stick, np.zeros((3, 9)), 30.0), tmp_path), 1)
    assert 1.9 < np.ptp(places[:, 2]) < 2.6
    prop = np.array([0.0, 0.0, 3.0])
    body = average_body()
    tips = np.where(np.arange(22)[:, None] == body.index("rightHand"), prop, body.tips)
    holding = body.with_offsets(body.offsets, tips)
    places, _, _ = skinned(written(make_motion(holding, np.zeros((1, body.size)), 30.0), tmp_path), 0)
    assert np.ptp(places[:, 2]) < 0.5


def test_the_container(tmp_path):
    """Magic, version, length and aligned chunks, as glTF 2.0 has them in section 4.4; no empty field."""
    write_glb(lively(average_body()), tmp_path / "motion.glb")
    content = (tmp_path / "motion.glb").read_bytes()
    magic, version, length, size, kind = struct.unpack("<4sIII4s", content[:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(content), b"JSON")
    assert size % 4 == 0
    document = json.loads(content[20 : 20 + size])
    binary, kind = struct.unpack("<I4s", content[20 + size : 28 + size])
    assert kind == b"BIN\x00"
    assert binary % 4 == 0
    assert 28 + size + binary == len(content)
    assert document["asset"]["version"] == "2.0"
    assert document["buffers"] == [{"byteLength": binary}]
    assert document["skins"][0]["joints"] == list(range(22))
    assert "null" not in content[20 : 20 + size].decode()


def test_the_same_motion_gives_the_same_bytes_and_no_leftovers(tmp_path):
    write_glb(lively(average_body()), tmp_path / "one.glb")
    write_glb(lively(average_body()), tmp_path / "two.glb")
    assert (tmp_path / "one.glb").read_bytes() == (tmp_path / "two.glb").read_bytes()
    with pytest.raises(FormatError, match="cannot be written"):
        write_glb(lively(average_body()), tmp_path / "missing" / "one.glb")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["one.glb", "two.glb"]


@pytest.mark.parametrize("moving", [False, True])
def test_what_was_written_is_read_back(tmp_path: Path, moving: bool):
    for skeleton in (average_body(), deepmimic_skeleton()):
        motion = lively(skeleton, moving=moving)
        write_glb(motion, tmp_path / "lively.glb")
        read = read_glb(tmp_path / "lively.glb")
        assert (read.skeleton.names, read.rate, read.name) == (skeleton.names, 30.0, "lively")
        assert (read.skeleton.parents == skeleton.parents).all()
        expected, found = motion_frames(motion), motion_frames(read)
        np.testing.assert_allclose(found.positions, expected.positions, atol=1e-5)
        np.testing.assert_allclose(found.rotations, expected.rotations, atol=1e-5)


def test_a_glb_file_that_is_cut_garbled_or_another_programs_is_refused(tmp_path: Path):
    path = tmp_path / "motion.glb"
    write_glb(lively(average_body(), frames=3), path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for size in (0, 4, 11, 12, 19, 20, 200, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(FormatError, match=r"motion\.glb"):
            read_glb(path)
    for _ in range(200):
        damaged = bytearray(whole)
        at = int(rng.integers(0, 3000))
        damaged[at] = int(rng.integers(0, 256))
        path.write_bytes(damaged)
        with contextlib.suppress(PoseloomError):  # a changed number may still be a motion, but nothing else may happen
            read_glb(path)
    path.write_bytes(whole.replace(b'"generator":"poseloom"', b'"generator":"another "'))
    with pytest.raises(FormatError, match="another program's"):
        read_glb(path)
    with pytest.raises(FormatError, match="no such file"):
        read_glb(tmp_path / "none.glb")
