"""Which pixels show which color, against `colorsys`, and how colors are learned from pixels."""

import colorsys
import itertools
import math

import numpy as np
import pytest

from mffdrake.recognition import ColorModel, FaceColor
from mffdrake.recognition.fitness.colors import hue_chroma_value, learn_color

PRIMARIES = ColorModel.of_hues(
    {"red": 0.0, "green": math.radians(120), "blue": math.radians(240)},
    tolerance=math.radians(20.3),
)
UNEVEN = ColorModel(
    colors=(
        FaceColor("wine", math.radians(-8.1), math.radians(25.3)),
        FaceColor("orange", math.radians(28), math.radians(14.7)),
        FaceColor("amber", math.radians(33), math.radians(15.1)),  # hardly another than orange
        FaceColor("leaf", math.radians(115), math.radians(50.3)),
        FaceColor("sky", math.radians(200), math.radians(5.3)),
    ),
    min_saturation=0.41,
    min_value=0.33,
    min_chroma=0.27,
)
OPEN = ColorModel.of_hues(
    {"warm": 0.3, "cold": 3.6}, tolerance=3.0, min_saturation=0.0, min_value=0.0, min_chroma=0.0
)
MODELS = {"primaries": PRIMARIES, "uneven": UNEVEN, "open": OPEN}

models = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def turn(a, b):
    """How far two hues are apart on the color circle."""
    return abs(math.remainder(a - b, 2.0 * math.pi))


def brute_force(model, rgb):
    """The names of the colors that a pixel shows, a set."""
    hue, saturation, value = colorsys.rgb_to_hsv(*(float(c) / 255.0 for c in rgb))
    hue *= 2.0 * math.pi
    if saturation == 0.0 or saturation < model.min_saturation or value < model.min_value:
        return set()
    if saturation * value < model.min_chroma:
        return set()
    nearest = min(model.colors, key=lambda color: turn(hue, color.hue))
    return {
        color.name
        for color in model.colors
        if turn(hue, color.hue) <= color.tolerance
        and turn(color.hue, nearest.hue) <= 0.5 * min(color.tolerance, nearest.tolerance)
    }


def names_of(model, bits):
    """The names of the colors whose bits are set."""
    assert bits >> len(model.names) == 0
    return {name for k, name in enumerate(model.names) if bits >> k & 1}


def looked_up(gate, pixels):
    """The bits that a look-up table gives for 8-bit pixels, shape (n, 3)."""
    red, green, blue = np.asarray(pixels, dtype=int).T
    return gate.table[gate.places[0, red] + gate.places[1, green] + gate.places[2, blue]]


def color_of(hue_deg, saturation=1.0, value=1.0):
    """RGB from 0 to 255, not rounded."""
    return [255.0 * c for c in colorsys.hsv_to_rgb(hue_deg / 360.0 % 1.0, saturation, value)]


# The formula


