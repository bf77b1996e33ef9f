"""How often a pose is found in the real images of a cube, and how accurately.

    python benchmarks real_images [FOLDER]

FOLDER holds cube_v1 as ../shared/real does; see its README. Colors are learned from its masks; then
random starts over the whole arena, 20 seeds for each variant.
"""

import argparse
import dataclasses as dc
import math
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import yaml
from tqdm import tqdm

import mffdrake as mff
from mffdrake.experiment.runs.table import Markdown
from mffdrake.recognition.poses.pose import pose_from_transform, rotation_angle
from mffdrake.recognition.recordings.color_file import LearnColors
from mffdrake.recognition.recordings.image_files import ReadImage, ReadMask

CAMERAS = ("60", "180", "300")
SEEDS = 20
SIDE = 0.0652
FACES = {
    "red": (1, 0, 0), "green": (0, 1, 0), "blue": (0, 0, 1),
    "yellow": (-1, 0, 0), "magenta": (0, -1, 0), "cyan": (0, 0, -1),
}  # fmt: skip
HUES = {"red": 0, "yellow": 60, "green": 120, "cyan": 180, "blue": 240, "magenta": 300}
EXPECTED = pose_from_transform(
    cv2.Rodrigues(np.array([1.48171, 0.941179, -1.55799]))[0], [-0.014, -0.024, 0.028]
)
ARENA = mff.SearchRange(
    x=(-0.2, 0.2), y=(-0.2, 0.2), z=(-0.02, 0.2), eps1=(-1, 1), eps2=(-1, 1), eps3=(-1, 1)
)


def cube() -> mff.SolidModel:
    """The cube, its faces' materials by their outward normals."""
    box = mff.SolidModel.box((SIDE, SIDE, SIDE), (0.0, 0.0, 0.0))
    names = [
        next(name for name, normal in FACES.items() if np.dot(normal, n) > 0.9) for n in box.normals
    ]
    return mff.SolidModel(box.vertices, box.faces, np.radians([HUES[n] for n in names]), names)


def load(folder: Path) -> tuple[mff.CameraRig, list[np.ndarray], mff.ColorModel]:
    """The rig, its images, and the colors learned from the masks."""
    entries = {
        f"camera{n}": {"calibration": str(folder.resolve() / f"camera_calib_{n}.yml")}
        for n in CAMERAS
    }
    file = Path(tempfile.mkdtemp()) / "rig.yaml"
    file.write_text(yaml.safe_dump({"cameras": entries}, sort_keys=False))
    rig = mff.LoadRig(file)
    images = {name: ReadImage(folder / f"{name}.png") for name in rig.names}
    masks: dict[str, dict[str, np.ndarray]] = {}
    for material in FACES:
        for n in CAMERAS:
            mask = folder / f"{material[0]}{n}.png"
            if mask.is_file():
                masks.setdefault(material, {})[f"camera{n}"] = ReadMask(mask)
    return rig, list(images.values()), LearnColors(cube(), images, masks)


def variants(rig, images):
    """Name, rig and images of each variant."""
    yield "as they are", rig, images
    for k in range(3):
        kept = [i for i in range(3) if i != k]
        some = mff.CameraRig(tuple(rig.cameras[i] for i in kept))
        yield f"without {rig.cameras[k].name}", some, [images[i] for i in kept]
    rng = np.random.default_rng(0)
    noisy = [
        np.clip(np.rint(im + rng.normal(0.0, 6.0, im.shape)), 0, 255).astype(np.uint8)
        for im in images
    ]
    yield "noise of 6 grey levels", rig, noisy
    for gain in (0.6, 0.8, 1.25, 1.6):
        brighter = [np.clip(np.rint(im * gain), 0, 255).astype(np.uint8) for im in images]
        yield f"brightness times {gain:g}", rig, brighter
    for red, blue in ((1.05, 0.95), (1.15, 0.87)):
        tinted = [np.clip(np.rint(im * [red, 1.0, blue]), 0, 255).astype(np.uint8) for im in images]
        yield f"red times {red:g}, blue times {blue:g}", rig, tinted


def measure(name, rig, images, colors, seeds=SEEDS) -> list[str]:
    """Success and accuracy over the seeds."""
    solid = cube()
    matcher = mff.Matcher(mff.SearchModel(solid), rig, colors=colors)
    tracker = mff.OneStepGaTracker(
        matcher=matcher, coding=mff.GeneCoding(search_range=ARENA),
        refiner=mff.BorderRefiner(matcher),
    )  # fmt: skip
    rows = []
    for seed in range(seeds):
        begin = time.perf_counter()
        found = mff.PoseSearch(dc.replace(tracker, seed=seed)).search(images, 400)
        best = found.generation.best
        mm = 1e3 * float(np.linalg.norm(best[:3] - EXPECTED[:3]))
        rad = float(rotation_angle(best[3:], EXPECTED[3:]))
        refined = found.generation.covariance is not None
        residual = matcher_residual(matcher, best, images) if refined else math.nan
        rows.append(
            (mm < 10.0 and rad < 0.2, mm, rad, found.generation.fitness[0], refined, residual,
             1e3 * best[2], found.num_generations, time.perf_counter() - begin)
        )  # fmt: skip
    right = [row for row in rows if row[0]] or rows
    medians = np.nanmedian(np.array(right, dtype=float), axis=0)
    return [
        name, f"{sum(row[0] for row in rows)} of {seeds}", f"{sum(r[4] for r in rows)}",
        f"{medians[1]:.2f}", f"{medians[2]:.3f}", f"{medians[3]:.2f}",
        "" if math.isnan(medians[5]) else f"{medians[5]:.2f}", f"{medians[6]:.1f}",
        f"{medians[7]:.0f}", f"{medians[8]:.2f}",
    ]  # fmt: skip


def matcher_residual(matcher: mff.Matcher, pose: np.ndarray, images) -> float:
    """Root-mean-square distance of the borders at a pose [px]."""
    return mff.BorderRefiner(matcher).refine(pose, images).residual


def table(folder: Path) -> str:
    """All variants."""
    rig, images, colors = load(folder)
    rows = [measure(*variant, colors) for variant in tqdm(list(variants(rig, images)))]
    header = ["images", "within 10 mm and 0.2 rad", "refined", "from the expected pose [mm]",
              "[rad]", "fitness", "residual [px]", "height [mm]", "generations", "s"]  # fmt: skip
    return Markdown(header, rows)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = Path(__file__).parents[3] / "shared" / "real"
    parser.add_argument("folder", nargs="?", type=Path, default=default, help="holds cube_v1")
    place = parser.parse_args().folder / "cube_v1"
    if not place.is_dir():
        parser.error(f"{place} is not there: name the folder that holds cube_v1")
    print(table(place))
