"""Genes and one generation: equations (23)-(28)."""

import math

import numpy as np
import pytest

from mffdrake.recognition import (
    POSE_COORDINATES,
    Camera,
    CameraRig,
    GeneCoding,
    GeneticAlgorithm,
    GeneticParameters,
    LocalMoveParameters,
    LocalMoves,
    SearchRange,
)

RANGE = SearchRange()
CODINGS = ("binary", "gray")
PLAIN = {
    "survivor_share": 0.5,
    "local_share": 0.0,
    "newcomer_share": 0.0,
    "first_candidates": 1,
}

codings = pytest.mark.parametrize("coding", CODINGS)


def grid(numbers, bits=12):
    """Poses whose six genes all have the given numbers, in [0, 2^bits)."""
    share = np.asarray(numbers)[:, None] / (2**bits - 1)
    return RANGE.lower + share * (RANGE.upper - RANGE.lower)


def still():
    """Local moves that do not move."""
    return LocalMoves(
        np.zeros((1, 3)), np.zeros(3), LocalMoveParameters(depth=0.0, shift=0.0, rotation_deg=0.0)
    )


def genetic(coding="binary", bits=12, moves=None, **parameters):
    return GeneticAlgorithm(
        GeneCoding(coding=coding, bits=bits),
        GeneticParameters(**parameters),
        still() if moves is None else moves,
    )


def rows(array):
    return [tuple(row) for row in array]


# The search range


def test_search_range_is_the_paper_s():
    np.testing.assert_array_equal(RANGE.lower, [-0.150, 0.0, 0.650, -0.5, -0.5, -0.5])
    np.testing.assert_array_equal(RANGE.upper, [0.150, 0.300, 0.950, 0.5, 0.5, 0.5])
    # "almost the same as +-60 deg"
    assert math.degrees(2 * math.asin(0.5)) == pytest.approx(60.0)


def test_coordinates_are_named_in_the_order_of_the_pose_vector():
    assert POSE_COORDINATES == ("x", "y", "z", "eps1", "eps2", "eps3")
    for i, name in enumerate(POSE_COORDINATES):
        changed = SearchRange(**{name: (0.1, 0.2)})
        assert (changed.lower[i], changed.upper[i]) == (0.1, 0.2)
        others = np.arange(6) != i
        np.testing.assert_array_equal(changed.lower[others], RANGE.lower[others])


@pytest.mark.parametrize("name", POSE_COORDINATES)
@pytest.mark.parametrize("bounds", [(0.3, 0.2), (0.2, 0.2), (0.2, math.nan), (0.1, 0.2, 0.3)])
def test_bounds_out_of_order_are_named(name, bounds):
    with pytest.raises(ValueError, match=f"SearchRange: {name}"):
        SearchRange(**{name: bounds})


@pytest.mark.parametrize("name", ["eps1", "eps2", "eps3"])
@pytest.mark.parametrize("bounds", [(-1.01, 0.5), (0.0, 1.01)])
def test_quaternion_components_stay_within_one(name, bounds):
    with pytest.raises(ValueError, match=f"SearchRange: {name}"):
        SearchRange(**{name: bounds})


def test_the_range_in_view_is_where_a_pinhole_sees_the_target_well():
    """Against the pyramid by hand: depths by the target's share of the image, and the sides."""
    camera = Camera(width=640, height=480, fx=600, fy=600, cx=319.5, cy=239.5)
    view = SearchRange.in_view(CameraRig((camera,)), 0.2)
    farthest = 600 * 0.2 / (0.1 * 480)
    assert view.z == pytest.approx((600 * 0.2 / (0.9 * 480), farthest))
    assert view.x == pytest.approx((-farthest * 319.5 / 600, farthest * 319.5 / 600))
    assert view.y == pytest.approx((-farthest * 239.5 / 600, farthest * 239.5 / 600))
    assert view.eps1 == view.eps2 == view.eps3 == (-1.0, 1.0)


