"""Kinematics and Jacobians against mujoco and against finite differences."""

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from poseloom.rotations import matrix_from_rotvec, quat_from_rotvec, right_jacobian, rotvec_from_matrix
from poseloom.skeleton import (
    average_body,
    bone_points,
    forward_kinematics,
    make_motion,
    make_skeleton,
    motion_frames,
    point_jacobians,
)

BODY = average_body()
MARKED = [BODY.index(name) for name in ("head", "upperChest", "leftHand", "rightHand", "leftLowerLeg", "rightFoot")]


def body_xml() -> str:
    """The body as mujoco's model: a free root and a ball for each further joint."""

    def bone(i: int) -> str:
        joint = "<freejoint/>" if i == 0 else '<joint type="ball"/>'
        children = "".join(bone(child) for child in BODY.children(i))
        place = " ".join(repr(float(x)) for x in BODY.offsets[i])
        mass = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        return f'<body name="{BODY.names[i]}" pos="{place}">{joint}{mass}{children}</body>'

    return f'<mujoco><option gravity="0 0 0"/><worldbody>{bone(0)}</worldbody></mujoco>'


class Oracle:
    """The body in mujoco."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(body_xml())
        self.data = mujoco.MjData(self.model)
        self.ids = [self.model.body(name).id for name in BODY.names]

    def place(self, q: np.ndarray) -> None:
        """Takes on the pose of a pose vector."""
        self.data.qpos[:3] = q[:3]
        turns = q[3:].reshape(-1, 3)
        for i, body in enumerate(self.ids):
            start = 3 if i == 0 else self.model.jnt_qposadr[self.model.body_jntadr[body]]
            self.data.qpos[start : start + 4] = quat_from_rotvec(turns[i])
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def jacobians(self, q: np.ndarray, bone: int, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Jacobians by the pose vector: mujoco's are by angular velocities in each bone's axes, J_r(w) dw."""
        linear, angular = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, linear, angular, point, self.ids[bone])
        out = np.zeros((2, 3, BODY.size))
        for k, jacobian in enumerate((linear, angular)):
            out[k, :, :3] = jacobian[:, :3]
            for i, body in enumerate(self.ids):
                dof = 3 if i == 0 else self.model.jnt_dofadr[self.model.body_jntadr[body]]
                turns = right_jacobian(q[3 + 3 * i : 6 + 3 * i])
                out[k, :, 3 + 3 * i : 6 + 3 * i] = jacobian[:, dof : dof + 3] @ turns
        return out[0], out[1]


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    return Oracle()


def random_pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.normal(size=3), rng.normal(scale=0.9, size=BODY.size - 3)])


@pytest.mark.parametrize("seed", range(10))
def test_forward_kinematics_agrees_with_mujoco(oracle, seed):
    q = random_pose(seed)
    oracle.place(q)
    frames = forward_kinematics(BODY, q)
    np.testing.assert_allclose(frames.positions, oracle.data.xpos[oracle.ids], atol=1e-12)
    np.testing.assert_allclose(frames.rotations, oracle.data.xmat[oracle.ids].reshape(-1, 3, 3), atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_jacobians_agree_with_mujoco(oracle, seed):
    q = random_pose(100 + seed)
    locals_ = np.random.default_rng(seed).normal(scale=0.1, size=(len(MARKED), 3))
    found = point_jacobians(BODY, q, np.array(MARKED), locals_)
    oracle.place(q)
    for i, bone in enumerate(MARKED):
        linear, angular = oracle.jacobians(q, bone, found.points[i])
        np.testing.assert_allclose(found.linear[i], linear, atol=1e-11)
        np.testing.assert_allclose(found.angular[i], angular, atol=1e-11)


@settings(max_examples=15)
@given(arrays(np.float64, BODY.size, elements=st.floats(-2.0, 2.0)))
def test_jacobians_against_finite_differences(q):
    locals_ = np.full((len(MARKED), 3), 0.07)
    found = point_jacobians(BODY, q, np.array(MARKED), locals_)
    step = 1e-6
    for column in range(BODY.size):
        shift = np.zeros(BODY.size)
        shift[column] = step
        ahead, behind = (point_jacobians(BODY, q + sign * shift, np.array(MARKED), locals_) for sign in (1, -1))
        np.testing.assert_allclose(found.linear[..., column], (ahead.points - behind.points) / (2 * step), atol=1e-8)
        turned = rotvec_from_matrix(ahead.rotations @ np.swapaxes(behind.rotations, 1, 2)) / (2 * step)
        np.testing.assert_allclose(found.angular[..., column], turned, atol=1e-8)


@settings(max_examples=20)
@given(arrays(np.float64, BODY.size, elements=st.floats(-3.0, 3.0)), st.floats(-3, 3))
def test_turning_the_root_turns_everything(q, angle):
    turn = matrix_from_rotvec(np.array([0.0, angle, 0.0]))
    moved = q.copy()
    moved[:3] = turn @ q[:3]
    moved[3:6] = rotvec_from_matrix(turn @ matrix_from_rotvec(q[3:6]))
    before, after = forward_kinematics(BODY, q), forward_kinematics(BODY, moved)
    np.testing.assert_allclose(after.positions, before.positions @ turn.T, atol=1e-10)
    np.testing.assert_allclose(after.rotations, turn @ before.rotations, atol=1e-9)
    lengths = np.linalg.norm(np.diff(before.positions[[0, 14, 15, 16]], axis=0), axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(BODY.offsets[[14, 15, 16]], axis=1), atol=1e-12)


def test_a_motion_is_its_frames():
    q = np.stack([random_pose(seed) for seed in range(5)])
    frames = motion_frames(make_motion(BODY, q, 60.0))
    for i in range(5):
        one = forward_kinematics(BODY, q[i])
        np.testing.assert_array_equal(frames.positions[i], one.positions)
        np.testing.assert_array_equal(frames.rotations[i], one.rotations)
        point = np.array([0.1, -0.2, 0.3])
        expected = one.positions[7] + one.rotations[7] @ point
        np.testing.assert_allclose(bone_points(one, 7, point), expected)
        np.testing.assert_allclose(bone_points(frames, 7, point)[i], expected)


def test_displacements_move_joints_in_their_parents_frames():
    skeleton = make_skeleton(["a", "b"], [-1, 0], [[0, 0, 0], [1, 0, 0]])
    q = np.zeros((2, 9))
    q[:, 3:6] = [0, 0, np.pi / 2]
    moved = np.zeros((2, 2, 3))
    moved[1, 1] = [0.5, 0, 0]
    frames = motion_frames(make_motion(skeleton, q, 30.0, displacements=moved))
    np.testing.assert_allclose(frames.positions[:, 1], [[0, 1, 0], [0, 1.5, 0]], atol=1e-12)
