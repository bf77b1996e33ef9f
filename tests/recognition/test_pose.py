"""Equations (1)-(12): pose vectors, their rates and their transport, against the true motion."""

import cv2
import numpy as np
import pytest
from synthetic import quaternion_vector as true_quaternion_vector
from synthetic import rotation as true_rotation

from mffdrake.recognition.poses import rotations
from mffdrake.recognition.poses.pose import (
    compose_quaternion_vectors,
    pose_from_transform,
    quaternion_scalar,
    quaternion_vector,
    rotation_angle,
    rotation_matrix,
    skew,
    target_position_in_camera,
    transform_from_pose,
)
from mffdrake.recognition.poses.pose_motion import (
    camera_motion_jacobian,
    quaternion_rate_matrix,
    step_pose,
    target_motion_jacobian,
    transport_pose,
)

SEEDS = range(5)


def turn(vector):
    """Rotation matrix of a rotation vector [rad]."""
    return cv2.Rodrigues(np.asarray(vector, dtype=float))[0]


def transform(R, p):
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return X


def true_pose(X_CM):
    """Pose vector of a homogeneous transform, without mffdrake."""
    return np.concatenate([X_CM[:3, 3], true_quaternion_vector(X_CM[:3, :3])])


def true_transform(psi):
    return transform(true_rotation(psi[3:]), psi[:3])


def random_pose(rng):
    """A pose vector whose quaternion stays away from eta = 0."""
    return np.concatenate([rng.uniform(-1, 1, 3), rng.uniform(-0.5, 0.5, 3)])


def random_rotation(rng):
    return turn(rng.uniform(-1.7, 1.7, 3))


def derivative(function, h=1e-4):
    """Central difference at time zero."""
    return (function(h) - function(-h)) / (2 * h)


class Twist:
    """A frame X_W(t) that starts at X_0 with the velocities v and omega, expressed in W."""

    def __init__(self, R_0, p_0, velocity, angular_velocity):
        self.R_0, self.p_0 = np.asarray(R_0), np.asarray(p_0, dtype=float)
        self.velocity, self.angular_velocity = np.asarray(velocity), np.asarray(angular_velocity)

    def __call__(self, t):
        return transform(turn(t * self.angular_velocity) @ self.R_0, self.p_0 + t * self.velocity)


class Arm:
    """A hand-eye arm of four revolute joints: forward kinematics only, and Eq. (7), (8)."""

    def __init__(self, rng):
        self.axes = [a / np.linalg.norm(a) for a in rng.normal(size=(4, 3))]
        self.links = rng.uniform(-0.5, 0.5, size=(4, 3))
        self.p_EC = rng.uniform(-0.3, 0.3, 3)
        self.R_EC = random_rotation(rng)

    def hand(self, q):
        """X_WE, and the joints' axes and positions in the world."""
        X, axes, points = np.eye(4), [], []
        for axis, link, angle in zip(self.axes, self.links, q, strict=True):
            axes.append(X[:3, :3] @ axis)
            points.append(X[:3, 3])
            X = X @ transform(turn(angle * axis), np.zeros(3)) @ transform(np.eye(3), link)
        return X, np.array(axes), np.array(points)

    def camera(self, q):
        """X_WC."""
        return self.hand(q)[0] @ transform(self.R_EC, self.p_EC)

    def hand_jacobians(self, q):
        """Translational and rotational Jacobian of the frame E."""
        X_WE, axes, points = self.hand(q)
        return np.cross(axes, X_WE[:3, 3] - points).T, axes.T


# Rotations and quaternions


@pytest.mark.parametrize("seed", SEEDS)
def test_skew_is_the_cross_product(seed):
    a, b = np.random.default_rng(seed).normal(size=(2, 3))
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-15)
    np.testing.assert_array_equal(skew(a).T, -skew(a))


def test_skew_has_the_signs_of_equation_3():
    np.testing.assert_array_equal(skew([1, 2, 3]), [[0, -3, 2], [3, 0, -1], [-2, 1, 0]])