def test_the_range_in_view_of_a_rig_is_what_any_of_its_cameras_sees():
    """Two cameras that look at one place at right angles, from 1 m."""
    side = {"width": 640, "height": 480, "fx": 600, "fy": 600, "cx": 319.5, "cy": 239.5}
    turn = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])  # looks along -x
    ahead = Camera(name="ahead", **side)
    aside = Camera(name="aside", R_CK=turn, p_CK=[1.0, 0.0, 1.0], **side)
    both = SearchRange.in_view(CameraRig((ahead, aside)), 0.2)
    ranges = [SearchRange.in_view(CameraRig((camera,)), 0.2) for camera in (ahead, aside)]
    assert ranges[1].x == pytest.approx((1.0 - ranges[0].z[1], 1.0 - ranges[0].z[0]))
    np.testing.assert_array_equal(both.lower, np.min([r.lower for r in ranges], axis=0))
    np.testing.assert_array_equal(both.upper, np.max([r.upper for r in ranges], axis=0))


def test_a_rig_may_look_anywhere_so_the_target_may_be_behind_its_frame():
    search_range = SearchRange(z=(-2.0, -1.0))
    assert (search_range.lower[2], search_range.upper[2]) == (-2.0, -1.0)


# The genes


@codings
def test_every_value_of_every_gene_survives_the_round_trip(coding):
    genes = GeneCoding(coding=coding)
    poses = grid(np.arange(4096))
    bits = genes.encode(poses)
    assert bits.shape == (4096, 72) and bits.dtype == np.uint8
    np.testing.assert_allclose(genes.decode(bits), poses, atol=1e-14)
    np.testing.assert_array_equal(genes.encode(genes.decode(bits)), bits)
    assert len(set(rows(bits))) == 4096


@codings
def test_every_string_of_bits_survives_the_round_trip(coding):
    genes = GeneCoding(coding=coding)
    bits = np.random.default_rng(0).integers(0, 2, size=(500, 72), dtype=np.uint8)
    np.testing.assert_array_equal(genes.encode(genes.decode(bits)), bits)


def test_binary_genes_are_the_numbers_written_in_base_two():
    numbers = np.arange(4096)
    bits = GeneCoding(coding="binary").encode(grid(numbers)).reshape(4096, 6, 12)
    expected = np.array([[int(b) for b in f"{n:012b}"] for n in numbers])
    for i in range(6):
        np.testing.assert_array_equal(bits[:, i], expected)


def test_gray_genes_are_the_reflected_code():
    numbers = np.arange(4096)
    bits = GeneCoding(coding="gray").encode(grid(numbers)).reshape(4096, 6, 12)
    # Reflected code by its definition: 0 before the list, 1 before the list reversed.
    expected = [""]
    for _ in range(12):
        expected = ["0" + code for code in expected] + ["1" + code for code in expected[::-1]]
    for i in range(6):
        assert ["".join(map(str, row)) for row in bits[:, i]] == expected


def test_gray_neighbors_differ_in_one_bit():
    bits = GeneCoding(coding="gray").encode(grid(np.arange(4096))).reshape(4096, 6, 12)
    np.testing.assert_array_equal((bits[1:] != bits[:-1]).sum(axis=-1), 1)


def test_binary_code_has_a_hamming_cliff_in_the_middle_of_the_range():
    # 011111111111 -> 100000000000: all bits change between the two values around x = 0,
    # z = 800 mm and eps = 0, where the paper's target stands.
    genes = GeneCoding(coding="binary")
    below, above = grid([2047, 2048])
    middle = 0.5 * (RANGE.lower + RANGE.upper)
    np.testing.assert_allclose(middle, [0, 0.150, 0.800, 0, 0, 0], atol=1e-15)
    assert (below < middle).all() and (middle < above).all()
    assert (genes.encode([below]) != genes.encode([above])).sum() == 72


@codings
def test_coding_moves_a_pose_by_at_most_half_a_step(coding):
    genes = GeneCoding(coding=coding)
    poses = np.random.default_rng(1).uniform(RANGE.lower, RANGE.upper, size=(1000, 6))
    step = (RANGE.upper - RANGE.lower) / 4095
    error = np.abs(genes.decode(genes.encode(poses)) - poses) / step
    assert error.max() <= 0.5 + 1e-9
    assert error.max(axis=0).min() > 0.45  # the bound is sharp: 73 um, 0.00024


