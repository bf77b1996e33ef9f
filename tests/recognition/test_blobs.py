"""Grids, blobs of color, and appearances of a solid from many sides."""

import math

import cv2
import numpy as np
import pytest
from synthetic import (
    LENSES,
    hexagonal_prism,
    odd_camera,
    paper_box,
    pose,
    quaternion_vector,
    render,
    unproject,
)

from mffdrake.recognition import Camera, CameraRig, Distortion, Matcher, SearchModel, SolidModel
from mffdrake.recognition.poses.pose import quaternion_scalar
from mffdrake.recognition.visibility.aspects import as_drawn

_blobs = pytest.importorskip("mffdrake.recognition.acquisition.blobs")
_lens = pytest.importorskip("mffdrake.recognition.camera.lens")
_appearance = pytest.importorskip("mffdrake.recognition.acquisition.appearance")
_rotations = pytest.importorskip("mffdrake.recognition.poses.rotations")

PLAIN = Camera(width=160, height=120, fx=145.0, fy=150.0, cx=77.0, cy=61.5)
SOLIDS = {"box": paper_box(), "prism": hexagonal_prism()}


def grid_of(camera, step=1):
    return _blobs.Grid(*_blobs.make_grid(camera.eye.lens, camera.width, camera.height, step))


def pixels_of(grid):
    """Pixel coordinates (u, v) of a grid, shape (height, width) each."""
    h, w = grid.x.shape
    return np.meshgrid(
        np.arange(w) * grid.step + grid.step // 2, np.arange(h) * grid.step + grid.step // 2
    )


# Grids


