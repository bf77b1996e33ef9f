"""What the studies are called, what they ask, and over what their variants go."""

from __future__ import annotations

__all__ = ["TEXTS"]

_OMEGA = "omega [rad/s]"
_AT_FAST = " With feedforward at 0.314 rad/s."
_VTK = "The same with VTK's renderer in place of the flat one."
_REFINED = (
    "Beyond the paper: every frame's pose is refined to parts of a pixel, by the color borders in "
    "both images."
)

TEXTS: dict[str, tuple[str, str, str]] = {
    "near": (
        "From a first population near the target",
        "The paper's errors leave no room for a search at the start, so its runs began near the "
        "truth; so do these.",
        _OMEGA,
    ),
    "random": (
        "From a random first population",
        "The search starts anywhere within the search range and first has to find the target, "
        "which the figures over 0-40 s include.",
        _OMEGA,
    ),
    "vtk_near": ("On VTK's images, near the target", _VTK, _OMEGA),
    "vtk": ("On VTK's images, from a random first population", _VTK, _OMEGA),
    "fixed": (
        "A fixed camera",
        "The limit that the paper compares itself with: the hand rests at the start of the path, "
        "or at one of its ends, where the feedforward has nothing to do.",
        "angle on the path [deg]",
    ),
    "plain": (
        "The paper's plain GA",
        "Half of the population survives, the rest are crossover children; one row of strip "
        "points; start near the target: what the paper describes and no more.",
        _OMEGA,
    ),
    "gray": (
        "Gray coding",
        "Genes in Gray code instead of the paper's plain binary code.",
        _OMEGA,
    ),
    "generations": (
        "More generations a frame",
        "How much of the feedforward's gain could computing time buy instead?",
        "generations a frame",
    ),
    "refined": ("With sub-pixel refinement", _REFINED, _OMEGA),
    "refined_latency": (
        "Camera latency, with sub-pixel refinement", _REFINED + _AT_FAST,
        "camera latency [frames]",
    ),
    "velocity": (
        "Velocity mode",
        "The hypotheses carried along by pose rate times frame time, Eq. (12), instead of the "
        "exact rigid displacement.",
        _OMEGA,
    ),
    "latency": (
        "Late images",
        "Images that arrive late, by whole frames, when the feedforward reckons with their age "
        f"(known) and when it does not (ignored).{_AT_FAST}",
        "camera latency [frames]",
    ),
    "gain": (
        "Feedforward gain",
        f"Only a share of the hand's motion is fed forward, or more than all of it.{_AT_FAST}",
        "gain",
    ),
    "hand_eye": (
        "Hand-eye calibration",
        "The orientation of the cameras on the hand, as it is known, is wrong by a rotation about "
        f"one axis of the hand.{_AT_FAST}",
        "rotation error [deg]",
    ),
    "noise": (
        "Encoder noise",
        "Every joint angle that the controller and the feedforward read has an error, another one "
        f"every millisecond.{_AT_FAST}",
        "standard deviation [deg]",
    ),
    "faster": (
        "Twice and four times the speed",
        "Beyond the paper's fastest path, as far as the joints allow. The arm swings the more; "
        "its swing can carry the target out of the search range at first.",
        _OMEGA,
    ),
}  # fmt: skip
"""Name of a study to its title, its question, and the axis of its variants with the unit."""