@codings
def test_poses_outside_of_the_range_are_moved_to_its_border(coding):
    genes = GeneCoding(coding=coding)
    pose = np.array([0.2, -0.1, 2.0, -0.6, 0.51, 0.0])
    [moved] = genes.decode(genes.encode([pose]))
    np.testing.assert_allclose(moved[:5], [0.150, 0.0, 0.950, -0.5, 0.5], atol=1e-15)
    assert abs(moved[5]) <= 0.5 / 4095


@codings
@pytest.mark.parametrize("bits", [1, 5, 20, 31])
def test_genes_may_have_other_lengths(coding, bits):
    genes = GeneCoding(coding=coding, bits=bits)
    numbers = np.unique(np.linspace(0, 2**bits - 1, 50).round().astype(np.int64))
    strings = genes.encode(grid(numbers, bits))
    assert strings.shape == (len(numbers), 6 * bits)
    np.testing.assert_allclose(genes.decode(strings), grid(numbers, bits), atol=1e-12)


@codings
def test_genes_span_their_own_search_range(coding):
    genes = GeneCoding(search_range=SearchRange(x=(0.1, 0.2), z=(1.0, 2.0)), coding=coding)
    ends = np.stack([genes.search_range.lower, genes.search_range.upper])
    np.testing.assert_allclose(genes.decode(genes.encode(ends)), ends, atol=1e-15)


@pytest.mark.parametrize("bits", [0, -1, 32])
def test_gene_length_out_of_range_is_named(bits):
    with pytest.raises(ValueError, match="bits"):
        GeneCoding(bits=bits)


def test_unknown_coding_is_named_with_the_choices():
    with pytest.raises(ValueError, match=r"coding must be one of binary, gray, not .grey."):
        GeneCoding(coding="grey")


# Parameters


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("population_size", 2),
        ("population_size", 1),
        ("population_size", 0),
        ("first_candidates", 0),
        ("survivor_share", -0.1),
        ("survivor_share", 1.1),
        ("mutation_probability", -0.1),
        ("mutation_probability", 1.1),
        ("mutation_probability", math.nan),
        ("local_share", -0.1),
        ("local_share", 1.1),
        ("newcomer_share", -0.1),
        ("newcomer_share", 1.1),
    ],
)
def test_parameters_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        GeneticParameters(**{name: value})


def test_shares_of_the_children_must_not_exceed_one_together():
    with pytest.raises(ValueError, match="local_share and newcomer_share"):
        GeneticParameters(local_share=0.6, newcomer_share=0.5)
    GeneticParameters(local_share=0.5, newcomer_share=0.5)


def test_default_parameters():
    parameters = GeneticParameters()
    assert parameters.population_size == 60
    assert parameters.survivor_share == 0.25
    assert parameters.mutation_probability == 0.02
    assert (parameters.local_share, parameters.newcomer_share) == (0.6, 0.15)
    assert parameters.first_candidates == 30


# Drawing


@codings
def test_draws_are_spread_evenly_over_the_range(coding):
    poses = genetic(coding).draw(4000, np.random.default_rng(2))
    share = (poses - RANGE.lower) / (RANGE.upper - RANGE.lower)
    # Five standard deviations of the mean and of the variance of a uniform variable.
    np.testing.assert_allclose(share.mean(axis=0), 0.5, atol=5 * math.sqrt(1 / 12 / 4000))
    np.testing.assert_allclose(share.var(axis=0), 1 / 12, atol=5 * math.sqrt(1 / 180 / 4000))
    correlation = np.corrcoef(share.T) - np.eye(6)
    assert np.abs(correlation).max() < 5 / math.sqrt(4000)
    assert share.min() >= 0 and share.max() <= 1


