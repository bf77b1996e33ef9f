"""A blob's own frame, which looks along it."""

import math

import cv2
import numpy as np
import pytest
from synthetic import odd_camera, odd_rig, rotation

from mffdrake.recognition import CameraRig

_blobs = pytest.importorskip("mffdrake.recognition.acquisition.blobs")
_proposals = pytest.importorskip("mffdrake.recognition.acquisition.proposing")

RIGS = {
    "stereo": CameraRig.stereo(width=320, height=240),
    "three": odd_rig("none", "none"),
    "equidistant": CameraRig((odd_camera("equidistant"),)),
}
rigs = pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)


@rigs
def test_a_blob_s_frame_has_its_origin_in_the_camera_and_looks_along_the_blob(rig):
    rng = np.random.default_rng(1)
    eyes = tuple(camera.eye for camera in rig.cameras)
    turns_CK = np.array([quaternion_of(camera.R_CK) for camera in rig.cameras])
    places = [(rng.integers(len(eyes)), -1, 0.01, *rng.uniform(-0.8, 0.8, 2)) for _ in range(20)]
    places.append((0, -1, 0.01, 0.0, 0.0))
    turns, R_CF, p_CF = _proposals.rig_frames(
        np.array([(*place, False) for place in places], dtype=_blobs.BLOB), eyes, turns_CK
    )
    for (k, _, _, x, y), turn, R, p in zip(places, turns, R_CF, p_CF, strict=True):
        camera = rig.cameras[k]
        np.testing.assert_allclose(p, camera.p_CK, atol=1e-12)
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        ahead = np.array([x, y, 1.0]) / np.linalg.norm([x, y, 1.0])
        np.testing.assert_allclose(R[:, 2], camera.R_CK @ ahead, atol=1e-9)
        # Turned from the camera the short way: by no more than the angle to the blob.
        turned = np.linalg.norm(cv2.Rodrigues(camera.R_CK.T @ R)[0])
        assert turned == pytest.approx(math.acos(min(1.0, ahead[2])), abs=1e-6)
        np.testing.assert_allclose(rotation(turn[1:]), R, atol=1e-9)
        assert turn[0] >= 0.0 and np.linalg.norm(turn) == pytest.approx(1.0)


def quaternion_of(R):
    vector = cv2.Rodrigues(R)[0].ravel()
    angle = np.linalg.norm(vector)
    axis = vector / angle if angle > 0.0 else vector
    return np.array([math.cos(0.5 * angle), *(math.sin(0.5 * angle) * axis)])
