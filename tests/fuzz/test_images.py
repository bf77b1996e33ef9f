"""Images of any type, shape and layout in memory: equal pixels give equal results, or one line
tells what an image must be."""

import math

import numpy as np
from hypothesis import example
from hypothesis import strategies as st
from judging import HEIGHT, NUMBERS, WIDTH, box, matcher, outcome, prop

import mffdrake as mff

POSES = np.array([[0.0, 0.0, 0.8, 0, 0, 0], [0.0, 0.02, 0.6, 0.2, -0.3, 0.1], [0.1, 0, 1, 0, 0, 0]])


def tracker(**options):
    return mff.PoseTracker.of(matcher().rig, box(), channel_order="rgb", **options)


@st.composite
def pictures(draw):
    """Two images, with a few colored rectangles on grey or noise."""
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    pair = np.full((2, HEIGHT, WIDTH, 3), draw(st.integers(0, 255)), dtype=np.uint8)
    if draw(st.booleans()):
        pair[:] = rng.integers(0, 256, pair.shape)
    for color in [(255, 0, 0), (0, 255, 0), (0, 0, 255)][: draw(st.integers(0, 3))]:
        u, v = draw(st.integers(0, WIDTH - 1)), draw(st.integers(0, HEIGHT - 1))
        pair[:, v : v + draw(st.integers(1, 30)), u : u + draw(st.integers(1, 30))] = color
    return list(pair)


def backwards(image):
    return np.ascontiguousarray(image[::-1, ::-1])[::-1, ::-1]


def channels_backwards(image):
    return np.ascontiguousarray(image[..., ::-1])[..., ::-1]


def spaced(image):
    wide = np.zeros((2 * HEIGHT, 3 * WIDTH, image.shape[2]), dtype=np.uint8)
    wide[::2, 1::3] = image
    return wide[::2, 1::3]


def fourth(image):
    alpha = np.arange(WIDTH * HEIGHT, dtype=np.uint8).reshape(HEIGHT, WIDTH, 1)
    return np.concatenate([image[..., :3], alpha], axis=2)


def locked(image):
    image = image.copy()
    image.flags.writeable = False
    return image


def unaligned(image):
    buffer = np.zeros(image.size + 1, dtype=np.uint8)
    buffer[1:] = image.ravel()
    return buffer[1:].reshape(image.shape)


LAYOUTS = [
    np.asfortranarray, backwards, channels_backwards, spaced, fourth, locked, unaligned,
    lambda image: np.ascontiguousarray(image.transpose(2, 0, 1)).transpose(1, 2, 0),
    lambda image: np.ascontiguousarray(image.transpose(1, 0, 2)).transpose(1, 0, 2),
    lambda image: fourth(image)[..., :3],
]  # fmt: skip
LAID_OUT = st.lists(st.sampled_from(LAYOUTS), max_size=3)


def laid_out(image, layouts):
    for layout in layouts:
        image = layout(image)
    return image


@prop(pictures(), LAID_OUT, LAID_OUT)
def test_fitness_depends_on_pixels_not_on_their_layout(images, first, second):
    same = [laid_out(images[0], first), laid_out(images[1], second)]
    expected = matcher().fitness(POSES, images)
    assert np.isfinite(expected).all()
    assert np.array_equal(matcher().fitness(POSES, same), expected)
    refiner = mff.BorderRefiner(matcher())
    one, other = refiner.refine(POSES[0], images), refiner.refine(POSES[0], same)
    assert one.outcome == other.outcome and np.array_equal(one.pose, other.pose)


@prop(pictures(), LAID_OUT, LAID_OUT, st.booleans(), share=0.1)
def test_tracks_depend_on_pixels_not_on_their_layout(images, first, second, refine):
    same = dict(
        zip(
            ("left", "right"),
            [laid_out(images[1], second), laid_out(images[0], first)],
            strict=True,
        )
    )
    one, other = tracker(refine=refine), tracker(refine=refine)
    for _ in range(2):
        expected, found = one.track(images), other.track(same)
        assert np.array_equal(found.pose, expected.pose) and np.isfinite(found.pose).all()
        assert found.fitness == expected.fitness and 0.0 <= found.fitness <= 1.0
        assert found.state == expected.state


SHAPES = st.one_of(
    st.sampled_from(
        [(), (0,), (HEIGHT, WIDTH), (HEIGHT, WIDTH, 1), (HEIGHT, WIDTH, 2), (HEIGHT, WIDTH, 5),
         (WIDTH, HEIGHT, 3), (HEIGHT, WIDTH, 3, 1), (1, HEIGHT, WIDTH, 3), (3, HEIGHT, WIDTH),
         (0, 0, 3), (HEIGHT, WIDTH, 3), (HEIGHT, WIDTH, 4), (HEIGHT * WIDTH, 3)]
    ),
    st.lists(st.integers(0, 70), max_size=4).map(tuple),
)  # fmt: skip
TYPES = st.sampled_from(
    ["u1", "i1", "u2", ">u2", "i4", "f4", "f8", "f2", "?", "c8", "O", "U1", "S1", "M8[s]", "V3"]
)
NO_IMAGES = st.one_of(
    st.none(),
    st.integers(),
    st.text(max_size=3),
    st.builds(lambda shape, kind: np.zeros(shape, dtype=kind), SHAPES, TYPES),
    st.builds(lambda: np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8).tolist()),
    st.builds(lambda: np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8).tobytes()),
)


@prop(
    st.one_of(
        NO_IMAGES,
        st.lists(NO_IMAGES, max_size=3),
        st.dictionaries(st.sampled_from(["right", "left", "x", 3, None]), NO_IMAGES, max_size=3),
    )
)
def test_what_is_no_image_is_told(images):
    outcome(matcher().fitness, POSES, images, error=ValueError)
    outcome(tracker(refine=False).track, images, error=ValueError)
    outcome(mff.BorderRefiner(matcher()).refine, POSES[0], images, error=ValueError)


@example([np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8)] * 2, (math.nan, 1.0, 1.0))
@prop(pictures(), st.tuples(NUMBERS, NUMBERS, NUMBERS))
def test_any_white_balance_gives_a_fitness_or_is_told(images, gains):
    fitness = outcome(matcher().fitness, POSES, images, gains=gains, error=ValueError)
    assert fitness is None or ((fitness >= 0.0) & (fitness <= 1.0)).all()
