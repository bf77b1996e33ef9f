"""Images of colored solids at random poses, partly hidden and among blobs of their colors."""

from __future__ import annotations

import colorsys
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.framework import DiagramBuilder

import mffdrake as mff
from mffdrake.recognition.poses.pose import rotation_matrix

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

BASELINE = 0.150
ALL = (-1.0, 1.0)
ANYWHERE = mff.SearchRange(eps1=ALL, eps2=ALL, eps3=ALL)
GREY = (90, 90, 90)


def box(*hues_deg: float) -> mff.SolidModel:
    """The paper's box, with three hues or six."""
    solid = mff.SolidModel.box((0.1, 0.15, 0.2), (0.0, 0.0, 0.0))
    hues = np.repeat(hues_deg, 2) if len(hues_deg) == 3 else np.array(hues_deg)
    return mff.SolidModel(solid.vertices, solid.faces, np.radians(hues))


def prism() -> mff.SolidModel:
    """A hexagonal prism with eight hues; neighbors differ by at least 90 deg."""
    angles = math.pi * (2.0 * np.arange(6) + 1.0) / 6.0
    ring = 0.075 * np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = [(*p, z) for z in (-0.09, 0.09) for p in ring]
    sides = [(i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i) for i in range(6)]
    faces = [tuple(range(6, 12)), tuple(reversed(range(6))), *sides]
    return mff.SolidModel(vertices, faces, np.radians([0, 180, 45, 135, 225, 315, 90, 270]))


def wedge() -> mff.SolidModel:
    """Half a box, with five hues."""
    ends = [(x, y, -0.09) for x, y in ((-0.06, -0.07), (0.06, -0.07), (0.06, 0.07), (-0.06, 0.07))]
    vertices = [*ends, (-0.06, -0.07, 0.09), (-0.06, 0.07, 0.09)]
    faces = [(0, 3, 2, 1), (0, 1, 4), (1, 2, 5, 4), (2, 3, 5), (0, 4, 5, 3)]
    return mff.SolidModel(vertices, faces, np.radians(72.0 * np.arange(5)))


SOLIDS = {
    "box": box(0, 120, 240),
    "six-colored box": box(0, 180, 120, 300, 240, 60),
    "hexagonal prism": prism(),
    "wedge": wedge(),
}
"""Those of the page."""

MODELS = {
    f"models/{path.stem}": mff.SolidModel.from_mesh_file(path)
    for path in sorted((Path(__file__).parents[2] / "models").glob("*.obj"))
}
"""Those that come with the package."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is to be found, and what is in the way.

    Attributes:
        name: As the page calls it.
        solid: One of the `SOLIDS` or `MODELS`.
        blobs: Number of blobs in the solid's colors, behind it.
        hidden: Share of the solid's pixels that a bar hides in each image.
        noise: Standard deviation of the pixels' noise [levels].
        width: Of the images [px].
        cameras: Number of cameras.
        partly: Whether it is out of one of the images by 15 to 50 %.
        search_range: Where it is.
        frames: For so many frames it is looked at.
    """

    name: str
    solid: str = "box"
    blobs: int = 0
    hidden: float = 0.0
    noise: float = 0.0
    width: int = 640
    cameras: int = 2
    partly: bool = False
    search_range: mff.SearchRange = field(default_factory=mff.SearchRange)
    frames: int = 3

    @property
    def solid_model(self) -> mff.SolidModel:
        """The solid."""
        return (SOLIDS | MODELS)[self.solid]

    @property
    def stereo(self) -> mff.CameraRig:
        """The pair of cameras."""
        height = self.width * 3 // 4
        focal = 0.5 * height / math.tan(math.radians(22.5))
        return mff.CameraRig.stereo(
            width=self.width, height=height, focal_length=focal, baseline=BASELINE
        )

    @property
    def rig(self) -> mff.CameraRig:
        """The cameras whose images are looked at."""
        return mff.CameraRig(self.stereo.cameras[: self.cameras])

    def draw_pose(self, rng: np.random.Generator) -> Array:
        """A pose of the search range that is in view as the case wants it."""
        least, greatest = self.search_range.lower, self.search_range.upper
        while True:
            pose = rng.uniform(least, greatest)
            if np.linalg.norm(pose[3:]) > 1.0:
                continue
            shares = [self.share_in_view(camera, pose) for camera in self.rig.cameras]
            if self.partly:
                if max(shares) == 1.0 and 0.5 <= min(shares) <= 0.85:
                    return np.asarray(pose)
            elif min(shares) == 1.0:
                return np.asarray(pose)

    def share_in_view(self, camera: mff.Camera, pose: Array) -> float:
        """Share of the silhouette's area within an image, 2 pixels from its borders."""
        solid = self.solid_model
        corners = (solid.vertices @ rotation_matrix(pose[3:]).T + pose[:3]) - camera.p_CK
        if corners[:, 2].min() < 0.1:
            return 0.0
        outline = cv2.convexHull(camera.project(corners + camera.p_CK).astype(np.float32))
        ends = np.array([2, 2, camera.width - 3, camera.height - 3], dtype=np.float32)
        frame = ends[[[0, 1], [2, 1], [2, 3], [0, 3]]]
        area, _ = cv2.intersectConvexConvex(outline, frame)
        share = area / cv2.contourArea(outline)
        return 1.0 if share > 0.9999 else float(share)