def test_hue_chroma_and_value_are_those_of_colorsys():
    rgb = np.random.default_rng(0).integers(0, 256, (500, 3))
    rgb = np.vstack([rgb, list(itertools.product((0, 128, 255), repeat=3))])
    hue, chroma, value = hue_chroma_value(rgb.reshape(-1, 1, 3))
    assert hue.shape == chroma.shape == value.shape == (len(rgb), 1)
    expected = np.array([colorsys.rgb_to_hsv(*(pixel / 255.0)) for pixel in rgb])
    np.testing.assert_allclose(hue[:, 0], 2.0 * math.pi * expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(chroma[:, 0], expected[:, 1] * expected[:, 2], atol=1e-12)
    np.testing.assert_allclose(value[:, 0], expected[:, 2])


@models
def test_a_pixel_shows_the_colors_that_brute_force_finds(model):
    pixels = np.random.default_rng(1).integers(0, 256, (4000, 3), dtype=np.uint8)
    expected = [brute_force(model, rgb) for rgb in pixels]
    assert {name for shown in expected for name in shown} == set(model.names)
    assert model is OPEN or sum(not shown for shown in expected) > 400
    found = model.classify(pixels)
    assert [names_of(model, bits) for bits in found] == expected


def test_pixels_keep_their_shape_and_an_alpha_channel_does_not_count():
    rgba = np.random.default_rng(2).integers(0, 256, (4, 5, 4), dtype=np.uint8)
    found = UNEVEN.classify(rgba)
    assert found.shape == (4, 5)
    np.testing.assert_array_equal(found.ravel(), UNEVEN.classify(rgba.reshape(-1, 4)[:, :3]))


@pytest.mark.parametrize(
    ("hue_deg", "shown"),
    [(0, {"a"}), (19, {"a"}), (21, {"b"}), (59, {"b"}), (61, set()), (-31, set()), (-29, {"a"})],
)
def test_of_two_colors_within_the_tolerance_the_nearest_is_shown(hue_deg, shown):
    model = ColorModel(
        colors=(
            FaceColor("a", 0.0, math.radians(30.0)),
            FaceColor("b", math.radians(40.0), math.radians(20.0)),
        )
    )
    assert names_of(model, model.classify(color_of(hue_deg))) == shown


def test_a_color_is_not_shown_where_another_s_hue_is_nearer_though_out_of_tolerance():
    a = FaceColor("a", 0.0, math.radians(40.0))
    narrow = FaceColor("narrow", math.radians(45.0), math.radians(5.0))
    pixel = color_of(30.0)
    assert ColorModel(colors=(a,)).classify(pixel) == 1
    assert ColorModel(colors=(a, narrow)).classify(pixel) == 0


@pytest.mark.parametrize(("apart_deg", "both"), [(9.9, True), (10.1, False)])
def test_colors_that_can_hardly_be_told_apart_are_shown_together(apart_deg, both):
    model = ColorModel.of_hues(
        {"a": 0.0, "b": math.radians(apart_deg)}, tolerance=math.radians(20.0)
    )
    for hue_deg, nearest in ((0.3 * apart_deg, "a"), (0.7 * apart_deg, "b")):
        expected = {"a", "b"} if both else {nearest}
        assert names_of(model, model.classify(color_of(hue_deg))) == expected


@pytest.mark.parametrize(
    ("pixel", "shown"),
    [
        (color_of(0, saturation=0.31), True), (color_of(0, saturation=0.29), False),
        (color_of(0, value=0.21), True), (color_of(0, value=0.19), False),
        (color_of(0, saturation=0.5, value=0.31), True),  # chroma 0.155
        (color_of(0, saturation=0.5, value=0.29), False),  # chroma 0.145
        ([0, 0, 0], False), ([128, 128, 128], False), ([255, 255, 255], False),
    ],
)  # fmt: skip
def test_a_pixel_has_a_hue_above_all_gates(pixel, shown):
    model = ColorModel.of_hues(
        {"red": 0.0}, tolerance=0.3, min_saturation=0.3, min_value=0.2, min_chroma=0.15
    )
    assert (model.classify(pixel) == 1) == shown


@pytest.mark.parametrize("level", [0, 1, 128, 255])
def test_grey_has_no_hue_even_without_gates(level):
    assert OPEN.classify([level] * 3) == 0
    assert looked_up(OPEN.gate(), [[level] * 3]) == [0]


def test_as_many_colors_as_bits():
    model = ColorModel.of_hues(
        {f"{k}": 2.0 * math.pi * k / 32.0 for k in range(32)}, tolerance=math.radians(5.0)
    )
    pixels = [color_of(360.0 * k / 32.0) for k in range(32)]
    np.testing.assert_array_equal(model.classify(pixels), 2 ** np.arange(32))
    found = looked_up(model.gate(), np.rint(pixels))
    np.testing.assert_array_equal(found, 2 ** np.arange(32))


# Pairs


def test_colors_overlap_whose_hues_both_accept():
    assert PRIMARIES.overlaps() == []
    # -8.1 +- 25.3, 28 +- 14.7, 33 +- 15.1, 115 +- 50.3, 200 +- 5.3
    assert UNEVEN.overlaps() == [("wine", "orange"), ("orange", "amber")]
    assert OPEN.overlaps() == [("warm", "cold")]


@models
def test_pixels_of_overlapping_colors_are_those_that_either_alone_would_accept(model):
    alone = [ColorModel(colors=(c,), **gates_of(model)) for c in model.colors]
    pixels = np.array([color_of(deg) for deg in np.arange(0.0, 360.0, 0.1)])
    accepted = np.array([one.classify(pixels) == 1 for one in alone])
    overlapping = {
        (model.names[i], model.names[j])
        for i, j in itertools.combinations(range(len(alone)), 2)
        if (accepted[i] & accepted[j]).any()
    }
    assert overlapping == set(model.overlaps())
    alike = model.alike(model.names)
    for (i, a), (j, b) in itertools.product(enumerate(model.names), repeat=2):
        assert alike[i, j] == (a == b or (a, b) in overlapping or (b, a) in overlapping)


def gates_of(model):
    return {name: getattr(model, name) for name in ("min_saturation", "min_value", "min_chroma")}


def test_materials_have_the_bits_and_the_likeness_of_their_colors():
    materials = ["leaf", "wine", "leaf", "orange"]
    np.testing.assert_array_equal(UNEVEN.bits_of(materials), [8, 1, 8, 2])
    same = [[1, 0, 1, 0], [0, 1, 0, 1], [1, 0, 1, 0], [0, 1, 0, 1]]
    np.testing.assert_array_equal(UNEVEN.alike(materials), np.array(same, dtype=bool))


def test_colors_that_cannot_be_told_apart_count_as_the_first_of_them():
    materials = ("sky", "amber", "leaf", "orange", "wine", "amber")
    np.testing.assert_array_equal(UNEVEN.first_alike(materials), [4, 1, 3, 1, 0, 1])
    np.testing.assert_array_equal(PRIMARIES.first_alike(PRIMARIES.names), [0, 1, 2])
    twins = ColorModel.of_hues({"a": 1.0, "b": 3.0, "c": 1.0, "d": 3.0}, tolerance=0.0)
    np.testing.assert_array_equal(twins.first_alike("dcba"), [1, 0, 1, 0])
    # What overlaps a little can be told apart.
    near = ColorModel.of_hues({"a": 1.0, "b": 1.3}, tolerance=0.4)
    assert near.overlaps() == [("a", "b")]
    np.testing.assert_array_equal(near.first_alike("ab"), [0, 1])
    with pytest.raises(ValueError, match="pink"):
        UNEVEN.first_alike(["pink"])


# The look-up table


@models
def test_the_table_is_the_formula_but_within_a_cell_at_a_border(model):
    # A cell holds four values of each channel. Where its eight corners agree, so does all of it.
    low = 4 * np.arange(64)
    corners = np.stack(
        [
            model.classify(np.stack(np.meshgrid(low + a, low + b, low + c, indexing="ij"), axis=-1))
            for a, b, c in itertools.product((0, 3), repeat=3)
        ]
    ).reshape(8, -1)
    agree = (corners == corners[0]).all(axis=0)
    gate = model.gate()
    np.testing.assert_array_equal(gate.table[agree], corners[0, agree])
    assert agree.mean() > 0.7
    # What the compiled functions look up is that cell.
    pixels = np.random.default_rng(3).integers(0, 256, (2000, 3))
    cells = pixels // 4 @ [64 * 64, 64, 1]
    np.testing.assert_array_equal(looked_up(gate, pixels), gate.table[cells])


@models
def test_a_cell_shows_what_its_middle_shows(model):
    pixels = np.random.default_rng(4).integers(0, 256, (3000, 3))
    expected = [brute_force(model, 4 * (rgb // 4) + 1.5) for rgb in pixels]
    found = looked_up(model.gate(), pixels)
    assert [names_of(model, bits) for bits in found] == expected
    # At most one pixel in eight, all over the cube, is told otherwise than by the formula.
    assert np.mean(found != model.classify(pixels)) < 0.125


def test_the_order_of_the_channels_counts():
    pixels = np.random.default_rng(5).integers(0, 256, (2000, 3))
    rgb, bgr = UNEVEN.gate(), UNEVEN.gate(channel_order="bgr")
    expected = looked_up(rgb, pixels)
    np.testing.assert_array_equal(looked_up(bgr, pixels[:, ::-1]), expected)
    assert np.mean(looked_up(bgr, pixels) != expected) > 0.2
    # Gains are of red, green and blue, in whatever order these come.
    gains = (1.5, 1.0, 0.6)
    rgb, bgr = (UNEVEN.gate(channel_order=order, gains=gains) for order in ("rgb", "bgr"))
    np.testing.assert_array_equal(looked_up(bgr, pixels[:, ::-1]), looked_up(rgb, pixels))


@models
def test_gains_multiply_red_green_and_blue_before(model):
    pixels, gains = np.random.default_rng(6).integers(0, 256, (2000, 3)), np.array([1.7, 1.0, 0.55])
    balanced = np.clip(np.rint(pixels * gains), 0, 255)
    found = looked_up(model.gate(gains=gains), pixels)
    np.testing.assert_array_equal(found, looked_up(model.gate(), balanced))
    assert np.mean(found != looked_up(model.gate(), pixels)) > 0.1


# Learning


def face_pixels(rng, count, hue_deg, spread_deg):
    """Pixels of a face, their hues normally distributed, with all kinds of light."""
    hues = rng.normal(hue_deg, spread_deg, count)
    light = np.column_stack([rng.uniform(0.7, 1.0, count), rng.uniform(0.5, 1.0, count)])
    return [color_of(hue, *sv) for hue, sv in zip(hues, light, strict=True)]


OUTLIERS = {
    "none": lambda rng, hue: [],
    "grey": lambda rng, hue: [[128, 128, 128]] * 250,
    "dark": lambda rng, hue: [color_of(hue + 100, value=0.1)] * 250,
    "anything": lambda rng, hue: [color_of(deg) for deg in rng.uniform(0, 360, 250)],
    "another face": lambda rng, hue: face_pixels(rng, 250, hue + 120, 3.0),
    "a near face": lambda rng, hue: face_pixels(rng, 250, hue - 45, 3.0),
    "opposite": lambda rng, hue: face_pixels(rng, 250, hue + 180, 3.0),
}


@pytest.mark.parametrize("outliers", OUTLIERS.values(), ids=OUTLIERS)
@pytest.mark.parametrize("hue_deg", [0.0, 3.0, 120.0, 357.0])
def test_hue_and_tolerance_are_learned_though_a_fifth_belongs_to_something_else(hue_deg, outliers):
    rng = np.random.default_rng(7)
    pixels = [*face_pixels(rng, 1000, hue_deg, 3.0), *outliers(rng, hue_deg)]
    learned = learn_color("leaf", rng.permutation(pixels), PRIMARIES)
    assert learned.name == "leaf"
    assert 0.0 <= learned.hue < 2.0 * math.pi
    assert math.degrees(turn(learned.hue, math.radians(hue_deg))) < 0.7
    # Three standard deviations; a few of the evenly spread outliers look like the face.
    assert math.degrees(learned.tolerance) == pytest.approx(9.0, rel=0.3)


def test_learned_colors_accept_what_they_were_learned_from():
    rng = np.random.default_rng(8)
    colors = []
    samples = {"red": (5, 2), "green": (130, 4), "blue": (235, 1)}
    for name, (hue, spread) in samples.items():
        colors.append(learn_color(name, face_pixels(rng, 400, hue, spread), PRIMARIES))
    model = ColorModel(colors=tuple(colors), **gates_of(PRIMARIES))
    for k, (hue, spread) in enumerate(samples.values()):
        shown = model.classify(face_pixels(rng, 400, hue, spread))
        assert np.mean(shown == 1 << k) > 0.99


def test_no_color_is_narrower_than_five_degrees():
    learned = learn_color("leaf", [color_of(120)] * 30, PRIMARIES)
    assert math.degrees(learned.tolerance) == pytest.approx(5.0)
    assert math.degrees(learned.hue) == pytest.approx(120.0)


def test_too_few_colorful_pixels_teach_nothing():
    grey, green = [[128, 128, 128]] * 50, [color_of(120)]
    with pytest.raises(ValueError, match="color 'leaf': only 19 of 69 pixels"):
        learn_color("leaf", grey + 19 * green, PRIMARIES)
    assert learn_color("leaf", grey + 20 * green, PRIMARIES).name == "leaf"
    with pytest.raises(ValueError, match="color 'leaf': only 0 of 0 pixels"):
        learn_color("leaf", np.empty((0, 3)), PRIMARIES)


# What does not make sense


def test_hues_are_taken_around_the_circle():
    for hue_deg in (-90.0, 270.0, 630.0):
        assert FaceColor("a", math.radians(hue_deg), 0.1).hue == pytest.approx(1.5 * math.pi)


@pytest.mark.parametrize(
    ("hue", "tolerance", "message"),
    [
        (math.nan, 0.1, "hue must be finite"), (math.inf, 0.1, "hue must be finite"),
        (0.0, -0.1, "tolerance"), (0.0, 3.2, "tolerance"), (0.0, math.nan, "tolerance"),
    ],
)  # fmt: skip
def test_colors_out_of_range_are_named(hue, tolerance, message):
    with pytest.raises(ValueError, match=f"color 'leaf'.*{message}"):
        FaceColor("leaf", hue, tolerance)


@pytest.mark.parametrize("name", ["min_saturation", "min_value", "min_chroma"])
@pytest.mark.parametrize("value", [-0.1, 1.1, math.nan])
def test_gates_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        ColorModel(colors=PRIMARIES.colors, **{name: value})


def test_colors_must_differ_in_name_and_be_from_1_to_32():
    red = FaceColor("red", 0.0, 0.1)
    with pytest.raises(ValueError, match="different names, not.*'red', 'red'"):
        ColorModel(colors=(red, red))
    with pytest.raises(ValueError, match="from 1 to 32 colors, not 0"):
        ColorModel(colors=())
    with pytest.raises(ValueError, match="from 1 to 32 colors, not 33"):
        ColorModel(colors=tuple(FaceColor(f"{k}", 0.1 * k, 0.1) for k in range(33)))


@pytest.mark.parametrize(
    ("materials", "message"),
    [
        (["red", "pink"], "material pink; there are colors for red, green, blue"),
        (["pink", "olive", "red"], "materials olive, pink; there are colors for red, green, blue"),
    ],
)
def test_materials_without_a_color_are_named(materials, message):
    with pytest.raises(ValueError, match=message):
        PRIMARIES.bits_of(materials)
    with pytest.raises(ValueError, match=message):
        PRIMARIES.alike(materials)
