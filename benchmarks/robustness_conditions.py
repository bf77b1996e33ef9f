"""What the robustness study disturbs, and how strongly."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mffdrake.experiment.scenario.scenario import Change, LoadScenario, Scenario
from mffdrake.recognition.parameters.yaml_text import ReadYaml

SCENARIOS = Path(__file__).parents[1] / "scenarios"
MODERATE = "all together"
# Of these, "all together" has none: they last for a while, or leave less of the target.
APART = ("frozen images", "black images", "hidden", "out of view")

MOTIONS = {"path": "the paper's path at 0.314 rad/s", "shaking": "the shaking hand"}
RECOGNIZER = "{renderer: flat, recognizer: {refinement: borders, start: random}}"

# The target's center stands so far in front of the cameras [m], and so high it is [m].
DISTANCE, HEIGHT, WIDTH = 0.8, 0.15, 0.10
HALF_VIEW = math.tan(math.radians(0.5 * 45.0)) * DISTANCE  # of an image's height, there [m]
BASELINE = 0.15


@dataclass(frozen=True, kw_only=True)
class Group:
    """A disturbance in several strengths.

    Attributes:
        name: As the page calls it.
        text: What is disturbed.
        make: A strength to its scenario, as YAML; of the runs' duration [s] too.
        strengths: Labels of the strengths, from weak to strong, and their numbers.
    """

    name: str
    text: str
    make: Callable[..., str]
    strengths: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Condition:
    """A disturbance in one strength: the group's name, the strength's label, its scenario."""

    group: str
    strength: str
    changes: dict[str, Any]

    @property
    def name(self) -> str:
        """A name for a folder."""
        text = f"{self.group} {self.strength}".replace("%", "percent")
        return "-".join("".join(c if c.isalnum() or c in "._" else " " for c in text).split())


def image(tag: str) -> Callable[..., str]:
    """A disturbance of the images, with its strength in braces."""
    return lambda strength, duration: f"disturbances: [!{tag.format(strength, T=duration)}]"


def passing(width: float, duration: float) -> str:
    """A plate that passes between cameras and target, and is beside it before and after."""
    return (
        f"clutter: [!Occluder {{size: [{width}, 0.5, 0.01], amplitude: 0.4, "
        f"start: {0.3 * duration}, duration: {0.4 * duration}}}]"
    )


def hidden(top: float, duration: float) -> str:
    """A plate that stands in the line of sight, its upper edge so high in the target's frame."""
    return (
        "clutter: [!Occluder {size: [0.8, 0.3, 0.01], amplitude: 0, "
        f"center: [0, {top + 0.15}, -0.3]}}]"
    )


def out_of_view(edge: tuple[str, float], duration: float) -> str:
    """Cameras that sit elsewhere on the hand, so that a share of the target is out of view."""
    side, share = edge
    if side == "left image":  # The left camera sees things farther right than the right one.
        half_width = HALF_VIEW * 640 / 480
        x, y = half_width - BASELINE + (share - 0.5) * WIDTH, 0.155
    else:
        x, y = 0.0, HALF_VIEW + (share - 0.5) * HEIGHT
    box = {"x": [x - 0.15, x + 0.15], "y": [y - 0.15, y + 0.15]}
    return f"{{camera: {{p_EC: [{-x}, {-y}, 0]}}, recognizer: {{search_range: {box}}}}}"


def offsets(degrees: float, duration: float) -> str:
    """Constant errors of the joints, by turns in either direction."""
    return f"encoders: {{offset_deg: {[degrees * (-1) ** joint for joint in range(7)]}}}"


def hand_eye(error: tuple[float, float], duration: float) -> str:
    """Errors of the cameras' pose on the hand, about and along every axis."""
    degrees, meters = error
    return f"predictor: {{hand_eye_error_deg: {3 * [degrees]}, hand_eye_error: {3 * [meters]}}}"