@pytest.mark.parametrize("step", [1, 4, 7])
@pytest.mark.parametrize("lens", LENSES)
def test_the_grid_inverts_the_lens(lens, step):
    camera = odd_camera(lens, width=320, height=240)
    grid = grid_of(camera, step)
    assert grid.x.shape == (240 // step, 320 // step)
    seen = np.isfinite(grid.x)
    assert seen.mean() > 0.9
    u, v = pixels_of(grid)
    assert u.max() < 320 and v.max() < 240
    rays = np.stack([grid.x, grid.y, np.ones_like(grid.x)], axis=-1)[seen]
    shown = camera.project(rays @ camera.R_CK.T + camera.p_CK)
    np.testing.assert_allclose(shown, np.column_stack([u[seen], v[seen]]), atol=1e-6)
    x, y = unproject(camera, u[seen].astype(float), v[seen].astype(float))
    np.testing.assert_allclose(grid.x[seen], x, atol=1e-6)
    np.testing.assert_allclose(grid.y[seen], y, atol=1e-6)


def test_the_grid_ends_where_the_lens_does():
    # A fisheye whose circle, nearly 89 deg about the axis, lies within the image
    wide = Camera(
        width=160, height=160, fx=50.0, fy=50.0, cx=79.5, cy=79.5,
        distortion=Distortion("equidistant", (0.0, 0.0, 0.0, 0.0)),
    )  # fmt: skip
    # and a polynomial, r - 0.3 r^3, that folds back from r = 1 / sqrt(0.9) on
    folded = Camera(
        width=160, height=160, fx=100.0, fy=100.0, cx=79.5, cy=79.5,
        distortion=Distortion("plumb_bob", (-0.3, 0.0, 0.0, 0.0)),
    )  # fmt: skip
    circles = (50.0 * math.radians(89.0), 100.0 * 2.0 / 3.0 / math.sqrt(0.9))
    for camera, circle in zip((wide, folded), circles, strict=True):
        grid = grid_of(camera)
        u, v = pixels_of(grid)
        radius = np.hypot(u - 79.5, v - 79.5)
        assert np.isfinite(grid.x[radius < circle - 2.0]).all()
        assert np.isnan(grid.x[radius > circle + 0.5]).all()
        assert np.isnan(grid.y[radius > circle + 0.5]).all()


@pytest.mark.parametrize("lens", ["none", "barrel", "pincushion", "equidistant"])
def test_the_areas_add_up_to_the_image_s(lens):
    camera = odd_camera(lens, width=320, height=240)
    rim = np.linspace(0.0, 1.0, 400, endpoint=False)
    u = np.concatenate([320 * rim, np.full(400, 320.0), 320 * (1 - rim), np.zeros(400)]) - 0.5
    v = np.concatenate([np.zeros(400), 240 * rim, np.full(400, 240.0), 240 * (1 - rim)]) - 0.5
    x, y = unproject(camera, u, v)
    outline = np.column_stack([x, y]).astype(np.float32)
    assert np.nansum(grid_of(camera).area) == pytest.approx(cv2.contourArea(outline), rel=2e-3)


# Labels


def test_labels_are_the_classes_of_what_the_pixels_show():
    rng = np.random.default_rng(0)
    matcher = Matcher(SearchModel(SOLIDS["prism"]), CameraRig((PLAIN,)))
    image = rng.integers(0, 256, size=(120, 160, 3), dtype=np.uint8)
    scene = matcher.scene([image])
    grid = grid_of(PLAIN, 3)
    grid.x[5:9, 7:20] = np.nan
    classes = np.full(32, -1, dtype=np.int8)
    classes[:8] = rng.permutation(8)
    classes[3] = -1  # another thing's color
    labels = _blobs.label_pixels(scene.views[0], grid, scene.gate, classes)
    u, v = pixels_of(grid)
    cells = (image[v, u] >> 2) * 4 + 1.5  # The table tells colors by their upper six bits.
    shown = matcher.colors.classify(cells)
    expected = np.full(labels.shape, -1)
    for bit in range(8):
        expected[shown == 1 << bit] = classes[bit]
    expected[5:9, 7:20] = -1
    np.testing.assert_array_equal(labels, expected)
    assert set(np.unique(labels)) == set(classes)


# Blobs


def random_labels(seed, share=0.45, shape=(60, 80)):
    """Three colors in ragged patches."""
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), 1.2)
    labels = np.where(noise > np.quantile(noise, 1.0 - share), 0, -1).astype(np.int8)
    which = cv2.GaussianBlur(rng.normal(size=(*shape, 3)), (0, 0), 2.5).argmax(axis=-1)
    return np.where(labels < 0, labels, which).astype(np.int8)


def patches_by_opencv(labels, of_one_color, least):
    """Color (-1 for any) and mask of every connected patch that is large enough."""
    found = []
    for color in np.unique(labels[labels >= 0]) if of_one_color else [-1]:
        mask = (labels == color) if of_one_color else labels >= 0
        count, numbers, stats, _ = cv2.connectedComponentsWithStats(
            mask.astype(np.uint8), connectivity=8
        )
        found += [
            (int(color), numbers == k)
            for k in range(1, count)
            if stats[k, cv2.CC_STAT_AREA] >= least
        ]
    # As the first pixel of each comes
    return sorted(found, key=lambda patch: np.flatnonzero(patch[1])[0])


def numbers_of(colors, moments):
    """Appearances as rows: share, x and y of each color, and xx, xy, yy."""
    count = len(moments)
    colors = colors.view(float).reshape(count, 3 * colors.shape[1])
    return np.hstack([colors, moments.view(float).reshape(count, 3)])


def appearances_of(numbers):
    """The inverse of `numbers_of`."""
    colors = np.ascontiguousarray(numbers[:, :-3]).view(_appearance.COLOR)
    moments = np.ascontiguousarray(numbers[:, -3:]).view(_appearance.SECOND_MOMENTS)
    return _appearance.Appearances(colors, moments[:, 0].copy())


