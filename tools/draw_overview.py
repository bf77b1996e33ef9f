"""Draws docs/images/overview.png, the README's picture, from a short simulation."""

from pathlib import Path

import numpy as np

import mffdrake as mff

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    scenario = mff.LoadScenario(text="{hand_path: {omega: 0.314}, duration: 5.0}")
    diagram = mff.MakeHandEyeDiagram(scenario)
    result = mff.Simulate(scenario, diagram=diagram)
    scene = mff.DrawScene(diagram, result, width=1280, height=620)
    views = mff.DrawCameraView(diagram, scenario, result)
    views[:, camera_width(views) - 1 : camera_width(views) + 1] = 255
    views[:2] = 255
    folder = ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    mff.SaveImage(np.vstack([scene, views]), folder / "overview.png")


def camera_width(views: np.ndarray) -> int:
    return views.shape[1] // 2


if __name__ == "__main__":
    main()
