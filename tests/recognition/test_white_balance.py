"""The gains follow the light's color while the target is tracked."""

import numpy as np
import pytest
from synthetic import paper_box, pose, render

from mffdrake.recognition import (
    AdaptiveWhiteBalance,
    CameraRig,
    FaceColor,
    FixedWhiteBalance,
    Matcher,
    MatchingParameters,
    NearStart,
    OneStepGaTracker,
    SearchModel,
    SolidModel,
)
from mffdrake.recognition.fitness.colors import ColorModel, hue_chroma_value
from mffdrake.recognition.fitness.matching import NO_GAINS

RIG = CameraRig.stereo(width=320, height=240)
TRUTH = pose((0.02, 0.05, 0.7), (0.2, 0.3, 0.1))
COLORS = {"brick": (190, 90, 60), "leaf": (90, 170, 80), "sky": (80, 110, 200)}
"""Colors as real faces have them: red light shifts all of their hues."""


def painted(light=(1.0, 1.0, 1.0)):
    """The box in real colors under some light: the solid and its images."""
    box = paper_box()
    names = [list(COLORS)[k // 2] for k in range(6)]
    solid = SolidModel(box.vertices, box.faces, box.hues, names)
    images = []
    for image in render(box, TRUTH, RIG):
        real = np.full(image.shape, 110.0) * light
        for k, color in enumerate(COLORS.values()):
            pure = np.zeros(3)
            pure[k] = 255
            real[(image == pure).all(axis=-1)] = np.array(color) * light
        images.append(np.clip(np.rint(real), 0, 255).astype(np.uint8))
    return solid, images


def matcher(solid, tolerance_deg=12.0):
    colors = tuple(
        FaceColor(name, float(hue_chroma_value(rgb)[0]), np.radians(tolerance_deg))
        for name, rgb in COLORS.items()
    )
    model = ColorModel(colors=colors)
    return Matcher(SearchModel(solid), RIG, MatchingParameters(), model)


def settle(m, images, rate=0.02, frames=60):
    gains, scene = (1.0, 1.0, 1.0), m.scene(images)
    for _ in range(frames):
        gains = AdaptiveWhiteBalance(rate).adapt(gains, TRUTH, scene, m)
    return gains


@pytest.mark.parametrize("light", [(1.15, 1.0, 0.87), (0.9, 1.0, 1.1), (1.0, 1.0, 1.0)])
def test_the_gains_settle_where_they_undo_the_light(light):
    solid, images = painted(light)
    red, green, blue = settle(matcher(solid), images)
    assert green == 1.0
    np.testing.assert_allclose([red, blue], [1 / light[0], 1 / light[2]], rtol=0.03)


def test_a_frame_changes_no_gain_by_more_than_the_rate():
    solid, images = painted((1.15, 1.0, 0.87))
    m = matcher(solid)
    red, _, blue = AdaptiveWhiteBalance(0.005).adapt(NO_GAINS, TRUTH, m.scene(images), m)
    assert np.log(red) == pytest.approx(-0.005)
    assert np.log(blue) == pytest.approx(0.005)


def test_a_light_that_changes_slowly_is_followed_to_where_fixed_colors_lose_the_target():
    solid, _ = painted()
    results = {}
    for kind in (FixedWhiteBalance(), AdaptiveWhiteBalance(0.01)):
        m = matcher(solid)
        tracker = OneStepGaTracker(matcher=m, start=NearStart(TRUTH), white_balance=kind)
        generation = tracker.start_population(painted()[1])
        for frame in range(1, 60):
            share = min(1.0, frame / 40)
            _, images = painted((1.0 + 0.35 * share, 1.0, 1.0 - 0.3 * share))
            generation = tracker.track(generation, images, frame=frame)
        results[type(kind)] = generation
    assert results[FixedWhiteBalance].fitness[0] < 0.5
    assert results[FixedWhiteBalance].gains == (1.0, 1.0, 1.0)
    adapted = results[AdaptiveWhiteBalance]
    assert adapted.fitness[0] > 0.95
    assert np.linalg.norm(adapted.best[:3] - TRUTH[:3]) < 0.005


def test_without_a_sure_pose_the_gains_stay():
    solid, images = painted((1.1, 1.0, 0.9))
    away = TRUTH + [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]
    tracker = OneStepGaTracker(
        matcher=matcher(solid), start=NearStart(away, (1e-4, 1e-4)),
        white_balance=AdaptiveWhiteBalance(0.02),
    )  # fmt: skip
    assert tracker.start_population(images).gains == (1.0, 1.0, 1.0)


def test_where_no_pixel_tells_anything_the_gains_stay():
    solid, images = painted()
    black = [np.zeros_like(image) for image in images]
    gains, m = (1.1, 1.0, 0.9), matcher(solid)
    assert AdaptiveWhiteBalance(0.02).adapt(gains, TRUTH, m.scene(black), m) == gains


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan])
def test_the_rate_must_be_positive(rate):
    with pytest.raises(ValueError, match="white balance: rate must be"):
        AdaptiveWhiteBalance(rate)
