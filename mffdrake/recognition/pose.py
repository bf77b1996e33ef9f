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


def quaternion_rate_matrix(eps: ArrayLike) -> Array:
    """Matrix ``1/2 (eta I - S(eps))`` of Eq. (6) and (A.8).

    It maps the angular velocity ``w_CM_C``, expressed in the observing frame C, to the rate of
    ``eps``. (The paper calls that velocity the body's; expressed in M the sign of S would flip.)

    Args:
        eps: Vector parts, shape (..., 3).

    Returns:
        Matrices, shape (..., 3, 3).

    Example:
        >>> quaternion_rate_matrix([0.0, 0.0, 0.0])[0, 0]
        np.float64(0.5)
    """
    e = np.asarray(eps, dtype=float)
    return np.asarray(0.5 * (quaternion_scalar(e)[..., None, None] * np.eye(3) - skew(e)))


def camera_motion_jacobian(
    R_WC: ArrayLike, J_P: ArrayLike, J_O: ArrayLike, psi: ArrayLike
) -> Array:
    """``J_M`` of Eq. (10): the pose rate that the joints' velocities cause.

    ``J_P`` and ``J_O`` are the Jacobians (7), (8) of the *camera* frame C in the world: with a
    camera offset in the hand, ``J_P^C = J_P^E - S(R_WE p_EC) J_O``.

    Args:
        R_WC: Camera's orientation, shape (3, 3).
        J_P: Translational Jacobian of frame C, shape (3, n) [m/rad].
        J_O: Rotational Jacobian of frame C, shape (3, n).
        psi: Pose vectors, shape (..., 6).

    Returns:
        Jacobians, shape (..., 6, n).

    Example:
        >>> J = camera_motion_jacobian(np.eye(3), np.eye(3), np.zeros((3, 3)), np.zeros(6))
        >>> J[:3] @ [1.0, 0.0, 0.0]   # the camera moves right: the target moves left
        array([-1.,  0.,  0.])
    """
    R_WC, J_P, J_O = (np.asarray(a, dtype=float) for a in (R_WC, J_P, J_O))
    psi = np.asarray(psi, dtype=float)
    R_CW = R_WC.T
    r_W = psi[..., :3] @ R_WC.T  # R_WC r, the line of sight in the world
    top = -R_CW @ J_P + R_CW @ skew(r_W) @ J_O  # Eq. (2), (7)-(9)
    bottom = -quaternion_rate_matrix(psi[..., 3:]) @ R_CW @ J_O  # Eq. (4), (6), (8)
    return np.concatenate([np.broadcast_to(top, bottom.shape), bottom], axis=-2)  # Eq. (5)


def target_motion_jacobian(R_WC: ArrayLike, psi: ArrayLike) -> Array:
    """``J_N`` of Eq. (10): the pose rate that the target's own motion causes.

    It acts on ``(v_WM, w_WM)``, the target's linear [m/s] and angular [rad/s] velocity in the
    world. The paper's lower block maps a quaternion's rate through a rotation, which is wrong;
    right is ``1/2 (eta I - S(eps)) R_CW`` acting on the angular velocity.

    Args:
        R_WC: Camera's orientation, shape (3, 3).
        psi: Pose vectors, shape (..., 6).

    Returns:
        Jacobians, shape (..., 6, 6).

    Example:
        >>> target_motion_jacobian(np.eye(3), np.zeros(6)) @ [0.1, 0, 0, 0, 0, 1.0]
        array([0.1, 0. , 0. , 0. , 0. , 0.5])
    """
    R_CW = np.asarray(R_WC, dtype=float).T
    psi = np.asarray(psi, dtype=float)
    J = np.zeros((*psi.shape[:-1], 6, 6))
    J[..., :3, :3] = R_CW  # Eq. (2)
    J[..., 3:, 3:] = quaternion_rate_matrix(psi[..., 3:]) @ R_CW  # Eq. (4), (6)
    return J


