"""Where the target may be: blobs' frames, sources, and proposals."""

import itertools
import math

import cv2
import numpy as np
import pytest
from synthetic import (
    hexagonal_prism,
    odd_camera,
    odd_rig,
    paper_box,
    pose,
    project,
    random_poses,
    random_poses_in_view,
    render,
    rotation,
)

from mffdrake.recognition import (
    BLUE,
    GREEN,
    RED,
    CameraRig,
    Matcher,
    SearchModel,
    SearchRange,
    SolidModel,
)
from mffdrake.recognition.acquisition.proposals import Proposer
from mffdrake.recognition.solid.symmetry import find_symmetries

new_appearances = pytest.importorskip("mffdrake.recognition.acquisition.appearance").new_appearances

_blobs = pytest.importorskip("mffdrake.recognition.acquisition.blobs")
_proposals = pytest.importorskip("mffdrake.recognition.acquisition.proposing")

BOX = paper_box()
STEREO = CameraRig.stereo(width=320, height=240)
EVERYWHERE = SearchRange(eps1=(-1.0, 1.0), eps2=(-1.0, 1.0), eps3=(-1.0, 1.0))
RIGS = {
    "stereo": STEREO,
    "alone": CameraRig(STEREO.cameras[:1]),
    "three": odd_rig("none", "none"),
    "barrel": odd_rig("barrel"),
    "equidistant": CameraRig((odd_camera("equidistant"),)),
}
rigs = pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)


def proposer_of(rig, solid=BOX, search_range=None):
    search_range = SearchRange() if search_range is None else search_range
    return Proposer(Matcher(SearchModel(solid), rig), search_range)


def proposals_of(proposer, images, count=150, first=0, seed=0):
    scene = proposer.matcher.scene(images)
    return proposer.propose(proposer.find(scene), count, first, np.random.default_rng(seed))


def off_by(poses, truth, solid=BOX):
    """Distances of the middles [m] and angles [deg], modulo turns that look the same."""
    middle, R_true = solid.vertices.mean(axis=0), rotation(truth[3:])
    same = [np.eye(3), *find_symmetries(solid).turns.rotations]
    distances, angles = [], []
    for psi in poses:
        R = rotation(psi[3:])
        distances.append(np.linalg.norm(psi[:3] + R @ middle - truth[:3] - R_true @ middle))
        turns = [R.T @ R_true @ S for S in same]
        angles.append(min(np.linalg.norm(cv2.Rodrigues(turn)[0]) for turn in turns))
    return np.array(distances), np.degrees(angles)


def blobs_at(*places):
    """Blobs, each (camera, color, area, x, y)."""
    return np.array([(*place, False) for place in places], dtype=_blobs.BLOB)


def paint(images, rig, center, radius, color):
    """Draws a ball of a color into images, where it covers what is there."""
    for image, camera in zip(images, rig.cameras, strict=True):
        p_K = camera.R_CK.T @ (np.asarray(center) - camera.p_CK)
        u, v = project(camera, p_K[None])[0]
        size = round(radius * camera.fx / p_K[2])
        cv2.circle(image, (round(u), round(v)), size, color, -1)
    return images


# Sources


def sources_of(proposer, images):
    """Sources as (where, in the rig's frame; color), of pairs and of single blobs."""
    found = proposals_of(proposer, images, 1)
    return found.sources[~np.isnan(found.sources["depth"])], found.sources[
        np.isnan(found.sources["depth"])
    ]


def test_a_pair_of_blobs_lies_where_the_box_does():
    rng = np.random.default_rng(2)
    proposer = proposer_of(STEREO)
    scenes = []
    for psi in random_poses_in_view(rng, BOX, STEREO, 8):
        images = render(BOX, psi, STEREO)
        for color in ((255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 0, 0)):
            # Small things far behind
            paint(images, STEREO, [*rng.uniform(-0.6, 0.6, 2), 2.5], 0.08, color)
        scenes.append((psi, images))
    for psi, images in scenes:
        where, weights = place_pairs(proposer, images)
        right = np.linalg.norm(where - psi[:3], axis=1) < 0.06
        assert weights[right].sum() > 0.9 * weights.sum()
        # The lines of sight to the middles of what is seen meet in front of the box's middle.
        assert np.linalg.norm((where - psi[:3])[:, :2], axis=1)[right].min() < 0.02


