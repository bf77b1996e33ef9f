"""Compiled projection through a lens (numba). Import only where it runs: numba loads slowly.

A camera K has a place in the rig's frame C and a lens. Normalized coordinates (x, y) are those on
the plane z = 1 of K; pixel coordinates (u, v) are whole numbers at pixel centers.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

NO_DISTORTION, PLUMB_BOB, EQUIDISTANT = range(3)

_HASH_STEP = 31  # All over the image: in few rows, a followed target's small motion is missed.
_NOISE_STEP = 499  # pixels between those where noise is measured; odd to the images' widths


class Jacobian(NamedTuple):
    """Derivatives of pixel coordinates (u, v), or distorted ones, by normalized ones (x, y).

    Attributes:
        ux: du/dx.
        uy: du/dy.
        vx: dv/dx.
        vy: dv/dy.
    """

    ux: float
    uy: float
    vx: float
    vy: float


class Lens(NamedTuple):
    """From normalized coordinates to pixels.

    Attributes:
        model: `NO_DISTORTION`, `PLUMB_BOB` or `EQUIDISTANT`.
        fx: Focal length along u [px].
        fy: Focal length along v [px].
        cx: Principal point's u [px].
        cy: Principal point's v [px].
        k: Eight distortion coefficients in OpenCV's order, zero beyond the last.
        max_radius_squared: Points farther from the axis, squared and normalized, are not seen: the
            distortion would fold them back into the image.
    """

    model: int
    fx: float
    fy: float
    cx: float
    cy: float
    k: tuple[float, ...]
    max_radius_squared: float


class Eye(NamedTuple):
    """A camera K without its image: numbers only, which compiled functions pass at no cost.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        lens: The lens.
        R_KC: The rig's orientation in the camera's frame, row by row, nine numbers.
        p_KC: Its position [m], three numbers.
        calibration_error: See `Camera` [px].
    """

    width: int
    height: int
    lens: Lens
    R_KC: tuple[float, ...]
    p_KC: tuple[float, ...]
    calibration_error: float


class View(NamedTuple):
    """What a camera sees: the image as a list of pixels, shape (height * width, 3 or 4)."""

    pixels: Image
    eye: Eye


@njit(cache=True, error_model="numpy", inline="always")
def plumb_bob(k: tuple[float, ...], x: float, y: float) -> tuple[float, float]:
    """Normalized coordinates, distorted by Brown's and Conrady's polynomials."""
    s = x * x + y * y
    radial = (1.0 + s * (k[0] + s * (k[1] + s * k[4]))) / (1.0 + s * (k[5] + s * (k[6] + s * k[7])))
    return (
        x * radial + 2.0 * k[2] * x * y + k[3] * (s + 2.0 * x * x),
        y * radial + k[2] * (s + 2.0 * y * y) + 2.0 * k[3] * x * y,
    )


@njit(cache=True, error_model="numpy")
def distort(lens: Lens, x: float, y: float) -> tuple[float, float]:
    """Distorted normalized coordinates."""
    k = lens.k
    if lens.model == PLUMB_BOB:
        return plumb_bob(k, x, y)  # type: ignore[no-any-return]
    if lens.model == EQUIDISTANT:
        s = x * x + y * y
        r = math.sqrt(s)
        if r < 1e-8:
            return x, y
        angle = math.atan(r)
        t = angle * angle
        scale = angle * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])))) / r
        return x * scale, y * scale
    return x, y


@njit(cache=True, error_model="numpy")
def _distortion_jacobian(lens: Lens, x: float, y: float) -> Jacobian:
    """Derivative of `distort`."""
    k = lens.k
    s = x * x + y * y
    if lens.model == PLUMB_BOB:
        top = 1.0 + s * (k[0] + s * (k[1] + s * k[4]))
        bottom = 1.0 + s * (k[5] + s * (k[6] + s * k[7]))
        radial = top / bottom
        top_rate = k[0] + s * (2.0 * k[1] + 3.0 * s * k[4])
        bottom_rate = k[5] + s * (2.0 * k[6] + 3.0 * s * k[7])
        rate = 2.0 * (top_rate - radial * bottom_rate) / bottom  # of radial, with x dx + y dy
        mixed = x * y * rate + 2.0 * (k[2] * x + k[3] * y)
        return Jacobian(
            radial + x * x * rate + 2.0 * k[2] * y + 6.0 * k[3] * x,
            mixed,
            mixed,
            radial + y * y * rate + 6.0 * k[2] * y + 2.0 * k[3] * x,
        )
    r = math.sqrt(s)
    if r < 1e-8:
        return Jacobian(1.0, 0.0, 0.0, 1.0)
    angle = math.atan(r)
    t = angle * angle
    scale = angle * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])))) / r
    along = 1.0 + t * (3.0 * k[0] + t * (5.0 * k[1] + t * (7.0 * k[2] + 9.0 * t * k[3])))
    rate = (along / (1.0 + s) - scale) / s
    mixed = x * y * rate
    return Jacobian(scale + x * x * rate, mixed, mixed, scale + y * y * rate)


# What follows is short for lenses without distortion, so that the compiler inlines it.


@njit(cache=True, error_model="numpy")
def pixel(lens: Lens, x: float, y: float) -> tuple[float, float]:
    """Pixel coordinates (u, v) of normalized ones, Eq. (15), (17) and the lens's distortion."""
    if lens.model != NO_DISTORTION:
        x, y = distort(lens, x, y)
    return lens.fx * x + lens.cx, lens.fy * y + lens.cy