class Renderer:
    """Draws a case's solid alone, with one of the package's renderers."""

    def __init__(self, case: Case, renderer: str) -> None:
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.001)
        for camera in case.stereo.cameras:
            X_WK = RigidTransform(RotationMatrix(camera.R_CK), camera.p_CK)
            plant.AddFrame(FixedOffsetFrame(f"camera_{camera.name}", plant.world_frame(), X_WK))
        parser = Parser(plant)
        mff.ConfigureParser(parser)
        with tempfile.TemporaryDirectory() as folder:
            parser.AddModels(str(write_model(case.solid_model, Path(folder))))
            plant.Finalize()
            mff.AddRenderer(scene_graph, renderer)
            self._stereo = mff.AddStereoCamera(
                builder, plant=plant, scene_graph=scene_graph, rig=case.stereo, renderer=renderer
            )
            self._diagram = builder.Build()
            self._context = self._diagram.CreateDefaultContext()
            self._plant, self._names = plant, case.rig.names
            self(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))  # The file is read by now.

    def __call__(self, pose: Array) -> list[Image]:
        """The images of a pose."""
        X_CM = RigidTransform(RotationMatrix(rotation_matrix(pose[3:])), pose[:3])
        plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        self._plant.SetFreeBodyPose(plant_context, self._plant.GetBodyByName("solid"), X_CM)
        context = self._stereo.GetMyContextFromRoot(self._context)
        ports = [self._stereo.GetOutputPort(f"color_image_{name}") for name in self._names]
        return [port.Eval(context).data[..., :3].copy() for port in ports]


def write_model(solid: mff.SolidModel, folder: Path) -> Path:
    """Writes an SDF with a mesh of the solid, and returns its path."""
    obj, mtl = ["mtllib solid.mtl"], []
    obj += [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in solid.triangles.reshape(-1, 3)]
    obj += [f"vn {x:.9f} {y:.9f} {z:.9f}" for x, y, z in solid.normals]
    for k, hue in enumerate(solid.hues):
        red, green, blue = colorsys.hsv_to_rgb(hue / (2.0 * math.pi), 1.0, 1.0)
        mtl += [f"newmtl m{k}", f"Kd {red:.6f} {green:.6f} {blue:.6f}", "Ka 0 0 0", "Ks 0 0 0"]
        obj.append(f"usemtl m{k}")
        for t in np.flatnonzero(solid.triangle_faces == k):
            obj.append("f " + " ".join(f"{3 * t + j}//{k + 1}" for j in (1, 2, 3)))
    (folder / "solid.obj").write_text("\n".join(obj) + "\n")
    (folder / "solid.mtl").write_text("\n".join(mtl) + "\n")
    sdf = folder / "solid.sdf"
    sdf.write_text(
        '<sdf version="1.7"><model name="solid"><link name="solid"><visual name="solid"><geometry>'
        "<mesh><uri>solid.obj</uri></mesh></geometry></visual></link></model></sdf>"
    )
    return sdf