def test_a_pair_of_blobs_tells_exactly_where_a_plate_is():
    plate = SolidModel.box((0.14, 0.12, 0.002), (RED, GREEN, BLUE))
    for x, y, z in itertools.product((-0.1, 0.1), (0.05, 0.15), (0.7, 0.9)):
        images = render(plate, pose((x, y, z), (0.1, -0.1, 0.2)), STEREO)
        where, _ = place_pairs(proposer_of(STEREO, plate), images)
        assert len(where) == 1
        np.testing.assert_allclose(where[0], [x, y, z], atol=0.01)
        np.testing.assert_allclose(where[0, :2], [x, y], atol=0.003)


def blobs_of(proposer, images):
    """What is found in each image, of any color and of one."""
    scene, found = proposer.matcher.scene(images), []
    for k, (view, grid) in enumerate(zip(scene.views, proposer.grids, strict=True)):
        labels = _blobs.label_pixels(view, grid, scene.gate, proposer.classes)
        found += [_blobs.find_blobs(labels, grid, k, 3, one, 6)[0] for one in (False, True)]
    return np.concatenate(found)


def place_pairs(proposer, images):
    """Places in the rig's frame of pairs of blobs of any color, and their weights."""
    blobs = blobs_of(proposer, images)
    sources = proposals_of(proposer, images, 1).sources
    pairs = [s for s in sources if not math.isnan(s["depth"]) and blobs[s["blob"]]["color"] < 0]
    where = []
    for source in pairs:
        blob = blobs[source["blob"]]
        camera = proposer.matcher.rig.cameras[blob["camera"]]
        ray = np.array([blob["x"], blob["y"], 1.0])
        where.append(camera.p_CK + camera.R_CK @ ray / np.linalg.norm(ray) * source["depth"])
    return np.array(where).reshape(-1, 3), np.array([s["weight"] for s in pairs])


def test_one_camera_has_single_sources_only():
    alone = CameraRig(STEREO.cameras[:1])
    psi = pose((0.0, 0.15, 0.8), (0.1, 0.2, 0.0))
    both, single = sources_of(proposer_of(STEREO), render(BOX, psi, STEREO))
    assert len(both) >= 4 and len(single) >= 8
    both, single = sources_of(proposer_of(alone), render(BOX, psi, alone))
    assert len(both) == 0 and len(single) >= 4
    assert single["weight"].sum() == pytest.approx(1.0)


def test_weights_add_up_to_one_a_kind():
    psi = pose((0.0, 0.15, 0.8), (0.1, 0.2, 0.0))
    both, single = sources_of(proposer_of(STEREO), render(BOX, psi, STEREO))
    assert both["weight"].sum() == pytest.approx(2.0)  # of any color, and of one
    assert single["weight"].sum() == pytest.approx(1.0)
    assert both["weight"].min() > 0.0


def test_blobs_that_meet_but_share_no_color_do_not_end_the_search():
    # What is red for one camera is green for the other: no pair, but single blobs all the same.
    images = [np.full((240, 320, 3), 128, dtype=np.uint8) for _ in range(2)]
    center = (0.0, 0.15, 0.8)
    for k, color in enumerate([(255, 0, 0), (0, 255, 0)]):
        camera = CameraRig((STEREO.cameras[k],))
        paint(images[k : k + 1], camera, center, 0.08, color)
    found = proposals_of(proposer_of(STEREO), images)
    assert np.isfinite(found.sources["weight"]).all()
    assert len(found.poses) > 50


