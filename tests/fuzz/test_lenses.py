"""Cameras and lenses of any numbers: pixels are finite or NaN, and move as derivatives say."""

import cv2
import numpy as np
from hypothesis import strategies as st
from judging import NUMBERS, outcome, prop

import mffdrake as mff

COUNTS = {"none": [0], "plumb_bob": [4, 5, 8], "equidistant": [4]}
SANE = st.floats(-1.0, 1.0)


@st.composite
def cameras(draw, numbers, coefficients):
    """A camera, or what `Camera` says of such numbers."""
    model = draw(st.sampled_from([*COUNTS, *COUNTS, "fisheye"]))
    count = draw(st.sampled_from(COUNTS.get(model, [4])))
    bends = draw(st.lists(coefficients, min_size=count, max_size=count))

    def make():
        fx, fy, cx, cy = (draw(numbers) for _ in range(4))
        turn = cv2.Rodrigues(np.array([draw(SANE) for _ in range(3)]))[0]
        return mff.Camera(
            width=draw(st.integers(1, 2000)), height=draw(st.integers(1, 2000)),
            fx=fx, fy=fy, cx=cx, cy=cy, distortion=mff.Distortion(model, tuple(bends)),
            R_CK=turn, p_CK=[draw(numbers) for _ in range(3)],
        )  # fmt: skip

    return outcome(make, error=ValueError)


POINTS = st.lists(st.lists(NUMBERS, min_size=3, max_size=3), min_size=1, max_size=4)
REAL = st.one_of(SANE, st.floats(10.0, 2000.0))


@prop(st.one_of(cameras(NUMBERS, NUMBERS), cameras(REAL, NUMBERS)), POINTS)
def test_pixels_of_any_lens_are_finite_or_nan(camera, points):
    if camera is None:
        return
    with np.errstate(all="ignore"):
        pixels, jacobians = camera.project_with_jacobian(points)
        seen = camera.sees(points)
        assert np.array_equal(camera.project(points), pixels, equal_nan=True)
    assert (np.isfinite(pixels).all(axis=1) | np.isnan(pixels).all(axis=1)).all(), pixels
    assert np.isfinite(pixels[seen]).all()
    unseen = np.isnan(pixels[:, 0])
    assert np.isnan(jacobians[unseen]).all()


@prop(
    cameras(REAL, st.floats(-0.3, 0.3)), st.lists(SANE, min_size=2, max_size=2), st.floats(0.1, 3)
)
def test_pixels_move_as_their_derivatives_say(camera, across, depth):
    if camera is None:
        return
    ray = np.array([0.7 * across[0], 0.7 * across[1], 1.0]) @ camera.R_CK.T
    point = camera.p_CK + depth * ray
    pixel, J = camera.project_with_jacobian(point)
    if np.isnan(pixel).any():
        return
    assert np.isfinite(J).all()
    size = np.abs(J).max()
    assert np.abs(J @ ray).max() <= 1e-9 * size * (1 + np.abs(camera.p_CK).max())
    step = 1e-5 * depth
    for axis in np.eye(3):
        way = step * axis
        ahead, behind = camera.project(point + way), camera.project(point - way)
        if np.isnan(ahead).any() or np.isnan(behind).any():
            continue
        # Central differences err in the second order, and by the rounding of far places
        rounding = 1e-13 * (1 + np.abs(point).max() / depth) * size * depth / step
        error = np.abs((ahead - behind) / (2 * step) - J @ axis).max()
        assert error <= 1e-3 * size + 100 * rounding, (error, size)