GROUPS = (
    Group(
        name="none", text="Nothing is disturbed.", make=lambda s, duration: "{}",
        strengths={"-": 0},
    ),
    Group(
        name="motion blur",
        text="The shutter is open for so long before each frame (`MotionBlur`). The true pose is "
        "that at its end, so a blurred target lies behind it by half the exposure.",
        make=image("MotionBlur {{exposure: {}}}"),
        strengths={f"{v} ms": v / 1000 for v in (5, 10, 20)},
    ),
    Group(
        name="noise", text="Normal noise of every channel of every pixel (`GaussianNoise`).",
        make=image("GaussianNoise {{deviation: {}}}"),
        strengths={f"{v} levels": float(v) for v in (5, 10, 20)},
    ),
    Group(
        name="salt and pepper", text="Pixels that are white or black (`SaltAndPepper`).",
        make=image("SaltAndPepper {{share: {}}}"),
        strengths={f"{v} %": v / 100 for v in (1, 3, 6)},
    ),
    Group(
        name="brightness",
        text="All levels are multiplied by a gain that swings about 1 by so much, once in a run "
        "(`Brightness`).",
        make=image("Brightness {{amplitude: {}, period: {T}}}"),
        strengths={f"±{v}": v for v in (0.3, 0.6, 0.8)},
    ),
    Group(
        name="color temperature",
        text="The gains of red and blue swing in opposite directions by so much, once in a run "
        "(`ColorTemperature`).",
        make=image("ColorTemperature {{amplitude: {}, period: {T}}}"),
        strengths={f"±{v}": v for v in (0.2, 0.4, 0.6)},
    ),
    Group(
        name="occluder",
        text="A grey plate passes 0.3 m in front of the target, from 30 % to 70 % of the run "
        "(`Occluder`). The widest one hides the whole target in both images for a while; the "
        "frames to recover count from when it has come to rest beside the target.",
        make=passing,
        strengths={"3 cm wide": 0.03, "10 cm wide": 0.1, "30 cm, hides all": 0.3},
    ),
    Group(
        name="hidden",
        text="A grey plate stands 0.3 m in front of the target all the time. Seen from the hand's "
        "place at rest, it hides this share of the target's pixels, its lower part, in both "
        "images.",
        make=hidden, strengths={"20 %": -0.014, "40 %": -0.038, "50 %": -0.05},
    ),
    Group(
        name="distractors",
        text="Spheres and cubes of 3 cm in the target's own colors fly about behind it "
        "(`Distractors`).",
        make=lambda s, duration: f"clutter: [!Distractors {{number: {s}}}]",
        strengths={str(v): v for v in (6, 12, 20)},
    ),
    Group(
        name="dropped frames",
        text="Each camera shows its last image again, with this probability (`DroppedFrames`). "
        "Where both do, the images are good ones, but of the frame before: only what is known of "
        "the motion can tell.",
        make=image("DroppedFrames {{probability: {}}}"),
        strengths={f"{v} %": v / 100 for v in (5, 10, 20)},
    ),
    Group(
        name="late frames",
        text="Each camera's image is one or two frames late, with this probability, and then "
        "mostly in one camera alone (`LateFrames`).",
        make=image("LateFrames {{frames: 2, probability: {}}}"),
        strengths={f"{v} %": v / 100 for v in (2, 5, 10)},
    ),
    Group(
        name="left and right out of step",
        text="The left camera's image is one frame late, with this probability; the right one's "
        "never (`LateFrames`). At 100 % the cameras are a frame apart all the time. The right one "
        "is the reference: its time is that of the true pose.",
        make=image("LateFrames {{cameras: [left], frames: 1, probability: {}}}"),
        strengths={f"{v} %": v / 100 for v in (5, 20, 100)},
    ),
    Group(
        name="frozen images",
        text="Both cameras show the same images for so long, from 30 % of the run on (`Frozen`). "
        "The images are good ones, but of an earlier moment: only what is known of the motion can "
        "tell, and `ga` knows nothing of it.",
        make=lambda s, duration: (
            f"disturbances: [!Frozen {{start: {0.3 * duration}, duration: {s}}}]"
        ),
        strengths={f"{v} s": v for v in (0.2, 0.5, 1.0)},
    ),
    Group(
        name="black images",
        text="Both cameras' images are black for so long, from 30 % of the run on (`Black`).",
        make=lambda s, duration: (
            f"disturbances: [!Black {{starts: [{0.3 * duration}], duration: {s}}}]"
        ),
        strengths={f"{v} s": v for v in (0.2, 0.5, 1.0)},
    ),
    Group(
        name="encoder noise",
        text="Normal noise of every joint angle that controller and feedforward read, another "
        "one every tick (`encoders.noise_deg`).",
        make=lambda s, duration: f"encoders: {{noise_deg: {s}}}",
        strengths={f"{v} deg": v for v in (0.02, 0.05, 0.1)},
    ),
    Group(
        name="encoder offset",
        text="Every joint angle is off by so much, by turns in either direction "
        "(`encoders.offset_deg`).",
        make=offsets,
        strengths={f"{v} deg": v for v in (0.1, 0.3, 1.0)},
    ),
    Group(
        name="hand-eye error",
        text="The feedforward takes the cameras to be turned and shifted by so much about and "
        "along every axis (`predictor.hand_eye_error_deg` and `hand_eye_error`).",
        make=hand_eye,
        strengths={
            "1 deg, 5 mm": (1.0, 0.005),
            "3 deg, 15 mm": (3.0, 0.015),
            "6 deg, 30 mm": (6.0, 0.03),
        },
    ),
    Group(
        name="focal error",
        text="The recognizer takes the cameras' focal lengths to be longer by so much "
        "(`calibration.focal_error`). The target then seems farther away by the same share, by "
        "its size as by its disparity, so that the images hardly contradict it.",
        make=lambda s, duration: f"calibration: {{focal_error: {s}}}",
        strengths={f"{v} %": v / 100 for v in (0.1, 0.2, 0.3)},
    ),
    Group(
        name="baseline error",
        text="The recognizer takes the left camera to be farther from the right one by so much "
        "(`calibration.baseline_error`).",
        make=lambda s, duration: f"calibration: {{baseline_error: {s}}}",
        strengths={f"{v} mm": v / 1000 for v in (0.15, 0.3, 0.45)},
    ),
    Group(
        name="out of view",
        text="The cameras sit higher on the hand (or farther to the left), so that this share of "
        "the target, seen from the hand's place at rest, is beyond the lower edge of both images "
        "(or the right edge of the left image alone).",
        make=out_of_view,
        strengths={
            "a quarter": ("lower edge", 0.25),
            "a half": ("lower edge", 0.5),
            "a half, left only": ("left image", 0.5),
        },
    ),
)  # fmt: skip


