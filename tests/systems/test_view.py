"""The live view: what Meshcat is told of poses, hypotheses and cameras, and its buttons."""

import numpy as np
import pytest
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from mffdrake.recognition import CameraRig, SolidModel, TrackingState
from mffdrake.recognition.poses.pose import pose_from_transform
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.systems.arms.models import FindModelsPath
from mffdrake.systems.view.controls import LiveControls
from mffdrake.systems.view.pose_view import NUM_SHOWN, PoseView

BOX = ColoredMesh.read(FindModelsPath() / "target_box.obj")
SOLID = SolidModel.from_mesh_file(FindModelsPath() / "target_box.obj")
RIG = CameraRig.stereo()
X_WC = RigidTransform(RollPitchYaw(0.3, 0.2, -0.1), [1.0, 0.2, 0.5])


@pytest.fixture(scope="module")
def page():
    return Meshcat()


@pytest.fixture
def meshcat(page):
    page.Delete()
    page.DeleteAddedControls()
    return page


def transform(meshcat, path):
    """A path's transform, from Meshcat's message: 16 numbers, column by column."""
    message = meshcat._GetPackedTransform(path)
    numbers = message[message.index(b"matrix\xdc\x00\x10") + 9 :]
    matrix = np.array([np.frombuffer(numbers[9 * k + 1 : 9 * k + 9], ">f8")[0] for k in range(16)])
    matrix = matrix.reshape(4, 4).T
    return RigidTransform(RotationMatrix(matrix[:3, :3]), matrix[:3, 3])


def guesses(number):
    """Pose vectors, and the same as transforms."""
    rng = np.random.default_rng(0)
    poses = [
        RigidTransform(RollPitchYaw(*rng.uniform(-0.2, 0.2, 3)), [0.0, 0.1, 0.8 + 0.01 * k])
        for k in range(number)
    ]
    vectors = [pose_from_transform(X.rotation().matrix(), X.translation()) for X in poses]
    return np.array(vectors), poses


def is_visible(meshcat, path):
    message = meshcat._GetPackedProperty(path, "visible")
    return {b"\xc2": False, b"\xc3": True}[message[-1:]]


# Poses, hypotheses and cameras.


def test_the_best_hypotheses_after_the_first_are_outlines_where_they_are(meshcat):
    view = PoseView(meshcat, BOX, solid=SOLID, rig=RIG)
    vectors, poses = guesses(9)
    view.Show(X_WC, poses[0], vectors)
    assert transform(meshcat, "estimate").IsNearlyEqualTo(X_WC @ poses[0], 1e-12)
    for k in range(NUM_SHOWN):
        shown = transform(meshcat, f"hypotheses/{k}")
        assert shown.IsNearlyEqualTo(X_WC @ poses[k + 1], 1e-9)
        assert b"LineSegments" in meshcat._GetPackedObject(f"hypotheses/{k}")
    assert not meshcat.HasPath(f"hypotheses/{NUM_SHOWN}")


def test_outlines_without_a_hypothesis_are_not_to_be_seen(meshcat):
    view = PoseView(meshcat, BOX, solid=SOLID)
    vectors, poses = guesses(3)
    view.Show(X_WC, poses[0], vectors)
    shown = [is_visible(meshcat, f"hypotheses/{k}") for k in range(NUM_SHOWN)]
    assert shown == [True, True, *[False] * (NUM_SHOWN - 2)]


def test_the_cameras_pyramids_go_with_the_rig(meshcat):
    view = PoseView(meshcat, BOX, rig=RIG)
    view.Show(X_WC, RigidTransform())
    assert transform(meshcat, "cameras").IsNearlyEqualTo(X_WC, 1e-12)
    for camera in RIG.cameras:
        X_CK = transform(meshcat, f"cameras/{camera.name}")
        np.testing.assert_allclose(X_CK.translation(), camera.p_CK)
        corner = 0.2 * np.array(
            [0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy, 1]
        )
        assert corner.astype("<f4").tobytes() in meshcat._GetPackedObject(f"cameras/{camera.name}")


