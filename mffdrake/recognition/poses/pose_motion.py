"""How poses move: the pose's rate, Eq. (10), and what motions of camera and target do to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mffdrake.recognition.poses.pose import (
    compose_quaternion_vectors,
    quaternion_scalar,
    skew,
)

__all__ = [
    "camera_motion_jacobian",
    "move_target",
    "quaternion_rate_matrix",
    "rotate_by",
    "step_pose",
    "target_motion_jacobian",
    "transport_pose",
]

Array = NDArray[np.float64]


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
    from mffdrake.recognition.poses import rotations  # numba: slow to import

    psi = np.asarray(psi, dtype=float)
    R_DC, p_DC = np.array(R_DC, dtype=float), np.array(p_DC, dtype=float)
    poses = np.array(psi.reshape(-1, 6))
    moved: Array = rotations.transport_by(poses, R_DC, p_DC)
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
