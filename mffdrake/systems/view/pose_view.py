"""Draws what a recognizer believes in Meshcat: a ghost, the best hypotheses, and the cameras."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import Cylinder, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix

from mffdrake.recognition.camera.cameras import Camera, CameraRig
from mffdrake.recognition.poses.pose import transform_from_pose
from mffdrake.recognition.solid.mesh_file import ColoredMesh
from mffdrake.recognition.solid.solid_model import SolidModel

__all__ = ["NUM_SHOWN", "PoseView", "SetView", "ViewRim"]

NUM_SHOWN = 5
"""How many hypotheses are shown beside the best one."""

_GHOST_SCALE = 1.02  # A little larger than the target, so that their faces do not flicker.
_GHOST_OPACITY = 0.5
_EDGE_RADIUS = 0.012  # of the ghost's edges, by its size; browsers draw lines one pixel wide
_EDGE_COLOR = Rgba(0.8, 0.47, 0.65)  # the style's purple: no target, arm or background is so
_GUESS_COLOR = Rgba(0.9, 0.62, 0.0)
_CAMERA_COLOR = Rgba(0.0, 0.45, 0.7)
_AXIS_LENGTH, _AXIS_RADIUS = 0.2, 0.003
_VIEW_DEPTH = 0.2  # Length of the cameras' pyramids [m].


class PoseView:
    """A recognized pose in Meshcat, with the best hypotheses and the cameras that saw them.

    Below the path "estimate" are the pose's axes and a ghost of the target with thick edges, below
    "hypotheses" the outlines of others, and below "cameras" pyramids of what each sees.

    Args:
        meshcat: Where to draw.
        mesh: The target's mesh.
        solid: The same as a solid, for its edges; without, no edges and hypotheses are drawn.
        rig: The cameras; not drawn without.

    Example:
        >>> from pydrake.geometry import Meshcat
        >>> from mffdrake.systems.arms.models import FindModelsPath
        >>> mesh = ColoredMesh.read(FindModelsPath() / "target_box.obj")
        >>> meshcat = Meshcat()
        >>> PoseView(meshcat, mesh).Show(RigidTransform(), RigidTransform([0.0, 0.0, 0.8]))
        >>> meshcat.HasPath("estimate/ghost")
        True
    """

    def __init__(
        self,
        meshcat: Meshcat,
        mesh: ColoredMesh,
        *,
        solid: SolidModel | None = None,
        rig: CameraRig | None = None,
    ) -> None:
        self._meshcat = meshcat
        corners = mesh.triangles.reshape(-1, 3).T
        meshcat.SetTriangleColorMesh(
            "estimate/ghost",
            vertices=_GHOST_SCALE * corners,
            faces=np.arange(corners.shape[1]).reshape(-1, 3).T,
            colors=np.repeat(mesh.colors, 3, axis=0).T,
        )
        meshcat.SetProperty("estimate/ghost", "modulated_opacity", _GHOST_OPACITY)
        _DrawFrame(meshcat, "estimate/frame")
        self._num_hypotheses = 0
        if solid is not None:
            self._num_hypotheses = NUM_SHOWN
            edges = solid.vertices[solid.edges[~solid.smooth]]
            if len(edges):  # A ball has none.
                _DrawTubes(meshcat, "estimate/edges", _GHOST_SCALE * edges)
            for k in range(NUM_SHOWN):
                _DrawLines(meshcat, _Hypothesis(k), edges, _GUESS_COLOR)
                meshcat.SetProperty(_Hypothesis(k), "visible", False)  # until there is one
        if rig is not None:
            for camera in rig.cameras:
                rim = ViewRim(camera)
                lines = [*zip(np.zeros((4, 3)), rim, strict=True)]
                lines += zip(rim, np.roll(rim, -1, axis=0), strict=True)
                path = f"cameras/{camera.name}"
                _DrawLines(meshcat, path, np.array(lines), _CAMERA_COLOR)
                X_CK = RigidTransform(RotationMatrix(camera.R_CK), camera.p_CK)
                meshcat.SetTransform(path, X_CK)

    def Show(
        self,
        X_WC: RigidTransform,
        X_CM: RigidTransform,
        hypotheses: ArrayLike | None = None,
        time: float | None = None,
    ) -> None:
        """Moves everything to where it is now.

        Args:
            X_WC: The rig's pose in the world.
            X_CM: The recognized pose in the rig's frame.
            hypotheses: Pose vectors in the rig's frame, the best first, shape (N, 6); of them the
                second and those that follow are shown.
            time: Time in a recording [s]; none for what is not recorded.
        """
        self._meshcat.SetTransform("estimate", X_WC @ X_CM, time_in_recording=time)
        self._meshcat.SetTransform("cameras", X_WC, time_in_recording=time)
        if hypotheses is None:
            return
        others = np.asarray(hypotheses)[1 : 1 + self._num_hypotheses]
        for k, pose in enumerate(others):
            R, p = transform_from_pose(pose)
            X_WH = X_WC @ RigidTransform(RotationMatrix(R), p)
            self._meshcat.SetTransform(_Hypothesis(k), X_WH, time_in_recording=time)
            self._meshcat.SetProperty(_Hypothesis(k), "visible", True)


def ViewRim(camera: Camera) -> NDArray[np.float64]:
    """The rim of a camera's viewing pyramid, whose top is the camera's center.

    Args:
        camera: The camera K.

    Returns:
        Its four corners in K [m], in order, shape (4, 3).

    Example:
        >>> ViewRim(CameraRig.stereo().cameras[0])[:, 2]
        array([0.2, 0.2, 0.2, 0.2])
    """
    x = _VIEW_DEPTH * 0.5 * camera.width / camera.fx
    y = _VIEW_DEPTH * 0.5 * camera.height / camera.fy
    rim = np.array([[-x, -y], [x, -y], [x, y], [-x, y]])
    return np.column_stack([rim, np.full(4, _VIEW_DEPTH)])


def SetView(meshcat: Meshcat, eye: ArrayLike, look_at: ArrayLike) -> None:
    """Places the page's camera.

    Args:
        meshcat: The page.
        eye: Where it looks from [m], in the world.
        look_at: What is in the middle [m].
    """
    meshcat.SetCameraPose(np.asarray(eye, dtype=float), np.asarray(look_at, dtype=float))


def _Hypothesis(number: int) -> str:
    return f"hypotheses/{number}"


def _DrawLines(meshcat: Meshcat, path: str, lines: NDArray[np.float64], color: Rgba) -> None:
    """Segments, shape (L, 2, 3)."""
    start, end = (np.asfortranarray(lines[:, k].T) for k in (0, 1))
    meshcat.SetLineSegments(path, start, end, 1.0, color)


def _DrawTubes(meshcat: Meshcat, path: str, lines: NDArray[np.float64]) -> None:
    """Segments as square bars, in one mesh, shape (L, 2, 3)."""
    along = lines[:, 1] - lines[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    helper = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    a = np.cross(along, helper)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    radius = _EDGE_RADIUS * np.linalg.norm(np.ptp(lines.reshape(-1, 3), axis=0))
    sides = radius * np.stack([a, np.cross(along, a), -a, -np.cross(along, a)], axis=1)
    corners = np.concatenate([lines[:, :1] + sides, lines[:, 1:] + sides], axis=1)
    one = [[k, (k + 1) % 4, k + 4] for k in range(4)]
    one += [[(k + 1) % 4, (k + 1) % 4 + 4, k + 4] for k in range(4)]
    faces = (np.array(one) + 8 * np.arange(len(lines))[:, None, None]).reshape(-1, 3)
    meshcat.SetTriangleMesh(
        path, np.asfortranarray(corners.reshape(-1, 3).T), np.asfortranarray(faces.T), _EDGE_COLOR
    )


def _DrawFrame(meshcat: Meshcat, path: str) -> None:
    """Three thin cylinders: x red, y green, z blue."""
    axis = Cylinder(_AXIS_RADIUS, _AXIS_LENGTH)
    along_z = RigidTransform([0.0, 0.0, 0.5 * _AXIS_LENGTH])
    for name, turn, color in (
        ("x", RotationMatrix.MakeYRotation(0.5 * math.pi), Rgba(1, 0, 0)),
        ("y", RotationMatrix.MakeXRotation(-0.5 * math.pi), Rgba(0, 1, 0)),
        ("z", RotationMatrix(), Rgba(0, 0, 1)),
    ):
        meshcat.SetObject(f"{path}/{name}", axis, color)
        meshcat.SetTransform(f"{path}/{name}", RigidTransform(turn, [0, 0, 0]) @ along_z)
