"""Rotations that bring a solid's shape onto itself."""

from pathlib import Path

import numpy as np
import pytest
from synthetic import hexagonal_prism, paper_box, pose, rotation, tetrahedron

from mffdrake.recognition import BLUE, GREEN, RED, SolidModel
from mffdrake.recognition.poses.pose import rotation_angle
from mffdrake.recognition.poses.pose_motion import rotate_by
from mffdrake.recognition.solid.symmetry import (
    NO_SYMMETRIES,
    Turns,
    find_look_alikes,
    find_symmetries,
    find_turns,
    turn_about_middle,
)


@pytest.mark.parametrize(
    ("solid", "count"),
    [
        (SolidModel.box((0.1, 0.1, 0.1), (RED, GREEN, BLUE)), 23),  # the octahedral group
        (SolidModel.box((0.1, 0.1, 0.4), (RED, GREEN, BLUE)), 7),  # a square prism's
        (SolidModel.box((0.1, 0.2, 0.4), (RED, GREEN, BLUE)), 3),  # a cuboid's half turns
        (tetrahedron(), 11),  # the tetrahedral group
        (hexagonal_prism(radius=0.08, height=0.3), 11),  # the dihedral group of order 12
    ],
)
def test_the_rotations_are_the_shape_s_group_without_the_identity(solid, count):
    turns = find_turns(solid, tolerance=0.05)
    assert len(turns) == count
    arms = solid.vertices - solid.vertices.mean(axis=0)
    for R in turns:
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert np.trace(R) < 2.999
        apart = np.linalg.norm((arms @ R.T)[:, None] - arms, axis=-1)
        assert apart.min(axis=1).max() < 1e-9
        assert sorted(apart.argmin(axis=1)) == list(range(len(arms)))
        # A group: two of them make a third or nothing.
        for S in turns:
            product = R @ S
            assert any(np.allclose(product, T, atol=1e-9) for T in [*turns, np.eye(3)])


def test_a_shape_that_is_nearly_symmetric_counts_within_the_tolerance():
    nearly = SolidModel.box((0.100, 0.110, 0.400), (RED, GREEN, BLUE))
    assert len(find_turns(nearly, tolerance=0.01)) == 3
    assert len(find_turns(nearly, tolerance=0.2)) == 7
    # Those that fit best come first: the half turns.
    for R in find_turns(nearly, tolerance=0.2)[:3]:
        np.testing.assert_allclose(np.abs(R), np.eye(3), atol=1e-9)


def test_turning_keeps_the_middle_where_it_is_and_composes_the_rotation():
    box = paper_box()
    off_center = SolidModel(box.vertices + [0.03, -0.01, 0.02], box.faces, box.hues)
    psi = pose((0.1, 0.2, 0.7), (0.2, -0.3, 0.4))
    middle = off_center.vertices.mean(axis=0)
    R = rotation(psi[3:])
    turns = find_turns(off_center)
    for T, turned in zip(turns, turn_about_middle(psi, off_center, turns), strict=True):
        np.testing.assert_allclose(rotation(turned[3:]), R @ T, atol=1e-9)
        np.testing.assert_allclose(
            rotation(turned[3:]) @ middle + turned[:3], R @ middle + psi[:3], atol=1e-12
        )


CUBE = SolidModel.box((0.1, 0.1, 0.1), (RED, GREEN, BLUE))


def prism_of_two_hues():
    """All sides of one color, both ends of another."""
    prism = hexagonal_prism(radius=0.08, height=0.3)
    return SolidModel(prism.vertices, prism.faces, [0.0, 0.0] + 6 * [2.0])


@pytest.mark.parametrize(
    ("solid", "count"),
    [
        (paper_box(), 0),  # Half turns bring pairs of faces onto themselves,
        (SolidModel(paper_box().vertices, paper_box().faces, np.arange(6.0)), 3),  # not six colors.
        (CUBE, 20),
        (
            SolidModel(SolidModel.box((1, 1, 1), (0, 1, 2)).vertices, paper_box().faces, range(6)),
            23,
        ),
        (SolidModel.box((0.1, 0.1, 0.1), (RED, RED, RED)), 0),
        (SolidModel.box((0.1, 0.11, 0.2), (RED, GREEN, BLUE)), 0),  # nearly square is not square
        (hexagonal_prism(radius=0.08, height=0.3), 11),
        (prism_of_two_hues(), 0),
        (tetrahedron(), 11),
    ],
)
def test_look_alikes_keep_the_shape_but_not_the_colors(solid, count):
    moved = SolidModel(solid.vertices + [0.3, -0.2, 0.1], solid.faces, solid.hues)
    for one in (solid, moved):
        found, points = find_look_alikes(one)
        assert found.shape == (count, 3, 3)
        np.testing.assert_allclose(points, np.tile(one.vertices.mean(axis=0), (count, 1)))
        assert len(find_symmetries(one).turns.rotations) + count == len(find_turns(one, 0.02))
        arms = one.centers - one.vertices.mean(axis=0)
        for R in found:
            apart = np.linalg.norm((arms @ R.T)[:, None] - arms, axis=-1)
            assert apart.min(axis=1).max() < 1e-9
            assert not np.allclose(one.hues[apart.argmin(axis=1)], one.hues)