def step_pose(psi: ArrayLike, pose_rate: ArrayLike, dt: float) -> Array:
    """First-order prediction, Eq. (12) and (23): ``psi + dt * pose_rate``.

    Eq. (23) lacks the dot over psi. The vector part is scaled back to the unit sphere where the
    step leaves it.

    Args:
        psi: Pose vectors, shape (..., 6).
        pose_rate: Their rates [m/s, 1/s], shape (..., 6).
        dt: Time step [s].

    Returns:
        Pose vectors, shape (..., 6).

    Example:
        >>> step_pose(np.zeros(6), [1.0, 0, 0, 0, 0, 0], 0.033)[0]
        np.float64(0.033)
    """
    stepped = np.asarray(psi, dtype=float) + dt * np.asarray(pose_rate, dtype=float)
    norm = np.linalg.norm(stepped[..., 3:], axis=-1, keepdims=True)
    stepped[..., 3:] /= np.maximum(norm, 1.0)
    return stepped


def transport_pose(psi: ArrayLike, R_DC: ArrayLike, p_DC: ArrayLike) -> Array:
    """Exact form of Eq. (12): the pose seen from D, where D is the camera's frame C, moved.

    For a target at rest ``X_DM = X_DC X_CM``.

    Args:
        psi: Pose vectors in C, shape (..., 6).
        R_DC: Orientation of C in D, shape (3, 3).
        p_DC: Position of C in D [m], shape (3,).

    Returns:
        Pose vectors in D, shape (..., 6).

    Example:
        >>> transport_pose([0, 0, 0.8, 0, 0, 0], np.eye(3), [0.01, 0, 0])[:3]
        array([0.01, 0.  , 0.8 ])
    """
    from mffdrake.recognition import _transport  # numba: slow to import

    psi = np.asarray(psi, dtype=float)
    R_DC, p_DC = np.array(R_DC, dtype=float), np.array(p_DC, dtype=float)
    poses = np.array(psi.reshape(-1, 6))
    moved: Array = _transport.transport(poses, R_DC, p_DC, quaternion_vector(R_DC))
    return moved.reshape(psi.shape)


def rotate_by(rotation_vector: ArrayLike) -> Array:
    """Vector part of the unit quaternion of a rotation vector.

    Args:
        rotation_vector: Axis times angle [rad], shape (..., 3).

    Returns:
        Vector parts, with the sign that makes the scalar part positive, shape (..., 3).

    Example:
        >>> rotate_by([np.pi / 3, 0.0, 0.0]).round(6)
        array([0.5, 0. , 0. ])
    """
    v = np.asarray(rotation_vector, dtype=float)
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    # sinc is smooth at zero: sin(a/2)/a = sinc(a / 2 pi) / 2.
    vector = 0.5 * np.sinc(angle / (2.0 * np.pi)) * v
    return np.asarray(np.where(np.cos(0.5 * angle) < 0, -vector, vector))


def move_target(
    psi: ArrayLike, R_WC: ArrayLike, v_WM: ArrayLike, w_WM: ArrayLike, dt: float
) -> Array:
    """The pose after the target's own motion at constant velocity, seen from a fixed camera.

    The exact form of Eq. (12)'s ``J_N`` term.

    Args:
        psi: Pose vectors, shape (..., 6).
        R_WC: Camera's orientation, shape (3, 3).
        v_WM: Target's linear velocity in the world [m/s], shape (3,).
        w_WM: Target's angular velocity in the world [rad/s], shape (3,).
        dt: Time [s].

    Returns:
        Pose vectors, shape (..., 6).

    Example:
        >>> move_target(np.zeros(6), np.eye(3), [1.0, 0, 0], np.zeros(3), 0.1)[0]
        np.float64(0.1)
    """
    psi = np.asarray(psi, dtype=float)
    R_CW = np.asarray(R_WC, dtype=float).T
    v, w = np.asarray(v_WM, dtype=float), np.asarray(w_WM, dtype=float)
    turned = compose_quaternion_vectors(rotate_by(dt * R_CW @ w), psi[..., 3:])
    return np.concatenate([psi[..., :3] + dt * R_CW @ v, turned], axis=-1)


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
    between = compose_quaternion_vectors(-np.asarray(eps_a, dtype=float), eps_b)
    return np.asarray(
        2.0 * np.arctan2(np.linalg.norm(between, axis=-1), quaternion_scalar(between))
    )
