"""Draws docs/theory/images/motion_feedforward.png: what happens to hypotheses as the hand moves."""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

TARGET = np.array([0.0, 0.8])  # m, in a plane through the line of sight
CLOUD = 0.03 * np.random.default_rng(3).standard_normal((24, 2))
BOX = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [0.05, 0.075]
C, D = (np.zeros(2), 0.0), (np.array([-0.22, 0.06]), -0.12)  # place [m] and turn [rad]


def turned(points, angle):
    """Points, turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def draw_camera(axes, camera, name, color):
    """A camera and what it sees."""
    place, angle = camera
    view = place + turned(np.array([[-0.33, 1.05], [0.0, 0.0], [0.33, 1.05]]), angle)
    body = place + turned(np.array([[-0.05, -0.09], [0.05, -0.09], [0.0, 0.03]]), angle)
    axes.fill(*body.T, color=color, zorder=3)
    axes.plot(*view.T, color=color, lw=0.8, ls=":")
    axes.text(*(place + turned(np.array([0.1, -0.09]), angle)), name, color=color, fontsize=12)


def draw(path):
    """The three panels."""
    figure = Figure(figsize=(10.5, 4.4), layout="constrained")
    (place_c, turn_c), (place_d, turn_d) = C, D
    seen = turned(TARGET + CLOUD - place_c, -turn_c)  # as pose vectors tell them, in camera C
    panels = (
        ("the last frame", [(C, "C", "C0")], TARGET + CLOUD),
        ("the hand has moved; without feedforward:\nthe same numbers, another place",
         [(C, "C", "0.8"), (D, "D", "C0")], place_d + turned(seen, turn_d)),
        ("with feedforward: each hypothesis is\ncarried along, $X_{DM} = X_{DC}\\,X_{CM}$",
         [(C, "C", "0.8"), (D, "D", "C0")], TARGET + CLOUD),
    )  # fmt: skip
    for axes, (title, cameras, cloud) in zip(figure.subplots(1, 3), panels, strict=True):
        axes.fill(*(TARGET + BOX).T, color="C2", alpha=0.35)
        axes.text(0.09, 0.85, "M", color="C2", fontsize=12)
        for camera, name, color in cameras:
            draw_camera(axes, camera, name, color)
        axes.plot(*cloud.T, "x", color="C3", ms=5)
        axes.set(xlim=(-0.6, 0.45), ylim=(-0.12, 1.08), aspect="equal", title=title)
        axes.set_axis_off()
    figure.savefig(path, dpi=110, bbox_inches="tight")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    default = Path(__file__).parents[1] / "docs/theory/images/motion_feedforward.png"
    parser.add_argument("--out", default=default, type=Path)
    out = parser.parse_args().out
    out.parent.mkdir(parents=True, exist_ok=True)
    draw(out)