def test_the_ghost_has_edges_that_stand_out_where_they_are_known(meshcat):
    PoseView(meshcat, BOX, solid=SOLID)
    assert meshcat.HasPath("estimate/ghost") and meshcat.HasPath("estimate/edges")
    meshcat.Delete()
    PoseView(meshcat, BOX)  # Without a solid there are no edges to be known.
    assert not meshcat.HasPath("estimate/edges") and not meshcat.HasPath("hypotheses")


# Buttons and sliders.


def click(meshcat, name):
    """What a browser sends on a click: {"type": "button", "name": name}, in msgpack."""

    def packed(text):
        return bytes([0xA0 + len(text)]) + text.encode()

    message = b"\x82" + packed("type") + packed("button") + packed("name") + packed(name)
    meshcat._InjectWebsocketMessage(message)


class Visitor:
    """Somebody at the page who does something at each look, and goes when nothing is left."""

    def __init__(self, *deeds):
        self.deeds = list(deeds)
        self.looks = 0

    def __call__(self):
        self.looks += 1
        assert self.looks < 1000
        if self.deeds:
            self.deeds.pop(0)()
        return False


def test_untouched_it_never_waits(meshcat):
    controls = LiveControls(meshcat)
    visitor = Visitor()
    assert not any(controls.Wait(0.033 * k, visitor) for k in range(1, 6))
    assert visitor.looks == 5


def test_pause_holds_until_it_is_clicked_again(meshcat):
    controls = LiveControls(meshcat)
    click(meshcat, "pause / go on")
    nothing = [lambda: None] * 4
    visitor = Visitor(*nothing, lambda: click(meshcat, "pause / go on"))
    assert controls.Wait(0.033, visitor) is False
    assert visitor.looks == 5
    controls.Wait(0.066, visitor)
    assert visitor.looks == 6


def test_a_step_lets_one_frame_pass(meshcat):
    controls = LiveControls(meshcat)
    click(meshcat, "pause / go on")
    click(meshcat, "step")
    controls.Wait(0.033)
    visitor = Visitor(lambda: None, lambda: None, lambda: click(meshcat, "step"))
    controls.Wait(0.066, visitor)
    assert visitor.looks == 3


def test_an_end_ends_a_pause(meshcat):
    controls = LiveControls(meshcat)
    click(meshcat, "pause / go on")
    assert controls.Wait(0.033, lambda: True) is False


def test_reset_begins_anew_once_in_a_pause_too(meshcat):
    controls = LiveControls(meshcat)
    click(meshcat, "reset")
    assert controls.Wait(0.033) is True
    assert controls.Wait(0.033) is False
    click(meshcat, "pause / go on")
    assert controls.Wait(0.066, Visitor(lambda: click(meshcat, "reset"))) is True


def test_where_nothing_can_begin_anew_there_is_no_such_button(meshcat):
    LiveControls(meshcat, can_reset=False)
    assert meshcat.GetButtonNames() == ["pause / go on", "step"]


def test_a_slow_pace_waits_for_the_wall_clock(meshcat):
    """At no more than real time, a frame a thousand seconds later is far from its turn."""
    controls = LiveControls(meshcat)
    (speed,) = (name for name in meshcat.GetSliderNames() if name.startswith("speed"))
    meshcat.SetSliderValue(speed, 1.0)
    answers = [False, False, True]
    controls.Wait(1000.0, lambda: answers.pop(0))
    assert answers == []


def test_the_gauges_show_what_the_recognition_says(meshcat):
    controls = LiveControls(meshcat)
    controls.Tell(0.75, 0.5, TrackingState.TRACKING)
    assert meshcat.GetSliderValue("= fitness") == 0.75
    assert meshcat.GetSliderValue("= confidence") == 0.5
    assert "state: tracking" in meshcat.GetButtonNames()
    controls.Tell(0.25, float("nan"), TrackingState.LOST)
    assert meshcat.GetSliderValue("= confidence") == 0.0
    assert [name for name in meshcat.GetButtonNames() if "state" in name] == [
        "state: lost, confidence unknown"
    ]