@pytest.mark.parametrize("seed", SEEDS)
def test_skew_of_a_rotated_vector_as_in_equation_9(seed):
    rng = np.random.default_rng(seed)
    R_WC, w_WC = random_rotation(rng), rng.normal(size=3)
    w_CW_C = -R_WC.T @ w_WC
    np.testing.assert_allclose(skew(w_CW_C), -R_WC.T @ skew(w_WC) @ R_WC, atol=1e-12)


def test_scalar_part_completes_the_unit_quaternion_and_is_not_negative():
    eps = np.array([[0, 0, 0], [0.6, 0, 0], [0, -0.8, 0], [0, 0, 1], [0.5, 0.5, -0.5]])
    np.testing.assert_allclose(quaternion_scalar(eps), [1, 0.8, 0.6, 0, 0.5], atol=1e-15)


def test_scalar_part_of_a_vector_part_above_one_is_zero():
    np.testing.assert_array_equal(quaternion_scalar([[1.0, 0.1, 0.0], [0.9, 0.9, 0.9]]), [0, 0])


@pytest.mark.parametrize("angle", [-3.0, -1.0, 0.0, 1e-9, 0.3, 2.0, 3.1])
@pytest.mark.parametrize("axis", range(3))
def test_rotation_matrix_about_a_coordinate_axis_is_closed_form(axis, angle):
    eps = np.zeros(3)
    eps[axis] = np.sin(0.5 * angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    expected = np.eye(3)
    expected[i, i] = expected[j, j] = np.cos(angle)
    expected[i, j], expected[j, i] = -np.sin(angle), np.sin(angle)
    np.testing.assert_allclose(rotation_matrix(eps), expected, atol=1e-14)
    np.testing.assert_allclose(quaternion_vector(expected), eps, atol=1e-14)


@pytest.mark.parametrize("seed", SEEDS)
def test_rotation_matrix_agrees_with_axis_and_angle(seed):
    rng = np.random.default_rng(seed)
    vector = rng.normal(size=3)
    vector *= rng.uniform(0, 3.1) / np.linalg.norm(vector)
    R, angle = turn(vector), np.linalg.norm(vector)
    eps = vector / angle * np.sin(0.5 * angle)
    np.testing.assert_allclose(rotation_matrix(eps), R, atol=1e-13)
    np.testing.assert_allclose(quaternion_vector(R), eps, atol=1e-13)


@pytest.mark.parametrize("seed", SEEDS)
def test_rotation_matrix_is_a_rotation(seed):
    R = rotation_matrix(np.random.default_rng(seed).uniform(-0.57, 0.57, 3))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0)


@pytest.mark.parametrize("short_of_half_a_turn", [0.0, 1e-14, 1e-10, 1e-6, 1e-3])
@pytest.mark.parametrize(
    "axis", [(1, 0, 0), (0, -1, 0), (0, 0, 1), (0.6, 0, -0.8), (0.1, 0.7, -0.3), (-1, -2, 1e-3)]
)
def test_quaternion_vector_stays_exact_near_half_a_turn(axis, short_of_half_a_turn):
    axis = np.array(axis) / np.linalg.norm(axis)
    angle = np.pi - short_of_half_a_turn
    S = skew(axis)
    R = np.eye(3) + np.sin(angle) * S + (1 - np.cos(angle)) * S @ S
    eps = quaternion_vector(R)
    expected = axis * np.sin(0.5 * angle)
    if short_of_half_a_turn < 1e-12:  # eta is zero up to rounding: both signs are right
        expected = expected * np.sign(expected @ eps)
    np.testing.assert_allclose(eps, expected, atol=1e-14)
    # eta = sqrt(1 - |eps|^2) keeps half of the digits here.
    np.testing.assert_allclose(rotation_matrix(eps), R, atol=1e-7)


