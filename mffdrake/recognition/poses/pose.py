"""The target's pose as a vector, its rate and its transport: equations (1)-(12).

A pose vector is ``psi = (r, eps)``: the target's position ``r`` [m] in the right camera's frame C
and the vector part ``eps`` of the unit quaternion of ``R_CM``; the scalar part is
``eta = sqrt(1 - eps.eps) >= 0``. Every function takes one pose ``(6,)`` or many ``(..., 6)``.

Where the paper's equations are wrong, the corrected form stands here, and the docstring says so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def skew(omega: ArrayLike) -> Array:
    """Cross-product matrix, Eq. (3): ``skew(a) @ b == cross(a, b)``.

    Args:
        omega: Vectors, shape (..., 3).

    Returns:
        Matrices, shape (..., 3, 3).

    Example:
        >>> skew([0.0, 0.0, 1.0]) @ np.array([1.0, 0.0, 0.0])
        array([0., 1., 0.])
    """
    w = np.asarray(omega, dtype=float)
    S = np.zeros((*w.shape, 3))
    S[..., 0, 1], S[..., 0, 2] = -w[..., 2], w[..., 1]
    S[..., 1, 0], S[..., 1, 2] = w[..., 2], -w[..., 0]
    S[..., 2, 0], S[..., 2, 1] = -w[..., 1], w[..., 0]
    return S


def quaternion_scalar(eps: ArrayLike) -> Array:
    """Scalar part ``eta >= 0`` of the unit quaternion with vector part ``eps``.

    Args:
        eps: Vector parts, shape (..., 3); a norm above 1 is taken as 1.

    Returns:
        Scalar parts in [0, 1], shape (...).

    Example:
        >>> float(quaternion_scalar([0.6, 0.0, 0.0]))
        0.8
    """
    e = np.asarray(eps, dtype=float)
    return np.asarray(np.sqrt(np.maximum(0.0, 1.0 - np.einsum("...i,...i", e, e))))


def rotation_matrix(eps: ArrayLike) -> Array:
    """Rotation matrix ``R_CM`` of a quaternion's vector part.

    Args:
        eps: Vector parts, shape (..., 3), of norm at most 1.

    Returns:
        Rotation matrices, shape (..., 3, 3).

    Example:
        >>> bool(np.allclose(rotation_matrix([0.0, 0.0, 0.0]), np.eye(3)))
        True
    """
    e = np.asarray(eps, dtype=float)
    eta = quaternion_scalar(e)
    S = skew(e)
    # R = I + 2 eta S(eps) + 2 S(eps)^2
    return np.asarray(np.eye(3) + 2.0 * eta[..., None, None] * S + 2.0 * S @ S)


def quaternion_vector(R: ArrayLike) -> Array:
    """Vector part of the unit quaternion (with ``eta >= 0``) of rotation matrices.

    Args:
        R: Rotation matrices, shape (..., 3, 3).

    Returns:
        Vector parts, shape (..., 3).

    Example:
        >>> quaternion_vector(np.diag([1.0, -1.0, -1.0]))
        array([1., 0., 0.])
    """
    R = np.asarray(R, dtype=float)
    # 4 q q^T; the row of its largest diagonal entry gives q most precisely (Shepperd).
    rows = R.reshape(*R.shape[:-2], 9) @ _QUATERNION_PRODUCTS + np.eye(4).reshape(16)
    best = np.argmax(rows[..., ::5], axis=-1)
    q = np.take_along_axis(rows.reshape(*R.shape[:-2], 4, 4), best[..., None, None], axis=-2)
    q = q[..., 0, :]
    # Of unit length and with a positive scalar part
    norm = np.copysign(np.sqrt(np.einsum("...i,...i", q, q)), q[..., 0])
    return np.asarray(q[..., 1:] / norm[..., None])


def _quaternion_products() -> Array:
    """The linear map from R's nine entries to the 16 of 4 q q^T less the identity, (9, 16)."""
    R = np.eye(9).reshape(9, 3, 3)  # each entry alone
    xx, yy, zz = R[:, 0, 0], R[:, 1, 1], R[:, 2, 2]
    a, b, c = R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]
    d, e, f = R[:, 0, 1] + R[:, 1, 0], R[:, 0, 2] + R[:, 2, 0], R[:, 1, 2] + R[:, 2, 1]
    return np.stack(
        [
            xx + yy + zz, a, b, c,
            a, xx - yy - zz, d, e,
            b, d, -xx + yy - zz, f,
            c, e, f, -xx - yy + zz,
        ],
        axis=-1,
    )  # fmt: skip


_QUATERNION_PRODUCTS = _quaternion_products()


