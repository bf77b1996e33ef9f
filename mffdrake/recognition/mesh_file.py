"""Meshes and their colors, from files of all kinds."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FORMATS = (".obj", ".glb", ".gltf", ".ply", ".stl")
_GREYEST = 0.5  # saturation that has a hue
_SAMPLES = 12  # of a texture along a triangle's sides


@dataclass(frozen=True)
class ColoredMesh:
    """Triangles, each of one color.

    Colors are those of faces, of corners (their mean), of materials, or the mean of a texture's
    part that a triangle shows.

    Attributes:
        path: The file.
        triangles: Corner points [m], shape (T, 3, 3).
        colors: Red, green and blue from 0 to 1, shape (T, 3).
        materials: Name of each one's material.
    """

    path: Path
    triangles: Array
    colors: Array
    materials: Sequence[str]

    @classmethod
    def read(cls, path: Path | str) -> ColoredMesh:
        """Reads a mesh file, all its parts as one.

        Args:
            path: An OBJ (with MTL), GLB, GLTF, PLY or STL file.

        Raises:
            FileNotFoundError: When there is no such file.
            ValueError: When it cannot be read, or has no faces or no colors.
        """
        import trimesh  # Slow to import, and needed here alone.

        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"no mesh file {path}")
        if path.suffix.lower() not in FORMATS:
            raise ValueError(f"{path}: meshes are {', '.join(FORMATS)} files; convert it to one")
        try:
            scene = trimesh.load_scene(path, process=False)
            parts = [
                (scene.geometry[name], np.asarray(scene.graph.get(node)[0]))
                for node in scene.graph.nodes_geometry
                for name in [scene.graph.get(node)[1]]
            ]
        except Exception as error:  # of whatever kind the file's contents bring about
            raise ValueError(f"{path}: this is no mesh file that can be read: {error}") from error
        triangles, colors, materials = [], [], []
        for part, X in parts:
            if isinstance(part, trimesh.Trimesh) and len(part.faces):
                own, names = _colors(part, path)
                corners = np.asarray(part.vertices, dtype=float)[np.asarray(part.faces)]
                triangles.append(corners @ X[:3, :3].T + X[:3, 3])
                colors.append(own)
                materials += names
        if not triangles:
            raise ValueError(f"{path}: the file has no faces")
        return cls(path, np.concatenate(triangles), np.concatenate(colors), materials)

    @property
    def hues(self) -> Array:
        """Hue of every triangle [rad], shape (T,).

        Raises:
            ValueError: When one is grey.
        """
        distinct, place = np.unique(self.colors.round(6), axis=0, return_inverse=True)
        hues = np.empty(len(distinct))
        for k, color in enumerate(distinct):
            hue, saturation, _ = colorsys.rgb_to_hsv(*color)
            if saturation < _GREYEST:
                j = int(np.argmax(place.reshape(-1) == k))
                x, y, z = self.triangles[j].mean(axis=0) + 0.0
                raise ValueError(
                    f"{self.path}: face {j} at ({x:.4g}, {y:.4g}, {z:.4g}) m, of material "
                    f"'{self.materials[j]}', has the grey color {color.round(2).tolist()}, which "
                    "has no hue; every face of the target needs a saturated color"
                )
            hues[k] = 2.0 * math.pi * hue
        return hues[place.reshape(-1)]


def _colors(part: Any, path: Path) -> tuple[Array, list[str]]:
    """Color and name of every triangle of a part."""
    visual, count = part.visual, len(part.faces)
    if visual.kind == "face" or visual.kind == "vertex":
        if visual.kind == "face":
            colors = np.asarray(visual.face_colors, dtype=float)[:, :3]
        else:
            corners = np.asarray(visual.vertex_colors, dtype=float)[:, :3]
            colors = corners[np.asarray(part.faces)].mean(axis=1)
        colors = colors / 255.0
        return colors, [_name(color) for color in colors]
    material = getattr(visual, "material", None)
    if material is None:
        raise ValueError(
            f"{path}: the mesh has no colors; every face of the target needs one: give it "
            "materials (OBJ with MTL, GLB), or colors of its faces or corners (PLY)"
        )
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is not None and getattr(visual, "uv", None) is not None:
        colors = _texture_means(image, np.asarray(visual.uv)[np.asarray(part.faces)])
        return colors, [_name(color) for color in colors]
    color = np.asarray(material.main_color, dtype=float)[:3] / 255.0
    name = str(getattr(material, "name", None) or _name(color))
    return np.tile(color, (count, 1)), [name] * count


def _name(color: Array) -> str:
    """A name for a color that has none."""
    red, green, blue = np.rint(255 * color).astype(int).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"


def _texture_means(image: Any, uv: Array) -> Array:
    """Mean color of the part of a texture that each triangle shows, shape (T, 3)."""
    pixels = np.asarray(image.convert("RGB"), dtype=float) / 255.0
    height, width = pixels.shape[:2]
    # Points spread over each triangle: shares of its second and third corner, shape (N, 1)
    grid = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    shares = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 1, 2)
    second, third = np.where(shares.sum(axis=-1, keepdims=True) > 1.0, 1.0 - shares, shares).T
    first = 1.0 - second - third
    at = uv[:, :1] * first.T + uv[:, 1:2] * second.T + uv[:, 2:] * third.T
    u = np.floor(np.mod(at[..., 0], 1.0) * width).astype(int).clip(0, width - 1)
    v = np.floor(np.mod(1.0 - at[..., 1], 1.0) * height).astype(int).clip(0, height - 1)
    means = pixels[v, u].mean(axis=1)
    return np.asarray(np.rint(means * 32) / 32)  # neighbors of nearly one color are of one
