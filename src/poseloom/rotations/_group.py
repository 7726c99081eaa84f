"""Composition, distance, interpolation, means and branches of rotations."""

import numpy as np

from poseloom.arrays import Array, Floats
from poseloom.rotations._convert import matrix_from_rotvec, quat_from_rotvec, rotvec_from_quat


def quat_multiply(first: Floats[Array, "*#batch 4"], second: Floats[Array, "*#batch 4"]) -> Floats[Array, "*batch 4"]:
    """The product first * second of quaternions `wxyz`: `second` acts first on a vector."""
    w1, x1, y1, z1 = np.moveaxis(first, -1, 0)
    w2, x2, y2, z2 = np.moveaxis(second, -1, 0)
    return np.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        axis=-1,
    )


def quat_conjugate(quat_wxyz: Floats[Array, "*batch 4"]) -> Floats[Array, "*batch 4"]:
    """The inverse of unit quaternions."""
    return quat_wxyz * np.array([1.0, -1.0, -1.0, -1.0])


def quat_rotate(quat_wxyz: Floats[Array, "*#batch 4"], vector: Floats[Array, "*#batch 3"]) -> Floats[Array, "*batch 3"]:
    """Vectors turned by unit quaternions."""
    axis = quat_wxyz[..., 1:]
    twice = 2 * np.cross(axis, vector)
    return vector + quat_wxyz[..., :1] * twice + np.cross(axis, twice)


def geodesic_angle(first: Floats[Array, "*#batch 4"], second: Floats[Array, "*#batch 4"]) -> Floats[Array, "*batch"]:
    """Angle in [0, pi] of the rotation between two unit quaternions.

    The sine of the half angle serves, not only the cosine: near zero the latter has no digits left.
    """
    difference = quat_multiply(quat_conjugate(first), second)
    return np.asarray(2 * np.arctan2(np.linalg.norm(difference[..., 1:], axis=-1), np.abs(difference[..., 0])))


def slerp(
    first: Floats[Array, "*batch 4"], second: Floats[Array, "*batch 4"], fraction: Floats[Array, "*batch"]
) -> Floats[Array, "*batch 4"]:
    """The rotation at `fraction` (0 to 1) of the shorter way from first to second."""
    step = rotvec_from_quat(quat_multiply(quat_conjugate(first), second))
    return quat_multiply(first, quat_from_rotvec(fraction[..., None] * step))


def mean_quat(
    quat_wxyz: Floats[Array, "*batch count 4"], weights: Floats[Array, "*batch count"]
) -> Floats[Array, "*batch 4"]:
    """Weighted mean rotation: the quaternion that maximises the weighted sum of squared scalar products.

    Source: Markley et al., Averaging quaternions, 2007, eq. 13. Signs of the inputs do not matter.
    """
    outer = np.einsum("...n,...ni,...nj->...ij", weights, quat_wxyz, quat_wxyz)
    mean = np.linalg.eigh(outer)[1][..., -1]
    return np.where(mean[..., :1] < 0, -mean, mean)


def nearest_branch(
    rotvec: Floats[Array, "*batch 3"], reference: Floats[Array, "*batch 3"]
) -> Floats[Array, "*batch 3"]:
    """The rotation vectors that turn the same and lie nearest to `reference`: whole turns about the axis are added.

    Where the rotation is nil its axis is taken from the reference.
    """
    angle = np.asarray(np.linalg.norm(rotvec, axis=-1, keepdims=True))
    size = np.asarray(np.linalg.norm(reference, axis=-1, keepdims=True))
    still = angle < 1e-12
    axis = np.where(still, reference / np.where(size < 1e-12, 1.0, size), rotvec / np.where(still, 1.0, angle))
    along = np.asarray(np.sum(axis * reference, axis=-1, keepdims=True))
    return rotvec + axis * (2 * np.pi * np.round((along - angle) / (2 * np.pi)))


def unwrap_rotvec(rotvec: Floats[Array, "frames *batch 3"]) -> Floats[Array, "frames *batch 3"]:
    """A time series in which each rotation vector is on the branch nearest to the frame before."""
    out = np.array(rotvec, dtype=np.float64)
    if len(out) < 2:
        return out
    # A branch can change only where the angle comes near half a turn; elsewhere the input stands.
    risky = np.flatnonzero(
        (np.linalg.norm(np.diff(out, axis=0), axis=-1) > 0.9 * np.pi).reshape(len(out) - 1, -1).any(axis=1)
    )
    if risky.size == 0:
        return out
    for frame in range(int(risky[0]) + 1, len(out)):
        out[frame] = nearest_branch(out[frame], out[frame - 1])
    return out


def heading_angle(quat_wxyz: Floats[Array, "*batch 4"]) -> Floats[Array, "*batch"]:
    """The turn about world up (Y) in the rotation, in radians in (-pi, pi]: the twist of the swing-twist split.

    Unlike the direction of a projected forward axis it is defined for a body that lies; only upside down it is not.
    """
    angle = 2 * np.arctan2(quat_wxyz[..., 2], quat_wxyz[..., 0])
    return np.asarray(np.pi - np.mod(np.pi - angle, 2 * np.pi))


def heading_matrix(angle: Floats[Array, "*batch"]) -> Floats[Array, "*batch 3 3"]:
    """The rotation about world up (Y) by an angle."""
    rotvec = np.zeros((*angle.shape, 3))
    rotvec[..., 1] = angle
    return matrix_from_rotvec(rotvec)


def aligning_matrix(source: Floats[Array, "3"], target: Floats[Array, "3"]) -> Floats[Array, "3 3"]:
    """The smallest rotation that turns the direction `source` into the direction `target`."""
    a = source / np.linalg.norm(source)
    b = target / np.linalg.norm(target)
    cross = np.cross(a, b)
    sine = float(np.linalg.norm(cross))
    cosine = float(a @ b)
    if sine < 1e-12:
        if cosine > 0:
            return np.eye(3)
        helper = np.eye(3)[int(np.argmin(np.abs(a)))]
        axis = np.cross(a, helper)
        return matrix_from_rotvec(np.pi * axis / np.linalg.norm(axis))
    return matrix_from_rotvec(cross / sine * np.arctan2(sine, cosine))
