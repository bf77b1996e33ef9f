"""Hand-eye calibration: where a camera is on the hand that carries it.

Frames: B the arm's base, E the hand, C the camera, M a target at rest. Of every pair of poses
``X_BE X_EC X_CM = X_BM`` holds, in which X_EC and X_BM are the same for all. OpenCV had such a
function, which the Python package of its version 5 lacks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.parameters import InputError
from mffdrake.recognition.poses.pose import (
    pose_from_transform,
    quaternion_scalar,
    quaternion_vector,
    rotation_matrix,
    transform_from_pose,
)

__all__ = ["HandEye", "HandEyeError", "calibrate_hand_eye"]

Array = NDArray[np.float64]
Transform = tuple[Array, Array]

_LEAST_TURN = np.radians(0.5)
_MOST_POSES = 120  # for the closed form, which takes all pairs
_OUTLIER = 5.0  # times the median residual
_ITERATIONS = 20
_STEP = 1e-6
_LEAST_SIGMA = 1e-9  # m and rad


class HandEyeError(InputError, ValueError):
    """The poses do not tell where the camera is; the message is one line."""


@dataclass(frozen=True)
class HandEye:
    """A calibration.

    Attributes:
        X_EC: The camera's pose vector on the hand, shape (6,).
        X_BM: The target's pose vector in the base, shape (6,).
        rms_position: How far the target's seen positions are from those that follow [m].
        rms_rotation: The same of its orientations [rad].
        std_position: Standard deviation of X_EC's position that follows from these [m].
        std_rotation: The same of its orientation [rad].
        turn: How far the hand turned about a second axis, root mean square over pairs of poses
            [rad]: where this is small, the camera's place is hardly told.
        used: Which poses count, shape (K,); outliers do not.
    """

    X_EC: Array
    X_BM: Array
    rms_position: float
    rms_rotation: float
    std_position: float
    std_rotation: float
    turn: float
    used: NDArray[np.bool_]


def calibrate_hand_eye(X_BE: Array, X_CM: Array) -> HandEye:
    """Finds where the camera is on the hand, from poses of a target at rest.

    A closed form (the rotation that aligns the axes of the hand's and the camera's turns, then the
    translation by linear least squares) starts a nonlinear least-squares fit of all poses, with
    positions and orientations weighted by what their residuals turn out to be.

    Args:
        X_BE: Pose vectors of the hand in the base, shape (K, 6).
        X_CM: Pose vectors of the target in the camera at the same times, shape (K, 6).

    Returns:
        The calibration.

    Raises:
        HandEyeError: When there are fewer than three poses, or the hand turned about one axis only.

    Example:
        >>> X_BE = np.array([[0, 0, 0, 0, 0, 0], [0, 0, 0.1, 0.3, 0, 0], [0, 0.2, 0, 0, 0.3, 0.1]])
        >>> R, p = transform_from_pose(X_BE)  # the camera is the hand, and the target the base
        >>> X_CM = pose_from_transform(R.transpose(0, 2, 1), -np.einsum("kji,kj->ki", R, p))
        >>> bool(np.allclose(calibrate_hand_eye(X_BE, X_CM).X_EC, 0.0, atol=1e-9))
        True
    """
    X_BE, X_CM = np.asarray(X_BE, dtype=float), np.asarray(X_CM, dtype=float)
    if len(X_BE) < 3:
        raise HandEyeError(f"a hand-eye calibration needs three poses or more, not {len(X_BE)}")
    hand, seen = transform_from_pose(X_BE), transform_from_pose(X_CM)
    thin = np.unique(np.linspace(0, len(X_BE) - 1, min(len(X_BE), _MOST_POSES)).astype(int))
    camera, turn = _closed_form((hand[0][thin], hand[1][thin]), (seen[0][thin], seen[1][thin]))
    middle = _compose(_compose(hand, camera), seen)
    target = (
        rotation_matrix(_mean_turn(middle[0])),
        np.asarray(np.median(middle[1], axis=0)),
    )
    used = np.ones(len(X_BE), dtype=bool)
    for _ in range(3):
        chosen = (hand[0][used], hand[1][used]), (seen[0][used], seen[1][used])
        camera, target, covariance = _fit(*chosen, camera, target)
        errors = _residuals(hand, seen, camera, target)
        sizes = np.stack([np.linalg.norm(errors[:, :3], axis=1), _norm(errors[:, 3:])])
        limits = _OUTLIER * np.median(sizes[:, used], axis=1, keepdims=True) + 1e-9
        inside = (sizes <= limits).all(axis=0)
        if np.array_equal(inside, used) or inside.sum() < 3:
            break
        used = inside
    rms = np.sqrt(np.mean(sizes[:, used] ** 2, axis=1))
    variances = np.diag(covariance)
    return HandEye(
        pose_from_transform(*camera), pose_from_transform(*target), float(rms[0]), float(rms[1]),
        float(np.sqrt(variances[:3].sum())), float(np.sqrt(variances[3:6].sum())), turn, used,
    )  # fmt: skip


def _compose(a: Transform, b: Transform) -> Transform:
    """The product of transforms, or of arrays of them."""
    return a[0] @ b[0], np.asarray((a[0] @ b[1][..., None])[..., 0] + a[1])


def _inverse(a: Transform) -> Transform:
    R = np.swapaxes(a[0], -1, -2)
    return R, -(R @ a[1][..., None])[..., 0]


def _norm(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def _turns(R: Array) -> Array:
    """Rotation vectors [rad], shape (..., 3)."""
    eps = quaternion_vector(R)
    size = _norm(eps)
    angle = 2.0 * np.arctan2(size, quaternion_scalar(eps))
    return np.asarray(eps * np.where(size > 1e-12, angle / np.maximum(size, 1e-12), 2.0)[..., None])


def _rotations(turns: Array) -> Array:
    """Rotation matrices of rotation vectors of at most a half turn."""
    angle = _norm(turns)[..., None]
    return rotation_matrix(turns * np.where(angle > 1e-12, np.sinc(angle / (2 * np.pi)) / 2, 0.5))


def _mean_turn(R: Array) -> Array:
    """Vector part of the quaternion of the mean of rotations."""
    U, _, Vt = np.linalg.svd(R.mean(axis=0))
    return quaternion_vector(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def _closed_form(hand: Transform, seen: Transform) -> tuple[Transform, float]:
    """X_EC of all pairs of poses, and how far the hand turned about its second axis."""
    i, j = np.triu_indices(len(hand[1]), 1)
    A = _compose(_inverse((hand[0][i], hand[1][i])), (hand[0][j], hand[1][j]))
    B = _compose((seen[0][i], seen[1][i]), _inverse((seen[0][j], seen[1][j])))
    a, b = _turns(A[0]), _turns(B[0])  # A X = X B, so a = R b
    turn = float(np.sqrt(np.linalg.eigvalsh(a.T @ a / len(a))[1]))
    if turn < _LEAST_TURN:
        raise HandEyeError(
            f"the hand turned by {np.degrees(turn):.2g} deg only about a second axis: let it turn "
            "about two axes or more, by 20 deg or more"
        )
    U, _, Vt = np.linalg.svd(a.T @ b)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    left = (A[0] - np.eye(3)).reshape(-1, 3)
    right = (B[1] @ R.T - A[1]).reshape(-1)
    p = np.linalg.lstsq(left, right, rcond=None)[0]
    return (np.asarray(R), np.asarray(p)), turn


def _residuals(hand: Transform, seen: Transform, camera: Transform, target: Transform) -> Array:
    """Seen poses against those that follow, positions [m] and turns [rad], shape (K, 6)."""
    R, p = _compose(_inverse(_compose(hand, camera)), target)
    return np.column_stack([seen[1] - p, _turns(np.swapaxes(R, -1, -2) @ seen[0])])


def _fit(
    hand: Transform, seen: Transform, camera: Transform, target: Transform
) -> tuple[Transform, Transform, Array]:
    """Gauss-Newton steps from a start; X_EC, X_BM and the covariance of both, (12, 12)."""
    covariance: Array = np.zeros((12, 12))

    def moved(step: Array) -> tuple[Transform, Transform]:
        (R, p), (S, q) = camera, target
        return (
            (R @ _rotations(step[3:6]), p + step[:3]),
            (S @ _rotations(step[9:]), q + step[6:9]),
        )

    for _ in range(_ITERATIONS):
        errors = _residuals(hand, seen, camera, target)
        # Each kind by its own size: a millimeter is not a milliradian.
        freedom = 1.0 - 12.0 / errors.size
        sigma = np.sqrt(np.mean(errors.reshape(-1, 2, 3) ** 2, axis=(0, 2)) / freedom)
        weights = np.repeat(1.0 / np.maximum(sigma, _LEAST_SIGMA), 3)
        J = np.empty((errors.size, 12))
        for k in range(12):
            ahead, behind = (
                _residuals(hand, seen, *moved(sign * _STEP * np.eye(12)[k])) for sign in (1.0, -1.0)
            )
            J[:, k] = ((ahead - behind) * weights / (2.0 * _STEP)).reshape(-1)
        back = np.linalg.pinv(J)
        step = -back @ (errors * weights).reshape(-1)
        covariance = np.asarray(back @ back.T)
        camera, target = moved(step)
        if np.abs(step).max() < 1e-10:
            break
    return camera, target, covariance
