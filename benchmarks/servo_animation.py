"""Draws docs/images/servo.webp: the arm follows the box, with what its cameras see.

python benchmarks/servo_animation.py [--out FILE.webp]
"""

import argparse
import logging
from pathlib import Path

import cv2
import numpy as np

from mffdrake.experiment.scenario.scenario import Change, ServoDefaults
from mffdrake.experiment.simulation.pictures import DrawCameraView, DrawScene
from mffdrake.experiment.simulation.simulation import Simulate
from mffdrake.experiment.simulation.wiring.diagram import MakeHandEyeDiagram
from mffdrake.recognition.recordings.files import MakeOutputFolder, WholeFile

PERIOD = 5.0  # [s]
EVERY = 3  # frames of the simulation are one of the animation
WIDTH, HEIGHT = 640, 480  # of the scene, of which these rows have the arm and the box; the
ROWS = slice(80, 370)
VIEW_ROWS = slice(0, 230)  # cameras' views below it are half as large.
QUALITY = 85


def main() -> None:
    """Simulates one swing that can go round and round, and draws it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = Path(__file__).parents[1] / "docs/images/servo.webp"
    parser.add_argument("--out", type=Path, default=default)
    out = parser.parse_args().out
    logging.getLogger("mffdrake").setLevel(logging.ERROR)
    motion = {"_tag": "!Sinusoids", "amplitude": [0.0, 0.15, 0.0],
              "amplitude_deg": [0.0, 0.0, 12.0], "period": [PERIOD]}  # fmt: skip
    values = {"duration": 2.0 * PERIOD, "target.motion": motion}
    scenario = Change(ServoDefaults(), values)
    diagram = MakeHandEyeDiagram(scenario)
    names = diagram.GetSubsystemByName("recognizer").tracker.rig.names
    ports = [diagram.GetOutputPort(f"stereo_camera.color_image_{name}") for name in names]
    seen: list[list[np.ndarray]] = []

    def look(context) -> None:
        seen.append([port.Eval(context).data.copy() for port in ports])

    result = Simulate(scenario, diagram=diagram, on_exposure=look)
    frames = []
    for k in np.flatnonzero(result.time >= PERIOD)[::EVERY].tolist():
        scene = DrawScene(diagram, result, k, width=WIDTH, height=HEIGHT)[ROWS]
        views = DrawCameraView(diagram, scenario, result, k, images=seen[k])
        views = cv2.resize(views, (WIDTH, HEIGHT // 2), interpolation=cv2.INTER_AREA)
        views = views[VIEW_ROWS]
        frames.append(cv2.cvtColor(np.vstack([scene, views]), cv2.COLOR_RGB2BGR))
    animation = cv2.Animation()
    animation.frames = frames
    milliseconds = round(1e3 * EVERY * scenario.timing.vision_period)
    animation.durations = [milliseconds] * len(frames)
    MakeOutputFolder(out.parent)
    with WholeFile(out) as part:
        fine = cv2.imwriteanimation(str(part), animation, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    if not fine:
        raise SystemExit(f"{out}: cannot be written")
    print(f"{out}: {len(frames)} frames, {out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