def compose_quaternion_vectors(a: ArrayLike, b: ArrayLike) -> Array:
    """Vector part of the product of two unit quaternions, each given by its vector part.

    Args:
        a: Left factors, shape (..., 3).
        b: Right factors, shape (..., 3), broadcast against ``a``.

    Returns:
        Vector parts, with the sign that makes the scalar part positive, shape (..., 3).

    Example:
        >>> compose_quaternion_vectors([0.6, 0.0, 0.0], [-0.6, 0.0, 0.0])
        array([0., 0., 0.])
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    a0, b0 = quaternion_scalar(a)[..., None], quaternion_scalar(b)[..., None]
    scalar = a0 * b0 - np.einsum("...i,...i", a, b)[..., None]
    vector = a0 * b + b0 * a + (skew(a) @ b[..., None])[..., 0]
    return np.asarray(np.where(scalar < 0, -vector, vector))


def pose_from_transform(R_CM: ArrayLike, p_CM: ArrayLike) -> Array:
    """Pose vector of a rigid transform.

    Args:
        R_CM: Rotation matrices, shape (..., 3, 3).
        p_CM: Positions [m], shape (..., 3).

    Returns:
        Pose vectors ``(r [m], eps)``, shape (..., 6).

    Example:
        >>> pose_from_transform(np.eye(3), [0.0, 0.155, 0.8])
        array([0.   , 0.155, 0.8  , 0.   , 0.   , 0.   ])
    """
    return np.concatenate([np.asarray(p_CM, dtype=float), quaternion_vector(R_CM)], axis=-1)


def transform_from_pose(psi: ArrayLike) -> tuple[Array, Array]:
    """Rotation matrix and position of a pose vector, Eq. (13)'s transform.

    Args:
        psi: Pose vectors, shape (..., 6).

    Returns:
        ``(R_CM, p_CM)``, shapes (..., 3, 3) and (..., 3).

    Example:
        >>> transform_from_pose(np.zeros(6))[1]
        array([0., 0., 0.])
    """
    psi = np.asarray(psi, dtype=float)
    return rotation_matrix(psi[..., 3:]), psi[..., :3]


def target_position_in_camera(R_WC: ArrayLike, p_WC: ArrayLike, p_WM: ArrayLike) -> Array:
    """Target's position in the camera, Eq. (1): ``p_CM = R_CW (p_WM - p_WC)`` [m].

    Args:
        R_WC: Camera's orientation, shape (3, 3).
        p_WC: Camera's position [m], shape (3,).
        p_WM: Target's position [m], shape (3,).

    Returns:
        The position [m], shape (3,).

    Example:
        >>> target_position_in_camera(np.eye(3), [0, 0, 1.0], [0, 0, 3.0])
        array([0., 0., 2.])
    """
    R_CW = np.asarray(R_WC, dtype=float).T
    return np.asarray(R_CW @ (np.asarray(p_WM, dtype=float) - np.asarray(p_WC, dtype=float)))


def rotation_angle(eps_a: ArrayLike, eps_b: ArrayLike) -> Array:
    """Angle [rad] between two quaternions' vector parts, the rotation's share of Eq. (28).

    Args:
        eps_a: Vector parts, shape (..., 3).
        eps_b: Vector parts, shape (..., 3).

    Returns:
        Angles in [0, pi], shape (...).

    Example:
        >>> round(float(rotation_angle([0, 0, 0], [np.sin(0.1), 0, 0])), 6)
        0.2
    """
    a, b = np.asarray(eps_a, dtype=float), np.asarray(eps_b, dtype=float)
    a0, b0 = quaternion_scalar(a), quaternion_scalar(b)
    less, more = a - b, a + b
    # Of unit quaternions a and b, |a - b| = 2 sin(angle / 4) and |a + b| = 2 cos(angle / 4); or the
    # other way round, where -b is nearer to a.
    one = np.sqrt((a0 - b0) ** 2 + np.einsum("...i,...i", less, less))
    other = np.sqrt((a0 + b0) ** 2 + np.einsum("...i,...i", more, more))
    return np.asarray(4.0 * np.arctan2(np.minimum(one, other), np.maximum(one, other)))


def pose_errors(psi: ArrayLike, other: ArrayLike) -> tuple[Array, Array]:
    """How far poses are apart: the rotation's and the position's share of Eq. (28).

    Args:
        psi: Pose vectors ``(r [m], eps)``, shape (..., 6).
        other: Pose vectors, broadcast against them.

    Returns:
        Distances [m] and angles [rad], each of shape (...).

    Example:
        >>> distance, angle = pose_errors([0, 0, 0.8, 0, 0, 0], [0.003, 0, 0.8, np.sin(0.1), 0, 0])
        >>> round(float(distance), 6), round(float(angle), 6)
        (0.003, 0.2)
    """
    a, b = np.asarray(psi, dtype=float), np.asarray(other, dtype=float)
    distances = np.linalg.norm(a[..., :3] - b[..., :3], axis=-1)
    return np.asarray(distances), rotation_angle(a[..., 3:], b[..., 3:])