def test_there_is_room_for_all_pairs_of_many_blobs():
    proposer = proposer_of(STEREO)
    many, z = 40, 0.8
    # All at one place: 200 cm^2, 0.8 m ahead of the right camera and 15 cm to the left one's right
    places = [(0, 0, 0.02 / z**2, 0.0, 0.0)] * many
    places += [(1, 0, 0.02 / z**2, 0.15 / z, 0.0)] * many
    blobs = blobs_at(*places)
    appearances = new_appearances(2 * many, 3)
    appearances.colors["share"][:, 0] = 1.0
    eyes = tuple(camera.eye for camera in STEREO.cameras)
    frames = _proposals.Frames(*_proposals.rig_frames(blobs, eyes, proposer.turns))
    sources = _proposals.pair_blobs(blobs, appearances, frames, proposer.table, proposer.bounds)
    pairs = ~np.isnan(sources["depth"])
    assert pairs.sum() == many**2 and (~pairs).sum() == 2 * many
    np.testing.assert_allclose(sources["depth"][pairs], z, rtol=1e-9)
    np.testing.assert_allclose(sources["weight"][pairs], 1.0 / many**2, rtol=0.2)
    assert sources["weight"][pairs].sum() == pytest.approx(1.0)
    assert set(sources["blob"][pairs]) == set(range(many))


# Proposals


def count_right(poses, truth, solid=BOX):
    distances, angles = off_by(poses, truth, solid)
    return ((distances < 0.04) & (angles < 20.0)).sum()


@rigs
def test_some_of_150_proposals_are_nearly_right(rig):
    proposer, counts = proposer_of(rig), []
    for seed, psi in enumerate(random_poses_in_view(np.random.default_rng(70), BOX, rig, 10)):
        found = proposals_of(proposer, render(BOX, psi, rig), seed=seed, first=150 * seed)
        assert 50 <= len(found.poses) == len(found.origins) <= 150
        assert (found.poses >= SearchRange().lower).all()
        assert (found.poses <= SearchRange().upper).all()
        counts.append(count_right(found.poses, psi))
    assert np.mean(counts) >= 5.0 and np.median(counts) >= 3.0
    # By chance, there would be far fewer.
    chance = random_poses(np.random.default_rng(71), 1500)
    chance = chance[np.linalg.norm(chance[:, 3:], axis=1) <= 1.0]
    assert count_right(chance, psi) / 10.0 < 0.2 * np.mean(counts)


def test_at_its_proposals_the_solid_shows_its_color_where_the_blob_is():
    alone = CameraRig(STEREO.cameras[:1])
    images = render(BOX, pose((0.03, 0.12, 0.78), (0.2, 0.3, 0.1)), alone)
    wide = SearchRange(x=(-0.6, 0.6), y=(-0.3, 0.5), z=(0.4, 2.0))
    proposer = proposer_of(alone, BOX, wide)
    found, at = proposals_of(proposer, images, 600), np.indices((240, 320)).reshape(2, -1)
    blobs = blobs_of(proposer, images)
    apart, ratios = [], []
    for psi, origin in zip(found.poses, found.origins, strict=True):
        blob = blobs[found.sources[origin]["blob"]]
        masks = [
            np.any(im != 128, axis=-1) if blob["color"] < 0 else im[..., blob["color"]] == 255
            for im in (images[0], render(BOX, psi, alone)[0])
        ]
        if masks[1].any():
            (v0, u0), (v1, u1) = (at[:, mask.ravel()].mean(axis=1) for mask in masks)
            apart.append((u1 - u0, v1 - v0) if blob["color"] >= 0 else (0.0, 0.0))
            ratios.append(masks[1].sum() / masks[0].sum())
    apart, ratios = np.array(apart), np.array(ratios)
    apart = apart[np.any(apart != 0.0, axis=1)]
    assert len(apart) > 40 and len(ratios) - len(apart) > 300
    # They are spread by about 13 mm, which is 5 px, along each side.
    assert np.median(np.abs(apart)) < 6.0
    assert np.abs(np.median(apart, axis=0)).max() < 2.5
    assert 0.85 < np.median(ratios) < 1.15


def test_half_a_blob_may_be_nearer_than_its_area_tells():
    alone, depths = CameraRig(STEREO.cameras[:1]), []
    for x, count in ((0.0, 150), (0.41, 150)):
        truth = pose((x, 0.05, 0.75), (0.1, 0.2, 0.0))
        span = SearchRange(x=(-0.6, 0.6), y=(-0.3, 0.3), z=(0.3, 2.0))
        found = proposals_of(proposer_of(alone, BOX, span), render(BOX, truth, alone), count)
        depths.append(found.poses[:, 2])
    whole, cut = depths
    assert np.median(whole) == pytest.approx(0.72, abs=0.05)
    # The half that is seen would be whole at 1.1 m.
    near, far = np.quantile(cut, [0.1, 0.9])
    assert near < 0.7 and far > 1.0