@codings
def test_draws_near_a_pose_scatter_as_told(coding):
    center = np.array([0.01, 0.155, 0.80, 0.02, -0.05, 0.03])
    poses = genetic(coding).draw_near(center, (0.010, 0.020), 4000, np.random.default_rng(3))
    spread = np.array([0.010] * 3 + [0.020] * 3)
    deviation = (poses - center) / spread
    np.testing.assert_allclose(deviation.mean(axis=0), 0.0, atol=5 / math.sqrt(4000))
    np.testing.assert_allclose(deviation.std(axis=0), 1.0, atol=5 / math.sqrt(2 * 4000))
    assert np.abs(np.corrcoef(deviation.T) - np.eye(6)).max() < 5 / math.sqrt(4000)


@codings
def test_everything_drawn_or_bred_can_be_represented_by_genes(coding):
    moves = LocalMoves(np.zeros((1, 3)), np.zeros(3), LocalMoveParameters())
    algorithm = genetic(coding, moves=moves)
    rng = np.random.default_rng(4)
    off_grid = rng.uniform(RANGE.lower - 0.1, RANGE.upper + 0.1, size=(60, 6))
    for poses in (
        algorithm.draw(50, rng),
        algorithm.draw_near([0.149, 0.155, 0.8, 0, 0, 0], (0.01, 0.02), 50, rng),
        algorithm.breed(off_grid, rng.random(60), rng),
    ):
        np.testing.assert_array_equal(
            poses, algorithm.coding.decode(algorithm.coding.encode(poses))
        )
        assert (poses >= RANGE.lower - 1e-12).all() and (poses <= RANGE.upper + 1e-12).all()


# Breeding


@codings
@pytest.mark.parametrize("local_share", [0.0, 0.5])
def test_the_best_survive_unchanged_and_come_last_best_first(coding, local_share):
    algorithm = genetic(coding, local_share=local_share, survivor_share=0.4)
    rng = np.random.default_rng(5)
    poses, fitness = algorithm.draw(60, rng), rng.random(60)
    next_poses = algorithm.breed(poses, fitness, rng)
    assert next_poses.shape == (60, 6)
    best_first = np.argsort(-fitness)[:24]
    np.testing.assert_array_equal(next_poses[-24:], poses[best_first])


def test_equals_survive_in_their_order():
    algorithm = genetic()
    poses = algorithm.draw(60, np.random.default_rng(6))
    fitness = np.where(np.arange(60) % 6 == 5, 0.7, 0.5)
    next_poses = algorithm.breed(poses, fitness, np.random.default_rng(7))
    survivors = np.concatenate([poses[5::6], poses[[0, 1, 2, 3, 4]]])
    np.testing.assert_array_equal(next_poses[-15:], survivors)


@codings
@pytest.mark.parametrize("equals", [1, 2, 7, 20, 60])  # 20: more than survive
def test_the_center_of_the_equally_best_comes_first(coding, equals):
    algorithm = genetic(coding)
    rng = np.random.default_rng(20)
    poses, fitness = algorithm.draw(60, rng), 0.8 * rng.random(60)
    best = rng.permutation(60)[:equals]
    fitness[best] = 0.9
    center = algorithm.breed(poses, fitness, rng)[0]
    half_step = 0.5 * (RANGE.upper - RANGE.lower) / 4095
    assert (np.abs(center - poses[best].mean(axis=0)) <= half_step * (1 + 1e-9)).all()
    [represented] = algorithm.coding.decode(algorithm.coding.encode([center]))
    np.testing.assert_array_equal(center, represented)
    if equals == 1:
        np.testing.assert_array_equal(center, poses[best[0]])


def test_nearly_equals_have_no_part_in_the_center():
    algorithm = genetic()
    poses = grid(np.arange(60) * 60)
    fitness = np.full(60, np.nextafter(0.9, 0))
    fitness[[10, 20]] = 0.9
    center = algorithm.breed(poses, fitness, np.random.default_rng(21))[0]
    np.testing.assert_allclose(center, poses[15], atol=1e-12)