def appearance_of(mask, labels, grid, direction, num_colors):
    """Area and appearance of a patch along a direction, by OpenCV's rotation and plain sums."""
    z = np.array([*direction, 1.0]) / np.linalg.norm([*direction, 1.0])
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine = np.linalg.norm(axis)
    turn = axis if sine == 0.0 else axis / sine * math.atan2(sine, z[2])
    rays = np.stack([grid.x[mask], grid.y[mask], np.ones(mask.sum())], axis=-1)
    turned = rays @ cv2.Rodrigues(turn)[0]
    p = turned[:, :2] / turned[:, 2:]
    # A plane's area seen under an angle: by the cosine, at the distance 1 / cosine
    area = grid.area[mask] * (np.linalg.norm(rays, axis=1) / (rays @ z)) ** 3
    area = area / np.linalg.norm(rays, axis=1) ** 3
    total = area.sum()
    middle = area @ p / total
    off = (p - middle) / math.sqrt(total)
    numbers = []
    for color in range(num_colors):
        here = labels[mask] == color
        numbers += [area[here].sum() / total, *(area[here] @ off[here] / total)]
    second = np.einsum("n,ni,nj->ij", area, off, off) / total
    return total, np.array([*numbers, second[0, 0], second[0, 1], second[1, 1]])


@pytest.mark.parametrize("of_one_color", [False, True])
@pytest.mark.parametrize("least", [1, 6, 40])
def test_blobs_are_opencv_s_connected_components(of_one_color, least):
    compared = 0
    for seed in range(6):
        labels = random_labels(seed, share=0.25 + 0.05 * seed)
        camera = odd_camera("barrel" if seed % 2 else "none", width=320, height=240)
        grid = grid_of(camera, 4)
        found, *appearances = _blobs.find_blobs(labels, grid, seed, 3, of_one_color, least)
        expected = patches_by_opencv(labels, of_one_color, least)
        seen = numbers_of(*appearances)
        assert len(found) == len(seen) == len(expected)
        for blob, numbers, (color, mask) in zip(found, seen, expected, strict=True):
            assert (blob["camera"], blob["color"]) == (seed, color)
            j, i = np.nonzero(mask)
            meets = j.min() == 0 or i.min() == 0 or j.max() == 59 or i.max() == 79
            assert blob["clipped"] == meets
            weights = grid.area[mask] / grid.area[mask].sum()
            assert blob["x"] == pytest.approx(weights @ grid.x[mask], abs=1e-12)
            assert blob["y"] == pytest.approx(weights @ grid.y[mask], abs=1e-12)
            area, expected_numbers = appearance_of(mask, labels, grid, (blob["x"], blob["y"]), 3)
            assert blob["area"] == pytest.approx(area, rel=1e-9)
            np.testing.assert_allclose(numbers, expected_numbers, atol=1e-9)
            compared += 1
    assert compared >= 20


def test_a_blob_s_area_and_moments_are_opencv_s_where_the_lens_is_plain_and_it_lies_ahead():
    labels = np.full((120, 160), -1, dtype=np.int8)
    cv2.ellipse(labels, (77, 61), (30, 12), 35.0, 0.0, 360.0, 0, -1)
    camera = Camera(width=160, height=120, fx=5000.0, fy=5000.0, cx=77.0, cy=61.0)
    (blob,), *appearances = _blobs.find_blobs(labels, grid_of(camera), 0, 1, False, 1)
    (numbers,) = numbers_of(*appearances)
    m = cv2.moments((labels == 0).astype(np.uint8), binaryImage=True)
    assert blob["area"] * 5000.0**2 == pytest.approx(m["m00"], rel=1e-4)
    np.testing.assert_allclose(numbers[3:], [m["nu20"], m["nu11"], m["nu02"]], atol=1e-4)
    np.testing.assert_allclose(numbers[:3], [1.0, 0.0, 0.0], atol=1e-9)