@pytest.mark.parametrize("angle_deg", [181.0, 200.0, 270.0, 359.0, 400.0])
def test_turns_beyond_half_a_turn_are_given_the_other_way_round_with_eta_positive(angle_deg):
    axis, angle = np.array([2.0, -1.0, 2.0]) / 3.0, np.radians(angle_deg)
    eps = quaternion_vector(turn(axis * angle))
    sign = np.sign(np.cos(0.5 * angle))  # of the scalar part, had the angle been halved as it is
    np.testing.assert_allclose(eps, sign * axis * np.sin(0.5 * angle), atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_composition_is_the_product_of_the_rotations(seed):
    rng = np.random.default_rng(seed)
    for _ in range(20):
        # Single turns of up to 170 deg, so that many products pass half a turn.
        a, b = (v / np.linalg.norm(v) * rng.uniform(0, 0.99) for v in rng.normal(size=(2, 3)))
        np.testing.assert_allclose(
            rotation_matrix(compose_quaternion_vectors(a, b)),
            true_rotation(a) @ true_rotation(b),
            atol=1e-7,
        )


def test_composition_takes_the_sign_that_makes_eta_positive():
    eps = compose_quaternion_vectors([0.0, np.sin(1.0), 0.0], [0.0, np.sin(1.0), 0.0])
    np.testing.assert_allclose(eps, [0, -np.sin(np.pi - 2.0), 0], atol=1e-15)


def test_composition_with_the_inverse_is_the_identity():
    eps = np.random.default_rng(0).uniform(-0.57, 0.57, size=(50, 3))
    np.testing.assert_allclose(compose_quaternion_vectors(eps, -eps), 0.0, atol=1e-15)
    np.testing.assert_allclose(compose_quaternion_vectors(eps, np.zeros(3)), eps, atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.01, 1.0, 3.0, np.pi])