def test_local_children_move_the_center_and_not_one_of_the_best():
    algorithm = genetic(local_share=1.0, newcomer_share=0.0)  # moves that do not move
    poses = grid(np.arange(60) * 60)
    fitness = np.linspace(0.5, 0.0, 60)
    fitness[[10, 30]] = 0.9
    next_poses = algorithm.breed(poses, fitness, np.random.default_rng(22))
    np.testing.assert_allclose(next_poses[:45], poses[20:21].repeat(45, axis=0), atol=1e-12)
    assert (next_poses[45:] != poses[20]).any(axis=1).all()


def test_without_the_mean_of_the_best_their_first_is_the_center():
    algorithm = genetic(local_share=1.0, newcomer_share=0.0, average_best=False)
    poses = grid(np.arange(60) * 60)
    fitness = np.linspace(0.5, 0.0, 60)
    fitness[[10, 30]] = 0.9
    next_poses = algorithm.breed(poses, fitness, np.random.default_rng(23))
    # Moves that do not move, one more than with the mean, and the survivors.
    np.testing.assert_allclose(next_poses[:45], poses[10:11].repeat(45, axis=0), atol=1e-12)
    np.testing.assert_allclose(next_poses[45:47], poses[[10, 30]], atol=1e-12)


def test_survivors_carried_out_of_the_range_are_moved_to_its_border():
    algorithm = genetic()
    poses = grid(np.full(60, 2000))
    poses[0] = [-0.3, 0.155, 0.8, 0.0, 0.0, 0.7]
    fitness = np.linspace(1, 0, 60)
    next_poses = algorithm.breed(poses, fitness, np.random.default_rng(8))
    for best in next_poses[[0, -15]]:  # the center, too
        assert best[0] == pytest.approx(-0.150) and best[5] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("population_size", "survivor_share", "survivors"),
    [(60, 0.25, 15), (60, 0.5, 30), (10, 0.33, 3), (3, 0.5, 1), (60, 0.0, 1), (60, 1.0, 58)],
)
def test_number_of_survivors(population_size, survivor_share, survivors):
    # All children are newcomers, which never repeat a parent.
    algorithm = genetic(
        population_size=population_size,
        survivor_share=survivor_share,
        local_share=0.0,
        newcomer_share=1.0,
    )
    rng = np.random.default_rng(9)
    parents, fitness = algorithm.draw(population_size, rng), rng.random(population_size)
    next_poses = algorithm.breed(parents, fitness, rng)
    assert len(next_poses) == population_size
    kept = [row in set(rows(parents)) for row in rows(next_poses)]
    # The center, which is the best alone, the newcomers, and the survivors.
    assert kept == [True] + [False] * (population_size - survivors - 1) + [True] * survivors
    np.testing.assert_array_equal(next_poses[0], parents[np.argmax(fitness)])
    np.testing.assert_array_equal(next_poses[-survivors], parents[np.argmax(fitness)])


@pytest.mark.parametrize(
    ("survivor_share", "local_share", "newcomer_share", "local", "newcomers", "crossed"),
    [
        (0.25, 0.6, 0.15, 26, 7, 11),  # the default
        (0.5, 0.0, 0.0, 0, 0, 29),  # the plain 1-step GA
        (0.5, 1.0, 0.0, 29, 0, 0),
        (0.5, 0.0, 1.0, 0, 29, 0),
        (0.5, 0.25, 0.75, 7, 22, 0),
        (0.5, 0.3, 0.6, 9, 17, 3),
        (0.6, 0.5, 0.5, 12, 11, 0),  # both of 23 / 2 rounded up would be one too many
        (1.0, 0.6, 0.15, 1, 0, 0),
    ],
)
def test_order_and_shares_of_the_children(
    survivor_share, local_share, newcomer_share, local, newcomers, crossed
):
    # Equal parents: what a crossing makes of them equals them, a move without rotation changes
    # their position only, and a newcomer is different in every gene.
    moves = LocalMoves(
        np.zeros((1, 3)), np.zeros(3), LocalMoveParameters(rotation_deg=0.0, sparsity=0.0)
    )
    algorithm = genetic(
        moves=moves,
        survivor_share=survivor_share,
        local_share=local_share,
        newcomer_share=newcomer_share,
        mutation_probability=0.0,
    )
    parents = grid(np.full(60, 1500))
    next_poses = algorithm.breed(parents, np.ones(60), np.random.default_rng(10))
    moved = np.abs(next_poses - parents[0]) > 1e-9
    of_local = moved[:, :3].any(axis=1) & ~moved[:, 3:].any(axis=1)
    of_newcomers = moved[:, 3:].all(axis=1)
    # First the center, last the crossed children and the survivors: all equal to the parents.
    survivors = 59 - local - newcomers - crossed
    assert survivors == min(58, round(60 * survivor_share))
    place = np.arange(60)
    np.testing.assert_array_equal(of_local, (place >= 1) & (place < 1 + local))
    np.testing.assert_array_equal(
        of_newcomers, (1 + local <= place) & (place < 1 + local + newcomers)
    )
    assert (~moved.any(axis=1)).sum() == 1 + crossed + survivors