def test_a_blob_cut_by_the_rim_of_the_lens_is_clipped():
    camera = Camera(
        width=160, height=160, fx=50.0, fy=50.0, cx=79.5, cy=79.5,
        distortion=Distortion("equidistant", (0.0, 0.0, 0.0, 0.0)),
    )  # fmt: skip
    grid = grid_of(camera)
    for reach, clipped in ((60, False), (79, True)):  # from the center; the lens's is 77.7 px
        labels = np.full((160, 160), -1, dtype=np.int8)
        labels[70:90, 100 : 80 + reach] = 0
        labels[np.isnan(grid.x)] = -1
        (blob,), *_ = _blobs.find_blobs(labels, grid, 0, 1, False, 6)
        assert blob["clipped"] == clipped


def test_no_labels_no_blobs():
    labels = np.full((120, 160), -1, dtype=np.int8)
    found, *appearances = _blobs.find_blobs(labels, grid_of(PLAIN), 0, 3, False, 6)
    assert len(found) == 0 and numbers_of(*appearances).shape == (0, 12)


# Appearances


@pytest.mark.parametrize("count", [500, 6000])
def test_turns_spread_evenly_over_all_orientations(count):
    turns = _appearance.spread_turns(count)
    np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-12)
    assert (turns[:, 0] >= 0.0).all()
    # Angles from any orientation are spread as (theta - sin theta) / pi.
    rng = np.random.default_rng(1)
    probes = rng.normal(size=(300, 4))
    probes /= np.linalg.norm(probes, axis=1, keepdims=True)
    probes[0] = [1.0, 0.0, 0.0, 0.0]
    angles = 2.0 * np.arccos(np.clip(np.abs(probes @ turns.T), 0.0, 1.0))
    ranks = (np.arange(count) + 0.5) / count
    for angle in angles[:40]:
        theta = np.sort(angle)
        assert np.abs((theta - np.sin(theta)) / math.pi - ranks).max() < 1.5 / math.sqrt(count)
    # No gaps: balls of twice the radius that would fill the space, theta^3 / 6 pi each, reach all.
    fill = (6.0 * math.pi / count) ** (1.0 / 3.0)
    assert angles.min(axis=1).max() < 2.0 * fill
    # Nor heaps: random ones come as near as 0.1 of that to each other.
    both = 2.0 * np.arccos(np.clip(np.abs(turns[:500] @ turns.T), 0.0, 1.0))
    both[np.arange(500), np.arange(500)] = np.inf
    assert both.min() > 0.2 * fill


@pytest.mark.parametrize("name", SOLIDS)
def test_appearances_are_those_of_the_solid_s_images(name):
    solid, distance = SOLIDS[name], 0.8
    off = np.array([0.03, -0.02, 0.01])  # The frame need not lie in the middle.
    solid = SolidModel(solid.vertices + off, solid.faces, solid.hues)
    camera = Camera(width=320, height=240, fx=600.0, fy=600.0, cx=159.5, cy=119.5)
    matcher = Matcher(SearchModel(solid), CameraRig((camera,)))
    by_bit = np.arange(32, dtype=np.int8)
    classes = np.array([matcher.colors.names.index(m) for m in solid.materials], dtype=np.int8)
    num_colors, turns = len(matcher.colors.names), _appearance.spread_turns(60)
    corners = _appearance.Corners(solid.vertices, solid.edges, solid.edge_faces)
    areas, centers, *appearances = _appearance.project_appearances(
        matcher.struct, corners, classes, num_colors, distance, turns
    )
    drawn = as_drawn(solid)
    coarse = _appearance.draw_appearances(drawn, classes, num_colors, distance, turns)
    np.testing.assert_allclose(coarse[0], areas, rtol=0.06)
    np.testing.assert_allclose(coarse[1], centers, atol=0.002)
    told = numbers_of(*appearances)
    np.testing.assert_allclose(numbers_of(*coarse[2:]), told, atol=0.02)
    grid = grid_of(camera)
    for turn, area, center, expected in zip(turns, areas, centers, told, strict=True):
        R = rotation_of(turn)
        psi = pose([0.0, 0.0, distance] - R @ solid.vertices.mean(axis=0), turn[1:])
        scene = matcher.scene(render(solid, psi, matcher.rig))
        labels = _blobs.label_pixels(scene.views[0], grid, scene.gate, by_bit)
        (blob,), *appearances = _blobs.find_blobs(labels, grid, 0, num_colors, False, 6)
        (numbers,) = numbers_of(*appearances)
        assert blob["area"] * distance**2 == pytest.approx(area, rel=0.02)
        middle = -distance * np.array([blob["x"], blob["y"]])
        np.testing.assert_allclose(center, middle, atol=5e-4)
        np.testing.assert_allclose(numbers[:-3], expected[:-3], atol=0.01)
        np.testing.assert_allclose(numbers[-3:], expected[-3:], atol=0.002)
    assert np.ptp(told, axis=0).min() > 0.04  # They differ, and so does each number.


