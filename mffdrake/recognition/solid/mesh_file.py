"""Meshes and their colors, from files of all kinds."""

from __future__ import annotations

import colorsys
import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

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
        name: What it is called in messages, e.g. the file's path.
        triangles: Corner points [m], shape (T, 3, 3).
        colors: Red, green and blue from 0 to 1, shape (T, 3); NaN where there is none.
        materials: Name of each one's material.

    Example:
        >>> corners, red = np.zeros((1, 3, 3)), np.array([[1.0, 0.0, 0.0]])
        >>> ColoredMesh("a dot", corners, red, ["paint"]).hues
        array([0.])
    """

    name: str
    triangles: Array
    colors: Array
    materials: Sequence[str]

    @classmethod
    def read(cls, path: Path | str) -> ColoredMesh:
        """Reads a mesh file, all its parts as one.

        The y axis of glTF files, which points upward there, becomes z, as in Drake.

        Args:
            path: An OBJ (with MTL), GLB, GLTF, PLY or STL file.

        Raises:
            FileNotFoundError: When there is no such file.
            ValueError: When it cannot be read, was cut short, or has no triangles.
        """
        import trimesh  # Slow to import, and needed here alone.

        path = Path(path)
        if not path.is_file():
            raise FileNotFoundError(f"no mesh file {path}")
        kind = path.suffix.lower()
        if kind not in FORMATS:
            raise ValueError(f"{path}: meshes are {', '.join(FORMATS)} files; convert it to one")
        if not path.stat().st_size:
            raise ValueError(
                f"{path}: the file is empty (0 bytes), as a failed export leaves it; export the "
                "mesh again"
            )
        try:
            _check_completeness(path)
            scene = trimesh.load_scene(path, process=False)
            parts = [
                (scene.geometry[name], np.asarray(scene.graph.get(node)[0]))
                for node in scene.graph.nodes_geometry
                for name in [scene.graph.get(node)[1]]
            ]
        except FileNotFoundError as error:
            raise ValueError(f"{path}: {error}") from error
        except Exception as error:  # of whatever kind the file's contents bring about
            # A key or an index that its reader looked for says nothing to others.
            told = "" if isinstance(error, LookupError) else " ".join(str(error).split())
            raise ValueError(
                f"{path}: this is no {_format(kind)} file that can be read: it is damaged, cut "
                "short or of another kind; export the mesh again"
                + (f" (its reader says: {told})" if told else "")
            ) from error
        triangles, colors, materials = [], [], []
        for part, X in parts:
            if isinstance(part, trimesh.Trimesh) and len(part.faces):
                if not 0 <= part.faces.min() <= part.faces.max() < len(part.vertices):
                    raise ValueError(
                        f"{path}: a face has a corner that this {_format(kind)} file lacks: it is "
                        "damaged; export the mesh again"
                    )
                own, names = _colors(part)
                corners = np.asarray(part.vertices, dtype=float)[np.asarray(part.faces)]
                triangles.append(corners @ X[:3, :3].T + X[:3, 3])
                colors.append(own)
                materials += names
        if not triangles:
            raise ValueError(
                f"{path}: this {_format(kind)} file holds no triangles: nothing was exported, or "
                "it was cut short; export the mesh again"
            )
        points = np.concatenate(triangles)
        if kind in (".glb", ".gltf"):
            points = np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)
        return cls(str(path), points, np.concatenate(colors), materials)

    @property
    def hues(self) -> Array:
        """Hue of every triangle [rad], shape (T,).

        Raises:
            ValueError: When one has no color, or is grey.
        """
        bare = np.isnan(self.colors[:, 0])
        if bare.any():
            k = int(np.argmax(bare))
            where = (
                "the mesh has no colors" if bare.all() else f"face {k}{self._at(k)} has no color"
            )
            lacking = _lacking_materials(Path(self.name))
            if lacking:
                where += f" (it names the materials of {lacking}, a file that is not there)"
            if self.name.lower().endswith(".stl"):
                where += " (those that some programs write into STL files are not read)"
            raise ValueError(
                f"{self.name}: {where}; every face of the target needs one: give it materials (OBJ "
                "with MTL, GLB), or colors of its faces or corners (PLY)"
            )
        distinct, place = np.unique(self.colors.round(6), axis=0, return_inverse=True)
        hues = np.empty(len(distinct))
        for k, color in enumerate(distinct):
            hue, saturation, _ = colorsys.rgb_to_hsv(*color)
            if not saturation >= _GREYEST:  # NaN, too, of a color that is none
                j = int(np.argmax(place.reshape(-1) == k))
                raise ValueError(
                    f"{self.name}: face {j}{self._at(j)}, of material '{self.materials[j]}', has "
                    f"the grey color {color.round(2).tolist()}, which has no hue; every face of "
                    "the target needs a saturated color"
                )
            hues[k] = 2.0 * math.pi * hue
        return hues[place.reshape(-1)]

    def as_obj(self, materials_file: str) -> tuple[str, str]:
        """The texts of an OBJ file with all that this mesh has, and of its MTL file.

        Args:
            materials_file: Name of the MTL file.
        """
        vertices, index = np.unique(self.triangles.reshape(-1, 3), axis=0, return_inverse=True)
        a, b, c = self.triangles.transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
        lines = [f"mtllib {materials_file}"]
        for letters, rows in (("v", vertices), ("vn", normals)):
            lines += [f"{letters} {x!r} {y!r} {z!r}" for x, y, z in rows.tolist()]
        colors: dict[str, list[float]] = {}
        faces: dict[str, list[str]] = {}
        for k, (corners, color) in enumerate(
            zip(index.reshape(-1, 3).tolist(), self.colors.tolist(), strict=True)
        ):
            name = "_".join(self.materials[k].split())  # in an OBJ file, one word
            if colors.setdefault(name, color) != color:
                name = f"{name}_{color_name(self.colors[k])}"
                colors[name] = color
            face = "f " + " ".join(f"{v + 1}//{k + 1}" for v in corners)
            faces.setdefault(name, []).append(face)
        for name in reversed(faces):  # `read` gets the last material first.
            lines += [f"usemtl {name}", *faces[name]]
        dull = "newmtl {}\nKa 0 0 0\nKd {!r} {!r} {!r}\nKs 0 0 0\nd 1\nillum 1\n"
        materials = [dull.format(name, *color) for name, color in colors.items()]
        return "\n".join(lines) + "\n", "\n".join(materials)

    def _at(self, triangle: int) -> str:
        """Where a triangle is, in a message."""
        return " at ({:.4g}, {:.4g}, {:.4g}) m".format(*(self.triangles[triangle].mean(axis=0) + 0))


def _format(suffix: str) -> str:
    """What people call files with a suffix."""
    return {".gltf": "glTF"}.get(suffix, suffix[1:].upper())


def _check_completeness(path: Path) -> None:
    """Finds what is missing where trimesh would not say so.

    Raises:
        FileNotFoundError: When a glTF file names another one that is not there.
        ValueError: When the file was cut short.
    """
    if path.suffix.lower() == ".gltf":
        tree = json.loads(path.read_text(encoding="utf-8"))
        parts = [*tree.get("buffers", ()), *tree.get("images", ())]
        for uri in [unquote(part.get("uri", "data:")) for part in parts]:
            if not uri.startswith("data:") and not (path.parent / uri).is_file():
                raise FileNotFoundError(
                    f"the file {uri} that it names is missing beside it; copy it there, or export "
                    "the mesh as GLB, which is one file"
                )
    elif path.suffix.lower() == ".ply":
        head, _, body = path.read_bytes().partition(b"end_header")
        counts = re.findall(rb"^element\s+\w+\s+(\d+)", head, re.MULTILINE)
        rows, wanted = sum(1 for row in body.splitlines() if row.strip()), sum(map(int, counts))
        if b"format ascii" in head and rows < wanted:
            raise ValueError(f"{rows} rows instead of {wanted}")
    elif path.suffix.lower() == ".obj":
        last = path.read_bytes().rsplit(b"\n", 1)[-1].split()
        if last[:1] in ([b"v"], [b"f"]) and len(last) < 4:
            raise ValueError("its last line is unfinished")


def _colors(part: Any) -> tuple[Array, list[str]]:
    """Color and name of every triangle of a part."""
    visual, count = part.visual, len(part.faces)
    if visual.kind == "face" or visual.kind == "vertex":
        if visual.kind == "face":
            colors = np.asarray(visual.face_colors, dtype=float)[:, :3]
        else:
            corners = np.asarray(visual.vertex_colors, dtype=float)[:, :3]
            colors = corners[np.asarray(part.faces)].mean(axis=1)
        colors = colors / 255.0
        return colors, [color_name(color) for color in colors]
    material = getattr(visual, "material", None)
    if material is None:
        return np.full((count, 3), np.nan), count * [""]
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is not None and getattr(visual, "uv", None) is not None:
        colors = _texture_means(image, np.asarray(visual.uv)[np.asarray(part.faces)])
        return colors, [color_name(color) for color in colors]
    color = _material_color(material)
    return np.tile(color, (count, 1)), [str(material.name or color_name(color))] * count


def _material_color(material: Any) -> Array:
    """Color of a material: Kd of an MTL file, black without it; or glTF's base color, or white."""
    if hasattr(material, "baseColorFactor"):
        factor = material.baseColorFactor
        return np.ones(3) if factor is None else np.asarray(factor, dtype=float)[:3] / 255.0
    return np.array(material.kwargs.get("kd", (0.0, 0.0, 0.0)), dtype=float)


def _lacking_materials(path: Path) -> str:
    """The file of materials that an OBJ names and that is not there; empty if there is none."""
    if path.suffix.lower() != ".obj" or not path.is_file():
        return ""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        words = line.split(maxsplit=1)
        if (
            len(words) == 2
            and words[0] == "mtllib"
            and not (path.parent / words[1].strip()).exists()
        ):
            return words[1].strip()
    return ""


def color_name(color: Array) -> str:
    """A name for a color, of red, green and blue from 0 to 1, that has none."""
    red, green, blue = np.rint(255 * color[:3]).astype(int).tolist()
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