def test_crossed_children_come_after_the_newcomers_and_before_the_survivors():
    # Every bit of a crossed child flips: it is what equal parents are not, at no other place.
    algorithm = genetic(mutation_probability=1.0)
    parents = grid(np.full(60, 1500))
    next_poses = algorithm.breed(parents, np.ones(60), np.random.default_rng(23))
    opposite = np.abs(next_poses - grid([4095 - 1500])[0]).max(axis=1) < 1e-9
    np.testing.assert_array_equal(np.flatnonzero(opposite), np.arange(60 - 15 - 11, 60 - 15))


def test_local_children_move_the_best_individual():
    moves = LocalMoves(
        np.zeros((1, 3)),
        np.zeros(3),
        LocalMoveParameters(depth=0.0, rotation_deg=0.0, shift=0.001, decades=0.0),
    )
    algorithm = genetic(moves=moves, local_share=1.0, newcomer_share=0.0)
    rng = np.random.default_rng(11)
    poses, fitness = algorithm.draw(60, rng), rng.random(60)
    best = np.argmax(fitness)
    children = algorithm.breed(poses, fitness, rng)[1:45]
    assert np.abs(children - poses[best]).max() < 0.006
    assert np.abs(children[:, :3] - poses[best, :3]).max() > 0.0005


@codings
@pytest.mark.parametrize("probability", [0.0, 0.02, 0.3, 1.0])
def test_bits_of_a_crossed_child_mutate_with_the_given_probability(coding, probability):
    # Equal parents: crossover changes nothing, so every difference is a mutation.
    algorithm = genetic(coding, mutation_probability=probability, population_size=600, **PLAIN)
    parents = grid(np.full(600, 1234))
    next_poses = algorithm.breed(parents, np.ones(600), np.random.default_rng(12))
    children = next_poses[1:300]
    flips = algorithm.coding.encode(children) != algorithm.coding.encode(parents[:1])
    deviation = 5 * math.sqrt(probability * (1 - probability))  # five standard deviations
    assert flips.mean() == pytest.approx(probability, abs=deviation / math.sqrt(flips.size))
    # At every position of the string alike, and independently in a child.
    np.testing.assert_allclose(flips.mean(axis=0), probability, atol=deviation / math.sqrt(299))
    variance = 72 * probability * (1 - probability)
    assert flips.sum(axis=1).var() == pytest.approx(variance, rel=0.4, abs=1e-12)


@codings
def test_survivors_do_not_mutate(coding):
    algorithm = genetic(coding, mutation_probability=1.0, **PLAIN)
    rng = np.random.default_rng(13)
    poses = algorithm.draw(60, rng)
    next_poses = algorithm.breed(poses, np.linspace(1, 0, 60), rng)
    np.testing.assert_array_equal(next_poses[0], poses[0])  # nor does the center
    np.testing.assert_array_equal(next_poses[-30:], poses[:30])