def conditions(duration: float) -> Iterator[Condition]:
    """All conditions, for runs of a duration [s]."""
    together: dict[str, Any] = {}
    for group in GROUPS:
        for k, (label, strength) in enumerate(group.strengths.items()):
            changes = ReadYaml(group.make(strength, duration=duration))
            yield Condition(group=group.name, strength=label, changes=changes)
            if k == 0 and group.name not in APART:
                together = _add(together, changes)
    together["disturbances"].sort(key=lambda entry: not _is_light(entry))
    yield Condition(group=MODERATE, strength="the weakest of each", changes=together)


def _is_light(disturbance: dict[str, Any]) -> bool:
    """Whether it happens before the sensor; the shutter among these comes first of all."""
    return any(name in str(disturbance) for name in ("MotionBlur", "Brightness", "ColorTemp"))


def _add(data: dict[str, Any], more: dict[str, Any]) -> dict[str, Any]:
    """Both mappings; lists one behind the other."""
    result = copy.deepcopy(data)
    for key, value in more.items():
        if isinstance(value, dict):
            result[key] = _add(result.get(key, {}), value)
        else:
            result[key] = result.get(key, []) + value if isinstance(value, list) else value
    return result


def texts() -> dict[str, str]:
    """The groups' names and what is disturbed in each."""
    known = {group.name: group.text for group in GROUPS}
    known[MODERATE] = (
        "The weakest strength of each group at once, without frozen and black images, with the "
        "whole target in view and no plate that stands before it."
    )
    return known


def motion(name: str, duration: float) -> Scenario:
    """The undisturbed scenario of a motion."""
    file = SCENARIOS / "shaking_hand.yaml" if name == "shaking" else None
    scenario = LoadScenario(file, RECOGNIZER)
    omega = {"hand_path.omega": 0.314} if name == "path" else {}
    return Change(scenario, {"duration": duration, **omega})
