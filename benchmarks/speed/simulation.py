"""Times whole simulations: real-time factor and stages, by renderer and image size.

With motion feedforward, on one core. Every cell is the fastest of some runs, for other programs can
only slow one down.
"""

from mffdrake.experiment.runs.table import Markdown
from mffdrake.experiment.scenario.scenario import LoadScenario
from mffdrake.experiment.simulation.simulation import Simulate

WIDTHS = (320, 640, 1280)
DURATIONS = {"flat": 10.0, "vtk": 3.0}
RUNS = 3


def simulate(renderer: str, width: int):
    """The fastest of some simulations."""
    text = f"""
        renderer: {renderer}
        duration: {DURATIONS[renderer]}
        hand_path: {{omega: 0.314}}
        camera: {{width: {width}, height: {width * 3 // 4}}}
    """
    scenario = LoadScenario(text=text)
    return min((Simulate(scenario) for _ in range(RUNS)), key=lambda result: result.wall_s)


def table() -> str:
    """Real-time factors and stages."""
    header = ["images", "renderer", "flat / vtk", "outside rendering", "real-time factor"]
    stages = ("render", "recognition", "prediction", "total")
    header += [f"{stage} [ms a frame]" for stage in stages]
    rows = []
    for width in WIDTHS:
        factors = {}
        for renderer, duration in DURATIONS.items():
            result = simulate(renderer, width)
            factors[renderer] = duration / result.wall_s
            ms = result.stages_ms
            outside = 1.0 - ms["render"] / ms["total"]
            # The flat renderer's runs come first: the ratio stands in VTK's row.
            ratio = f"{factors['flat'] / factors[renderer]:.1f}" if renderer == "vtk" else ""
            rows.append(
                [f"{width} x {width * 3 // 4}", renderer, ratio, f"{100 * outside:.0f} %"]
                + [f"{factors[renderer]:.2f}"]
                + [f"{ms[stage]:.2f}" for stage in stages]
            )
    return Markdown(header, rows)