@codings
def test_two_point_crossover_gives_one_stretch_of_the_string_to_the_other_parent(coding):
    # Parents of all zeros and all ones: a child's stretches show where it was cut.
    algorithm = genetic(
        coding,
        **PLAIN | {"mutation_probability": 0.0, "population_size": 1000, "survivor_share": 0.002},
    )
    strings = np.zeros((1000, 72), dtype=np.uint8)
    strings[1] = 1
    parents = algorithm.coding.decode(strings)
    next_poses = algorithm.breed(parents, np.linspace(1, 0, 1000), np.random.default_rng(14))
    children = algorithm.coding.encode(next_poses[1:-2]).astype(int)
    changes = np.count_nonzero(np.diff(children, axis=1), axis=1)
    assert changes.max() == 2
    # Half of the children have two different parents, and few of their cuts fall on an end.
    assert 0.35 < np.mean(changes > 0) < 0.55
    cut_at = np.nonzero(np.diff(children, axis=1))[1]
    assert set(cut_at) == set(range(71))  # cuts fall anywhere, within genes too
    assert children.mean() == pytest.approx(0.5, abs=0.06)  # no parent is preferred


@codings
def test_without_mutation_every_crossed_child_consists_of_two_survivors_stretches(coding):
    algorithm = genetic(
        coding,
        **PLAIN | {"mutation_probability": 0.0, "population_size": 40, "survivor_share": 0.2},
    )
    rng = np.random.default_rng(15)
    poses = algorithm.draw(40, rng)
    bits = algorithm.coding.encode(algorithm.breed(poses, np.linspace(1, 0, 40), rng))
    parents, children = bits[-8:], bits[1:-8]
    assert len(children) == 31
    for child in children:
        assert any(is_crossing(child, mother, father) for mother in parents for father in parents)


def is_crossing(child, mother, father):
    """Whether a child is its mother but for one stretch, which it has from its father."""
    different = np.flatnonzero(child != mother)
    if len(different) == 0:
        return True
    stretch = slice(different[0], different[-1] + 1)
    return np.array_equal(child[stretch], father[stretch])


def test_the_worse_half_has_no_children():
    # Without mutation, a bit that all survivors share is in all crossed children.
    algorithm = genetic(mutation_probability=0.0, **PLAIN)
    poses = np.vstack([grid(np.full(30, 0)), grid(np.full(30, 4095))])
    next_poses = algorithm.breed(poses, np.linspace(1, 0, 60), np.random.default_rng(16))
    np.testing.assert_array_equal(next_poses, poses[:1].repeat(60, axis=0))


@codings
def test_the_same_random_numbers_breed_the_same_generation(coding):
    moves = LocalMoves(np.zeros((1, 3)), np.zeros(3), LocalMoveParameters())
    algorithm = genetic(coding, moves=moves)
    poses = algorithm.draw(60, np.random.default_rng(17))
    fitness = np.linspace(1, 0, 60)
    first, again, other = (
        algorithm.breed(poses, fitness, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first[1:45] != other[1:45]).any(axis=1).sum() >= 42


def test_breeding_leaves_its_arguments_alone():
    algorithm = genetic()
    poses, fitness = grid(np.arange(60)), np.linspace(0, 1, 60)
    before = poses.copy(), fitness.copy()
    algorithm.breed(poses, fitness, np.random.default_rng(18))
    np.testing.assert_array_equal(poses, before[0])
    np.testing.assert_array_equal(fitness, before[1])


@codings
@pytest.mark.parametrize("plain", [True, False], ids=["plain", "with local moves"])
def test_generations_climb_to_the_maximum_as_in_equation_26(coding, plain):
    moves = LocalMoves(np.zeros((1, 3)), np.zeros(3), LocalMoveParameters())
    algorithm = genetic(coding, moves=moves, **(PLAIN if plain else {}))
    # Away from the binary code's cliffs.
    goal = np.array([0.04, 0.09, 0.73, 0.11, -0.13, 0.22])

    def score(poses):
        return -np.linalg.norm((poses - goal) / (RANGE.upper - RANGE.lower), axis=1)

    rng = np.random.default_rng(19)
    poses = algorithm.draw(60, rng)
    best = [score(poses).max()]
    for _ in range(200):
        poses = algorithm.breed(poses, score(poses), rng)
        best.append(score(poses).max())
    assert (np.diff(best) >= 0).all()  # the best survives
    assert best[0] < -0.2
    assert best[-1] > -0.05