def test_rotation_angle_between_turns_about_one_axis(angle):
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    a = axis * np.sin(0.5 * (0.7 - angle))
    b = axis * np.sin(0.5 * 0.7)
    assert rotation_angle(a, b) == pytest.approx(angle, abs=1e-7 if angle > 3.1 else 1e-14)
    assert rotation_angle(b, a) == pytest.approx(float(rotation_angle(a, b)), abs=1e-15)
    assert rotations.angle_between(a, b) == pytest.approx(float(rotation_angle(a, b)), abs=1e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_rotation_angle_is_that_of_the_relative_rotation(seed):
    a, b = np.random.default_rng(seed).uniform(-0.57, 0.57, size=(2, 3))
    cosine = 0.5 * (np.trace(true_rotation(a).T @ true_rotation(b)) - 1)
    assert rotation_angle(a, b) == pytest.approx(np.arccos(cosine))
    assert rotations.angle_between(a, b) == pytest.approx(np.arccos(cosine))


# Poses and transforms, Eq. (1), (13)


@pytest.mark.parametrize("seed", SEEDS)
def test_pose_and_transform_are_each_other_s_inverse(seed):
    psi = random_pose(np.random.default_rng(seed))
    R_CM, p_CM = transform_from_pose(psi)
    np.testing.assert_allclose(transform(R_CM, p_CM), true_transform(psi), atol=1e-14)
    np.testing.assert_allclose(pose_from_transform(R_CM, p_CM), psi, atol=1e-14)


@pytest.mark.parametrize("seed", SEEDS)
def test_target_position_in_the_camera_is_equation_1(seed):
    rng = np.random.default_rng(seed)
    X_WC, p_WM = transform(random_rotation(rng), rng.normal(size=3)), rng.normal(size=3)
    np.testing.assert_allclose(
        target_position_in_camera(X_WC[:3, :3], X_WC[:3, 3], p_WM),
        (np.linalg.inv(X_WC) @ [*p_WM, 1.0])[:3],
        atol=1e-13,
    )


# Rates, Eq. (2)-(11)


@pytest.mark.parametrize("seed", SEEDS)
def test_quaternion_rate_takes_the_angular_velocity_in_the_observing_frame(seed):
    rng = np.random.default_rng(seed)
    eps, omega = rng.uniform(-0.5, 0.5, 3), rng.normal(size=3)
    R, eta = true_rotation(eps), np.sqrt(1 - eps @ eps)
    in_observer = derivative(lambda t: true_quaternion_vector(turn(t * omega) @ R))
    np.testing.assert_allclose(quaternion_rate_matrix(eps) @ omega, in_observer, atol=1e-7)
    # Expressed in the body, as the paper calls it, the sign of S(eps) flips.
    in_body = derivative(lambda t: true_quaternion_vector(R @ turn(t * omega)))
    np.testing.assert_allclose(quaternion_rate_matrix(-eps) @ omega, in_body, atol=1e-7)
    np.testing.assert_allclose(quaternion_rate_matrix(eps) @ (R @ omega), in_body, atol=1e-7)
    # The scalar part: d(eta)/dt = -1/2 eps . omega follows from the unit norm.
    eta_rate = -(eps @ quaternion_rate_matrix(eps) @ omega) / eta
    assert eta_rate == pytest.approx(-0.5 * eps @ omega)


@pytest.mark.parametrize("seed", SEEDS)
def test_camera_motion_jacobian_is_the_derivative_of_the_pose_by_the_camera_s_motion(seed):
    rng = np.random.default_rng(seed)
    psi = random_pose(rng)
    X_WC = Twist(random_rotation(rng), rng.normal(size=3), *rng.normal(size=(2, 3)))
    X_WM = X_WC(0.0) @ true_transform(psi)  # at rest
    rate = derivative(lambda t: true_pose(np.linalg.inv(X_WC(t)) @ X_WM))
    # With the six "joints" (v, omega) the Jacobians (7), (8) are unit matrices.
    J_P, J_O = np.eye(3, 6), np.eye(3, 6, k=3)
    J_M = camera_motion_jacobian(X_WC.R_0, J_P, J_O, psi)
    motion = np.concatenate([X_WC.velocity, X_WC.angular_velocity])
    np.testing.assert_allclose(J_M @ motion, rate, atol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_camera_motion_jacobian_of_an_arm_takes_the_camera_s_jacobian(seed):
    rng = np.random.default_rng(seed)
    arm, q, q_rate, psi = Arm(rng), rng.normal(size=4), rng.normal(size=4), random_pose(rng)
    X_WM = arm.camera(q) @ true_transform(psi)
    rate = derivative(lambda t: true_pose(np.linalg.inv(arm.camera(q + t * q_rate)) @ X_WM))
    J_P_hand, J_O = arm.hand_jacobians(q)
    R_WE = arm.hand(q)[0][:3, :3]
    J_P = J_P_hand - skew(R_WE @ arm.p_EC) @ J_O  # Eq. (7) at the camera
    J_M = camera_motion_jacobian(arm.camera(q)[:3, :3], J_P, J_O, psi)
    assert J_M.shape == (6, 4)
    np.testing.assert_allclose(J_M @ q_rate, rate, atol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_target_motion_jacobian_is_the_derivative_of_the_pose_by_the_target_s_motion(seed):
    rng = np.random.default_rng(seed)
    psi = random_pose(rng)
    X_WC = transform(random_rotation(rng), rng.normal(size=3))
    X_0 = X_WC @ true_transform(psi)
    X_WM = Twist(X_0[:3, :3], X_0[:3, 3], *rng.normal(size=(2, 3)))
    rate = derivative(lambda t: true_pose(np.linalg.inv(X_WC) @ X_WM(t)))
    J_N = target_motion_jacobian(X_WC[:3, :3], psi)
    motion = np.concatenate([X_WM.velocity, X_WM.angular_velocity])
    np.testing.assert_allclose(J_N @ motion, rate, atol=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_both_motions_add_up_to_equation_10(seed):
    rng = np.random.default_rng(seed)
    psi = random_pose(rng)
    X_WC = Twist(random_rotation(rng), rng.normal(size=3), *rng.normal(size=(2, 3)))
    X_0 = X_WC(0.0) @ true_transform(psi)
    X_WM = Twist(X_0[:3, :3], X_0[:3, 3], *rng.normal(size=(2, 3)))
    rate = derivative(lambda t: true_pose(np.linalg.inv(X_WC(t)) @ X_WM(t)))
    J_M = camera_motion_jacobian(X_WC.R_0, np.eye(3, 6), np.eye(3, 6, k=3), psi)
    J_N = target_motion_jacobian(X_WC.R_0, psi)
    camera = np.concatenate([X_WC.velocity, X_WC.angular_velocity])
    target = np.concatenate([X_WM.velocity, X_WM.angular_velocity])
    np.testing.assert_allclose(J_M @ camera + J_N @ target, rate, atol=1e-6)


def test_camera_and_target_moving_as_one_body_leave_the_pose_at_rest():
    rng = np.random.default_rng(0)
    psi, R_WC, omega, velocity = random_pose(rng), random_rotation(rng), *rng.normal(size=(2, 3))
    J_M = camera_motion_jacobian(R_WC, np.eye(3, 6), np.eye(3, 6, k=3), psi)
    J_N = target_motion_jacobian(R_WC, psi)
    target_velocity = velocity + np.cross(omega, R_WC @ psi[:3])
    rate = J_M @ [*velocity, *omega] + J_N @ [*target_velocity, *omega]
    np.testing.assert_allclose(rate, 0.0, atol=1e-14)


# Prediction, Eq. (12), (23)


def moving_camera(rng):
    """A camera's motion, a pose seen at its start, and that pose's rate by Eq. (11)."""
    psi = random_pose(rng)
    X_WC = Twist(random_rotation(rng), rng.normal(size=3), *rng.normal(size=(2, 3)))
    J_M = camera_motion_jacobian(X_WC.R_0, np.eye(3, 6), np.eye(3, 6, k=3), psi)
    return X_WC, psi, J_M @ np.concatenate([X_WC.velocity, X_WC.angular_velocity])


@pytest.mark.parametrize("seed", SEEDS)
def test_transport_is_the_true_motion_of_a_resting_target(seed):
    X_WC, psi, _ = moving_camera(np.random.default_rng(seed))
    X_DC = np.linalg.inv(X_WC(0.4)) @ X_WC(0.0)
    np.testing.assert_allclose(
        transport_pose(psi, X_DC[:3, :3], X_DC[:3, 3]),
        true_pose(X_DC @ true_transform(psi)),
        atol=1e-12,
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_one_step_of_equation_12_is_exact_to_the_second_order(seed):
    X_WC, psi, rate = moving_camera(np.random.default_rng(seed))

    def error(dt):
        X_DC = np.linalg.inv(X_WC(dt)) @ X_WC(0.0)
        exact = transport_pose(psi, X_DC[:3, :3], X_DC[:3, 3])
        return np.linalg.norm(step_pose(psi, rate, dt) - exact)

    steps = 0.02 * 0.5 ** np.arange(5)
    errors = np.array([error(dt) for dt in steps])
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope == pytest.approx(2.0, abs=0.05)
    np.testing.assert_allclose(errors[:-1] / errors[1:], 4.0, rtol=0.1)


def test_step_moves_by_the_rate_and_leaves_its_argument_alone():
    psi, rate = np.array([0, 0.155, 0.8, 0.1, 0, -0.1]), np.array([1, 2, 3, 0.1, 0.2, 0.3])
    before = psi.copy()
    np.testing.assert_allclose(step_pose(psi, rate, 0.033), psi + 0.033 * rate, atol=1e-15)
    np.testing.assert_allclose(step_pose(psi, rate, -0.1), psi - 0.1 * rate, atol=1e-15)
    np.testing.assert_array_equal(psi, before)


def test_step_off_the_unit_sphere_is_scaled_back_onto_it():
    stepped = step_pose([0, 0, 1, 0.6, 0.8, 0], [0, 0, 0, 6.0, 8.0, 0], 0.1)
    np.testing.assert_allclose(stepped, [0, 0, 1, 0.6, 0.8, 0], atol=1e-15)


@pytest.mark.parametrize("seed", SEEDS)
def test_transports_compose_and_have_inverses(seed):
    rng = np.random.default_rng(seed)
    psi = random_pose(rng)
    A, B = (transform(turn(rng.uniform(-0.4, 0.4, 3)), rng.normal(size=3)) for _ in range(2))
    AB, back = A @ B, np.linalg.inv(B)
    by_b = transport_pose(psi, B[:3, :3], B[:3, 3])
    np.testing.assert_allclose(
        transport_pose(by_b, A[:3, :3], A[:3, 3]),
        transport_pose(psi, AB[:3, :3], AB[:3, 3]),
        atol=1e-13,
    )
    np.testing.assert_allclose(transport_pose(by_b, back[:3, :3], back[:3, 3]), psi, atol=1e-13)
    np.testing.assert_allclose(transport_pose(psi, np.eye(3), np.zeros(3)), psi, atol=1e-15)


def test_transport_past_half_a_turn_keeps_eta_positive():
    psi = np.array([0, 0, 1, np.sin(np.radians(80)), 0, 0])  # turned by 160 deg
    R_DC = turn([np.radians(40), 0, 0])
    transported = transport_pose(psi, R_DC, np.zeros(3))
    np.testing.assert_allclose(transported[3:], [-np.sin(np.radians(80)), 0, 0], atol=1e-12)
    np.testing.assert_allclose(
        rotation_matrix(transported[3:]), R_DC @ true_rotation(psi[3:]), atol=1e-12
    )


@pytest.mark.parametrize("axis", [*np.eye(3), [1.0, 2.0, 3.0], [-3.0, 1.0, 0.0], [0.0, -1.0, 2.0]])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.0, 3.0, np.pi - 1e-9])
def test_any_turn_is_transported_by_its_quaternion(axis, angle):
    """The compiled function has it from the same formulas, whichever entry is the largest."""
    R = turn(angle * np.array(axis) / np.linalg.norm(axis))
    moved = transport_pose(np.zeros(6), R, np.zeros(3))
    np.testing.assert_allclose(moved[3:], quaternion_vector(R), rtol=0, atol=2e-16)


# Many at once


@pytest.mark.parametrize("seed", SEEDS)
def test_compiled_poses_are_composed_and_seen_from_each_other_as_transforms_are(seed):
    rng = np.random.default_rng(seed)
    a, b = random_pose(rng), random_pose(rng)
    X_AB, X_AC = true_transform(a), true_transform(b)
    np.testing.assert_allclose(rotations.composed(a, b), true_pose(X_AB @ X_AC), atol=1e-12)
    seen = true_pose(np.linalg.inv(X_AB) @ X_AC)
    np.testing.assert_allclose(rotations.seen_from(a, b), seen, atol=1e-12)
    np.testing.assert_allclose(rotations.composed(a, seen), b, atol=1e-12)


def test_every_function_takes_many_poses_at_once():
    rng = np.random.default_rng(0)
    psi = np.array([[random_pose(rng) for _ in range(3)] for _ in range(2)])
    rate, R, p = rng.normal(size=(2, 3, 6)), random_rotation(rng), rng.normal(size=3)
    J_P, J_O = rng.normal(size=(2, 3, 7))
    other = rng.uniform(-0.5, 0.5, 3)
    functions = {
        "skew": lambda s, r: skew(s[..., :3]),
        "quaternion_scalar": lambda s, r: quaternion_scalar(s[..., 3:]),
        "rotation_matrix": lambda s, r: rotation_matrix(s[..., 3:]),
        "quaternion_vector": lambda s, r: quaternion_vector(rotation_matrix(s[..., 3:])),
        "compose_quaternion_vectors": lambda s, r: compose_quaternion_vectors(other, s[..., 3:]),
        "rotation_angle": lambda s, r: rotation_angle(s[..., 3:], other),
        "transform_from_pose": lambda s, r: transform_from_pose(s)[0],
        "pose_from_transform": lambda s, r: pose_from_transform(*transform_from_pose(s)),
        "quaternion_rate_matrix": lambda s, r: quaternion_rate_matrix(s[..., 3:]),
        "camera_motion_jacobian": lambda s, r: camera_motion_jacobian(R, J_P, J_O, s),
        "target_motion_jacobian": lambda s, r: target_motion_jacobian(R, s),
        "step_pose": lambda s, r: step_pose(s, r, 0.1),
        "transport_pose": lambda s, r: transport_pose(s, R, p),
    }
    for name, function in functions.items():
        one_by_one = [[function(psi[i, j], rate[i, j]) for j in range(3)] for i in range(2)]
        np.testing.assert_allclose(function(psi, rate), one_by_one, atol=1e-14, err_msg=name)