@njit(cache=True, error_model="numpy")
def pixel_jacobian(lens: Lens, x: float, y: float) -> Jacobian:
    """Derivative of `pixel`."""
    if lens.model == NO_DISTORTION:
        return Jacobian(lens.fx, 0.0, 0.0, lens.fy)
    d = _distortion_jacobian(lens, x, y)
    return Jacobian(lens.fx * d.ux, lens.fx * d.uy, lens.fy * d.vx, lens.fy * d.vy)


@njit(cache=True, error_model="numpy")
def magnification(lens: Lens, x: float, y: float) -> float:
    """Pixels a unit of normalized length near a place: the root of the area's."""
    if lens.model == NO_DISTORTION or not x * x + y * y <= lens.max_radius_squared:
        return lens.fx if lens.fx == lens.fy else math.sqrt(lens.fx * lens.fy)
    ux, uy, vx, vy = pixel_jacobian(lens, x, y)
    return math.sqrt(abs(ux * vy - uy * vx))


@njit(cache=True, error_model="numpy")
def in_view(eye: Eye, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point of the rig's frame C in the camera's frame K, Eq. (16)."""
    R, p = eye.R_KC, eye.p_KC
    return (
        R[0] * x + R[1] * y + R[2] * z + p[0],
        R[3] * x + R[4] * y + R[5] * z + p[1],
        R[6] * x + R[7] * y + R[8] * z + p[2],
    )


@njit(cache=True, error_model="numpy")
def turned_back(eye: Eye, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector of the camera's frame K in the rig's frame C."""
    R = eye.R_KC
    return (
        R[0] * x + R[3] * y + R[6] * z,
        R[1] * x + R[4] * y + R[7] * z,
        R[2] * x + R[5] * y + R[8] * z,
    )


@njit(cache=True, error_model="numpy")
def project(lens: Lens, points: Array, jacobians: Array) -> Array:
    """Pixels of points in the camera's frame, shape (n, 3), NaN where they are not seen.

    Their derivatives go to ``jacobians``, shape (n, 2, 3), or nowhere if it is empty.
    """
    pixels = np.full((len(points), 2), np.nan)
    for j in range(len(points)):
        z = points[j, 2]
        x, y = points[j, 0] / z, points[j, 1] / z
        if not (z > 0.0 and x * x + y * y <= lens.max_radius_squared):
            continue
        u, v = pixel(lens, x, y)
        if not (math.isfinite(u) and math.isfinite(v)):
            continue  # farther aside than there are numbers
        pixels[j, 0], pixels[j, 1] = u, v
        if len(jacobians) > 0:
            ux, uy, vx, vy = pixel_jacobian(lens, x, y)
            jacobians[j, 0] = ux / z, uy / z, -(ux * x + uy * y) / z
            jacobians[j, 1] = vx / z, vy / z, -(vx * x + vy * y) / z
    return pixels


@njit(cache=True, error_model="numpy")
def measure_noise(views: tuple[View, ...]) -> float:
    """Standard deviation of the pixels' noise, from second differences along rows.

    Their median is that of plain areas, where they are noise alone. Where most of the pixels are
    like their neighbors, there is none.
    """
    count = 0
    for view in views:
        count += (len(view.pixels) - 2) // _NOISE_STEP + 1
    differences = np.empty(count)
    n = 0
    for view in views:
        pixels = view.pixels
        for k in range(1, len(pixels) - 1, _NOISE_STEP):
            c = n % 3
            twice = 2.0 * float(pixels[k, c])
            differences[n] = abs(float(pixels[k - 1, c]) - twice + float(pixels[k + 1, c]))
            n += 1
    # Of normal noise, whose second differences are sqrt(6) as large, the median is 0.6745
    return float(np.median(differences[:n])) / (0.6745 * math.sqrt(6.0))


@njit(cache=True, error_model="numpy")
def image_hash(view: View) -> float:
    """A number that tells an image from others, from every n-th pixel."""
    pixels, value = view.pixels, np.uint64(1469598103934665603)
    for k in range(0, len(pixels), _HASH_STEP):
        color = (np.uint64(pixels[k, 0]) << np.uint64(16)) | (
            np.uint64(pixels[k, 1]) << np.uint64(8)
        )
        # Fowler, Noll and Vo's hash, 1a
        value = (value ^ (color | np.uint64(pixels[k, 2]))) * np.uint64(1099511628211)
    return float(value >> np.uint64(12))  # A double holds 52 bits.
