"""What the robustness study disturbs, and how strongly."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from mffdrake.experiment.scenario.scenario import Change, LoadScenario, Scenario
from mffdrake.recognition.parameters.yaml_text import ReadYaml

MOTIONS = {"path": "the paper's path at 0.314 rad/s", "shaking": "the shaking hand"}
RECOGNIZER = "{renderer: flat, recognizer: {refinement: borders, start: random}}"
# "All together" has none of these: they last for a while, or leave less of the target.
APART = ("frozen images", "black images", "hidden", "out of view")
# The target's center stands so far in front of the cameras [m], and so high and wide it is [m].
DISTANCE, HEIGHT, WIDTH, BASELINE = 0.8, 0.15, 0.10, 0.15
HALF_VIEW = math.tan(math.radians(0.5 * 45.0)) * DISTANCE  # of an image's height, there [m]


def out_of_view(edge: tuple[str, float]) -> str:
    """Cameras that sit elsewhere on the hand, so that a share of the target is out of view."""
    side, share = edge
    x, y = 0.0, HALF_VIEW + (share - 0.5) * HEIGHT
    if side == "left image":  # The left camera sees things farther right than the right one.
        x, y = HALF_VIEW * 640 / 480 - BASELINE + (share - 0.5) * WIDTH, 0.155
    box = {"x": [x - 0.15, x + 0.15], "y": [y - 0.15, y + 0.15]}
    return f"{{camera: {{p_EC: [{-x}, {-y}, 0]}}, recognizer: {{search_range: {box}}}}}"


def image(tag: str) -> Callable[[Any], str]:
    """A disturbance of the images, with its strength in braces."""
    return f"disturbances: [!{tag}]".format


def groups(T: float) -> dict[str, tuple[Callable[[Any], str], dict[str, Any]]]:
    """Disturbances in runs of a duration T [s]: a strength's scenario, and the strengths."""
    return {
        "none": (lambda s: "{}", {"-": 0}),
        "motion blur": (image("MotionBlur {{exposure: {}}}"),
                        {f"{v} ms": v / 1000 for v in (5, 10, 20)}),
        "noise": (image("GaussianNoise {{deviation: {}}}"),
                  {f"{v} levels": float(v) for v in (5, 10, 20)}),
        "salt and pepper": (image("SaltAndPepper {{share: {}}}"),
                            {f"{v} %": v / 100 for v in (1, 3, 6)}),
        "brightness": (image(f"Brightness {{{{amplitude: {{}}, period: {T}}}}}"),
                       {f"±{v}": v for v in (0.3, 0.6, 0.8)}),
        "color temperature": (image(f"ColorTemperature {{{{amplitude: {{}}, period: {T}}}}}"),
                              {f"±{v}": v for v in (0.2, 0.4, 0.6)}),
        # A plate that passes between cameras and target, and is beside it before and after.
        "occluder": (
            lambda s: f"clutter: [!Occluder {{size: [{s}, 0.5, 0.01], amplitude: 0.4, "
            f"start: {0.3 * T}, duration: {0.4 * T}}}]",
            {"3 cm wide": 0.03, "10 cm wide": 0.1, "30 cm, hides all": 0.3}),
        # A plate that stands in the line of sight; its upper edge, in the target's frame.
        "hidden": (lambda s: "clutter: [!Occluder {size: [0.8, 0.3, 0.01], amplitude: 0, center: "
                   f"[0, {s + 0.15}, -0.3]}}]", {"20 %": -0.014, "40 %": -0.038, "50 %": -0.05}),
        "distractors": (lambda s: f"clutter: [!Distractors {{number: {s}}}]",
                        {str(v): v for v in (6, 12, 20)}),
        "dropped frames": (image("DroppedFrames {{probability: {}}}"),
                           {f"{v} %": v / 100 for v in (5, 10, 20)}),
        "late frames": (image("LateFrames {{frames: 2, probability: {}}}"),
                        {f"{v} %": v / 100 for v in (2, 5, 10)}),
        "left and right out of step": (
            image("LateFrames {{cameras: [left], frames: 1, probability: {}}}"),
            {f"{v} %": v / 100 for v in (5, 20, 100)}),
        "frozen images": (image(f"Frozen {{{{start: {0.3 * T}, duration: {{}}}}}}"),
                          {f"{v} s": v for v in (0.2, 0.5, 1.0)}),
        "black images": (image(f"Black {{{{starts: [{0.3 * T}], duration: {{}}}}}}"),
                         {f"{v} s": v for v in (0.2, 0.5, 1.0)}),
        "encoder noise": (
            "encoders: {{noise_deg: {}}}".format, {f"{v} deg": v for v in (0.02, 0.05, 0.1)}),
        "encoder offset": (
            lambda s: f"encoders: {{offset_deg: {[s * (-1) ** joint for joint in range(7)]}}}",
            {f"{v} deg": v for v in (0.1, 0.3, 1.0)}),
        "hand-eye error": (
            lambda s: f"predictor: {{hand_eye_error_deg: {3 * [float(s)]}, "
            f"hand_eye_error: {3 * [s / 200]}}}",
            {f"{v} deg, {5 * v} mm": v for v in (1, 3, 6)}),
        "focal error": ("calibration: {{focal_error: {}}}".format,
                        {f"{v} %": v / 100 for v in (0.1, 0.2, 0.3)}),
        "baseline error": ("calibration: {{baseline_error: {}}}".format,
                           {f"{v} mm": v / 1000 for v in (0.15, 0.3, 0.45)}),
        "out of view": (
            out_of_view, {"a quarter": ("lower edge", 0.25), "a half": ("lower edge", 0.5),
                          "a half, left only": ("left image", 0.5)}),
    }  # fmt: skip


def conditions(duration: float) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """All conditions, for runs of a duration [s]: group, strength, and what they change."""
    together: dict[str, Any] = {}
    for group, (make, strengths) in groups(duration).items():
        for k, (label, strength) in enumerate(strengths.items()):
            changes = ReadYaml(make(strength))
            yield group, label, changes
            if k == 0 and group not in APART:
                together = _add(together, changes)
    before = ("MotionBlur", "Brightness", "ColorTemp")  # what happens before the sensor
    together["disturbances"].sort(key=lambda one: not any(name in str(one) for name in before))
    yield "all together", "the weakest of each", together


def _add(data: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Both mappings; lists one behind the other."""
    result = copy.deepcopy(data)
    for key, value in more.items():
        lists = result.get(key, []) + value if isinstance(value, list) else value
        result[key] = _add(result.get(key, {}), value) if isinstance(value, dict) else lists
    return result


def motion(name: str, duration: float) -> Scenario:
    """The undisturbed scenario of a motion."""
    if name == "shaking":
        file = Path(__file__).parents[2] / "scenarios" / "shaking_hand.yaml"
        return Change(LoadScenario(file, RECOGNIZER), {"duration": duration})
    return Change(LoadScenario(text=RECOGNIZER), {"duration": duration, "hand_path.omega": 0.314})