def disturb(images: list[Image], case: Case, seed: list[int], frame: int) -> list[Image]:
    """The images with the case's blobs, bar and noise; these stay where they are, but the noise."""
    rng = np.random.default_rng(seed)
    colors = [
        255.0 * np.array(colorsys.hsv_to_rgb(hue / (2.0 * math.pi), 1.0, 1.0))
        for hue in case.solid_model.hues
    ]
    shown = [cv2.subtract(*_extremes(image)) > 25 for image in images]
    behind = [np.full_like(image, 128) for image in images]
    for outline, disparity, color in _blobs(case, colors, rng):
        for k, image in enumerate(behind):
            shifted = np.rint(outline + np.array([k * disparity, 0.0])).astype(np.int32)
            cv2.fillPoly(image, [shifted], tuple(color))
    pictures = zip(images, behind, shown, strict=True)
    images = [np.where(mask[..., None], image, blobs) for image, blobs, mask in pictures]
    if case.hidden:
        _hide(images, shown, case, rng)
    if case.noise:
        noise = np.random.default_rng([*seed, frame])
        images = [
            cv2.add(
                image,
                case.noise * noise.standard_normal(image.shape, dtype=np.float32),
                dtype=cv2.CV_8U,  # rounded, and kept within 0 to 255
            )
            for image in images
        ]
    return images


def _extremes(image: Image) -> tuple[Image, Image]:
    """The greatest and the least channel of every pixel."""
    first, second, third = cv2.split(image)
    greatest, least = cv2.max(first, second), cv2.min(first, second)
    return cv2.max(greatest, third), cv2.min(least, third)


def _blobs(
    case: Case, colors: list[Array], rng: np.random.Generator
) -> Iterator[tuple[Array, float, Array]]:
    """Outline [px], disparity and color of discs and polygons 1 to 2.5 m away."""
    camera = case.rig.cameras[0]
    for _ in range(case.blobs):
        disparity = camera.fx * BASELINE / rng.uniform(1.0, 2.5)
        center = rng.uniform(0.0, [camera.width, camera.height])
        radius = rng.uniform(8.0, 50.0) * case.width / 640
        angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, rng.integers(3, 9)))
        if rng.random() < 0.5:
            angles = 2.0 * math.pi * np.arange(24) / 24
        outline = radius * np.column_stack([np.cos(angles), rng.uniform(0.4, 1) * np.sin(angles)])
        brightness = rng.uniform(0.6, 1.0)
        yield center + outline, disparity, brightness * colors[rng.integers(len(colors))]


def _hide(images: list[Image], shown: list[Image], case: Case, rng: np.random.Generator) -> None:
    """Lays a bar over one side of the solid, in a random direction: grey, or of another hue."""
    angle = rng.uniform(0.0, 2.0 * math.pi)
    color = np.array(GREY)
    if rng.integers(2):
        hues = np.unique(case.solid_model.hues)
        gaps = np.diff(np.append(hues, hues[0] + 2.0 * math.pi))
        middle = hues[np.argmax(gaps)] + 0.5 * gaps.max()
        color = 200.0 * np.array(colorsys.hsv_to_rgb(middle / (2.0 * math.pi) % 1.0, 0.8, 1.0))
    for image, mask in zip(images, shown, strict=True):
        v, u = np.ogrid[: image.shape[0], : image.shape[1]]
        along = u * math.cos(angle) + v * math.sin(angle)
        on_solid = along[mask]
        if len(on_solid):
            least = on_solid.min() - 0.05 * image.shape[0]
            image[(along > least) & (along < np.quantile(on_solid, case.hidden))] = color