def test_sources_are_taken_by_their_weights():
    images = render(BOX, pose((0.0, 0.15, 0.8), (0.2, 0.3, 0.1)), STEREO)
    wide = SearchRange(x=(-1.0, 1.0), y=(-1.0, 1.0), z=(0.1, 3.0))
    proposer = proposer_of(STEREO, BOX, wide)
    found = proposals_of(proposer, images, 1000)
    counts = np.bincount(found.origins, minlength=len(found.sources)) / len(found.origins)
    # Of those for a color, many fail: it is not seen from everywhere.
    blobs = blobs_of(proposer, images)
    whole = blobs[found.sources["blob"]]["color"] < 0
    weights = found.sources["weight"][whole]
    assert whole.sum() == 3 and np.ptp(weights) > 0.5
    np.testing.assert_allclose(
        counts[whole] / counts[whole].sum(), weights / weights.sum(), atol=0.05
    )


def test_a_prism_is_proposed_in_all_orientations():
    prism = hexagonal_prism()
    proposer = proposer_of(STEREO, prism, EVERYWHERE)
    rng, counts = np.random.default_rng(72), []
    for seed in range(8):
        eps = rng.normal(size=4)
        eps = (eps / np.linalg.norm(eps) * np.sign(eps[0]))[1:]
        psi = pose((*rng.uniform(-0.1, 0.1, 1), 0.15, 0.8), eps)
        found = proposals_of(proposer, render(prism, psi, STEREO), seed=seed)
        counts.append(count_right(found.poses, psi, prism))
    assert np.mean(counts) >= 5.0 and np.median(counts) >= 3.0


def test_a_solid_whose_frame_lies_beside_it_is_proposed_where_it_is():
    beside = SolidModel(BOX.vertices + [0.0, 0.0, 0.5], BOX.faces, BOX.hues)
    proposer, counts = proposer_of(STEREO, beside), []
    rng = np.random.default_rng(73)
    for seed in range(6):
        psi = pose((0.0, rng.uniform(0.0, 0.3), rng.uniform(0.8, 0.95)), (0.05, 0.05, 0.1))
        found = proposals_of(proposer, render(beside, psi, STEREO), seed=seed)
        assert (~np.isnan(found.sources["depth"])).any()
        counts.append(count_right(found.poses, psi, beside))
    assert np.mean(counts) >= 3.0


def test_the_same_seed_proposes_the_same():
    images = render(BOX, pose((0.0, 0.15, 0.8), (0.1, 0.2, 0.0)), STEREO)
    proposer = proposer_of(STEREO)
    once, again, other, later = (
        proposals_of(proposer, images, 40, first, seed)
        for first, seed in ((0, 1), (0, 1), (0, 2), (40, 1))
    )
    np.testing.assert_array_equal(once.poses, again.poses)
    np.testing.assert_array_equal(once.origins, again.origins)
    assert not np.array_equal(once.poses, other.poses)
    assert not np.array_equal(once.poses, later.poses)
    assert set(once.origins) <= set(range(len(once.sources)))


@rigs
def test_nothing_to_see_gives_no_proposals(rig):
    grey = [np.full((c.height, c.width, 3), 128, dtype=np.uint8) for c in rig.cameras]
    found = proposals_of(proposer_of(rig), grey)
    assert found.poses.shape == (0, 6) and len(found.origins) == len(found.sources) == 0


def test_a_range_without_orientations_gives_no_proposals():
    images = render(BOX, pose((0.0, 0.15, 0.8)), STEREO)
    nowhere = SearchRange(eps1=(0.9, 1.0), eps2=(0.9, 1.0), eps3=(0.9, 1.0))
    assert len(proposals_of(proposer_of(STEREO, BOX, nowhere), images).poses) == 0


def test_colors_that_cannot_be_told_apart_are_one():
    sixfold = SolidModel.box((0.1, 0.15, 0.2), (0.0, 0.05, 2.0))
    proposer = proposer_of(STEREO, sixfold)
    assert proposer.num_colors == 2
    np.testing.assert_array_equal(proposer.face_classes, [0, 0, 0, 0, 1, 1])