def house():
    """A box with a roof: ends of five corners, walls and slopes that are rectangles."""
    end = [(-0.05, 0.0), (0.05, 0.0), (0.05, 0.06), (0.0, 0.1), (-0.05, 0.06)]
    vertices = [(x, y, z) for z in (0.0, 0.12) for x, y in end]
    sides = [(k, (k + 1) % 5, 5 + (k + 1) % 5, 5 + k) for k in range(5)]
    return SolidModel(vertices, [(4, 3, 2, 1, 0), (5, 6, 7, 8, 9), *sides], range(7))


def test_turns_of_a_face_alone_look_alike_where_that_face_alone_is_seen():
    solid = house()
    turns = find_look_alikes(solid)
    # The half turn about the floor's normal is the whole shape's; those of walls and slopes not.
    middle = solid.vertices.mean(axis=0)
    assert len(turns.rotations) == 1 + 4
    np.testing.assert_allclose(turns.points[0], middle)
    psi = pose((0.1, 0.2, 0.7), (0.2, -0.3, 0.4))
    R, corners = rotation(psi[3:]), solid.vertices
    onto = set()
    for turned in turns.of(psi):
        placed, was = (rotation(q[3:]) @ corners.T + q[:3, None] for q in (turned, psi))
        np.testing.assert_allclose(np.trace(R.T @ rotation(turned[3:])), -1.0, atol=1e-9)
        for k, face in enumerate(solid.faces):
            apart = np.linalg.norm(placed.T[list(face), None] - was.T[list(face)], axis=-1)
            if apart.min(axis=1).max() < 1e-7:
                onto.add(k)
    assert onto == {2, 3, 4, 5, 6}


MODELS = Path(__file__).parents[2] / "models"


def test_a_body_of_revolution_may_be_turned_about_its_axis_by_any_angle():
    mug = SolidModel.from_mesh_file(MODELS / "mug.obj")
    found = find_symmetries(mug)
    np.testing.assert_allclose(np.abs(found.axes), [[0, 0, 1]], atol=1e-6)
    np.testing.assert_allclose(found.center[:2], 0, atol=1e-6)
    assert len(found.turns.rotations) == 0  # It is open above, and has other colors below.
    assert str(found).startswith("any turn about")
    assert len(find_look_alikes(mug).rotations) == 0


@pytest.mark.parametrize("name", ["l_block", "hammer", "notched_box", "wedge"])
def test_a_solid_with_different_sides_has_no_symmetry(name):
    assert str(find_symmetries(SolidModel.from_mesh_file(MODELS / f"{name}.obj"))) == "none"


@pytest.mark.parametrize("seed", range(3))
def test_of_poses_that_look_alike_the_one_is_told_that_is_turned_least(seed):
    rng = np.random.default_rng(seed)
    mug = SolidModel.from_mesh_file(MODELS / "mug.obj")
    box = SolidModel.box((0.1, 0.15, 0.2), (RED, GREEN, BLUE))
    for symmetries in (find_symmetries(mug), find_symmetries(box)):
        psi, near = (pose(rng.uniform(-1, 1, 3), rng.uniform(-0.5, 0.5, 3)) for _ in range(2))
        found = symmetries.nearest(psi, near)
        # All of them, one by one
        turned = [psi, *symmetries.turns.of(psi)]
        for d in symmetries.axes:
            point = symmetries.center
            turns = np.array([rotation(rotate_by(a * d)) for a in np.linspace(-3.14, 3.14, 4001)])
            turned = [*Turns(turns, np.tile(point, (len(turns), 1))).of(psi)]
        angles = [rotation_angle(q[3:], near[3:]) for q in turned]
        assert rotation_angle(found[3:], near[3:]) == pytest.approx(min(angles), abs=2e-6)
        np.testing.assert_allclose(symmetries.nearest(found, near), found, atol=1e-9)
        # The axis' point stays where it was.
        if len(symmetries.axes):
            where = [rotation(q[3:]) @ point + q[:3] for q in (psi, found)]
            np.testing.assert_allclose(where[0], where[1], atol=1e-12)


def test_where_nothing_is_alike_the_pose_is_the_very_same():
    psi = pose((0.1, 0.2, 0.7), (0.2, -0.3, 0.4))
    assert NO_SYMMETRIES.nearest(psi, pose((0, 0, 1), (0, 0, 0))) is not None
    np.testing.assert_array_equal(NO_SYMMETRIES.nearest(psi, psi), psi)
    assert str(NO_SYMMETRIES) == "none"


@pytest.mark.parametrize("sides", [24, 31, 40, 53, 64])
def test_an_axis_is_found_however_many_facets_approximate_the_surface(sides):
    """Narrow and small parts of it, of other colors, included."""
    profile = [
        (0.0, -0.06),
        (0.045, -0.06),
        (0.045, 0.06),
        (0.041, 0.06),
        (0.041, -0.05),
        (0, -0.05),
    ]
    vertices, rings = [], []
    for r, z in profile:
        angles = 2 * np.pi * np.arange(sides if r else 1) / sides
        rings.append(np.arange(len(angles)) + len(vertices))
        vertices += [(r * np.cos(a), r * np.sin(a), z) for a in angles]
    faces, hues = [], []
    for k in range(len(profile) - 1):
        for i in range(sides):
            ring = [rings[k], rings[k], rings[k + 1], rings[k + 1]]
            at = zip(ring, (i, i + 1, i + 1, i), strict=True)
            faces.append(tuple(dict.fromkeys(int(one[j % len(one)]) for one, j in at)))
            hues.append(k)
    found = find_symmetries(SolidModel(vertices, faces, hues))
    np.testing.assert_allclose(np.abs(found.axes), [[0, 0, 1]], atol=1e-3)