def rotation_of(turn):
    """Rotation matrix of a quaternion with the scalar part first."""
    w, x, y, z = turn
    S = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * S + 2.0 * S @ S


def test_products_of_quaternions_are_those_of_rotations():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 20, 4))
    a, b = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in (a, b))
    products = _appearance.multiply_all(a[0], b)
    for q, product in zip(b, products, strict=True):
        np.testing.assert_allclose(product, _rotations.multiply(a[0], q), atol=1e-15)
        R = rotation_of(a[0]) @ rotation_of(q)
        np.testing.assert_allclose(rotation_of(product), R, atol=1e-12)
        eps = quaternion_vector(R)
        np.testing.assert_allclose(product, [quaternion_scalar(eps), *eps], atol=1e-7)


def test_the_most_similar_appearances_come_first():
    rng = np.random.default_rng(3)
    known, seen = rng.normal(size=(200, 9)), rng.normal(size=(10, 9))
    table = _appearance.AppearanceTable(
        np.zeros((200, 4)), np.ones(200), np.zeros((200, 2)), appearances_of(known)
    )
    weights = np.array([1.0] * 6 + [4.0] * 3)
    for n, numbers in enumerate(seen):
        similar = np.full(16, -1)
        _appearance.find_similar(appearances_of(seen), n, table, 16, similar)
        order = np.argsort(((numbers - known) ** 2) @ weights)
        np.testing.assert_array_equal(similar, order[:16])


# Noise


@pytest.mark.parametrize("deviation", [2.0, 5.0, 10.0])
def test_noise_is_measured_as_it_was_added(deviation):
    rig, found = CameraRig.stereo(width=320, height=240), []
    clean = render(SOLIDS["box"], pose((0.0, 0.1, 0.8), (0.1, 0.2, 0.1)), rig, brightness=0.8)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noisy = [im + rng.normal(0.0, deviation, im.shape) for im in clean]
        noisy = [np.clip(np.rint(im), 0, 255).astype(np.uint8) for im in noisy]
        found.append(_lens.measure_noise(rig.views(noisy)))
    # The median of whole numbers is off by up to a half.
    whole = 0.5 / (0.6745 * math.sqrt(6.0))
    assert np.mean(found) == pytest.approx(deviation, abs=whole + 0.03 * deviation)
    np.testing.assert_allclose(found, deviation, atol=whole + 0.15 * deviation)


def test_neither_a_clean_image_nor_one_with_a_few_wrong_pixels_has_noise():
    rig, rng = CameraRig.stereo(width=320, height=240), np.random.default_rng(5)
    clean = render(SOLIDS["box"], pose((0.0, 0.1, 0.8), (0.1, 0.2, 0.1)), rig, supersampling=3)
    assert _lens.measure_noise(rig.views(clean)) == 0.0
    for im in clean:
        wrong = rng.random(im.shape[:2])
        im[wrong < 0.01], im[wrong > 0.99] = 0, 255
    assert _lens.measure_noise(rig.views(clean)) == 0.0
