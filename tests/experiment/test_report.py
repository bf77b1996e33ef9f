"""What the report says, on numbers made by hand."""

import numpy as np
import pytest

from mffdrake.experiment.paper.paper_numbers import PAPER
from mffdrake.experiment.paper.report.figures import PlotStudies, PlotTable
from mffdrake.experiment.paper.report.report import MakeHtml
from mffdrake.experiment.paper.report.tables import (
    InvarianceTable,
    OscillationTable,
    PaperTable,
    StudyTable,
    SummaryLines,
)
from mffdrake.experiment.paper.report.text import MakeText
from mffdrake.experiment.paper.studies import PAPER_OMEGAS
from mffdrake.experiment.paper.study import Reproduction, Study, Summarize, Variant
from mffdrake.experiment.simulation.evaluation import RMS_ERRORS
from mffdrake.experiment.simulation.simulation import SimulationResult

CELLS = ["mean fitness", "x", "y", "z", "eps1", "eps2", "eps3", "position", "rotation"]


def make_row(study, method, omega, *, factor=1.0, settled=1.0, seed=0):
    """A run with the paper's own errors, times a factor, and another one when settled."""
    paper = PAPER[method, omega]
    return {
        "study": study, "label": f"{method}, {omega:g} rad/s", "curve": method, "value": omega,
        "seed": seed, "status": "done", "error": None, "duration": 40.0,
        "mean_fitness": paper["mean_fitness"] / factor,
        "mean_fitness_settled": paper["mean_fitness"] / settled,
        "rms": {name: factor * paper[name] for name in RMS_ERRORS},
        "rms_settled": {name: settled * paper[name] for name in RMS_ERRORS},
    }  # fmt: skip


def summary_of(study="near", **options):
    return Summarize(
        [make_row(study, m, omega, **options) for m in ("ga", "mff") for omega in PAPER_OMEGAS]
    )


def cells(table):
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines()]


# The paper's table.


def test_a_table_has_our_number_the_papers_and_the_verdict_for_every_cell():
    header, _, *rows = cells(PaperTable(summary_of(factor=2.0), "near", "all"))
    assert header == ["method", "figure"] + [
        title for omega in PAPER_OMEGAS for title in (f"{omega:g} rad/s", "paper")
    ]
    assert [row[1].split(" [")[0] for row in rows] == 2 * CELLS
    by_name = {(row[0], row[1]): row[2:] for row in rows}
    assert by_name["MFF + 1-step GA", "z [mm]"][:2] == ["5.71, x2.0", "2.8536"]
    assert by_name["1-step GA", "eps2"][4:] == ["0.1312, x2.0", "0.0656"]
    assert by_name["MFF + 1-step GA", "mean fitness"][:2] == ["0.490, -0.490", "0.9806"]


def test_numbers_as_good_as_the_papers_say_so():
    _, _, *rows = cells(PaperTable(summary_of(), "near", "all"))
    for row in rows:
        assert all(cell.endswith(", ok") for cell in row[2::2])
    plain = PaperTable(summary_of(), "near", "all", verdicts=False)
    assert "ok" not in plain and "| 2.85 | 2.8536 |" in plain


def test_quartiles_stand_in_brackets_where_there_are_several_seeds():
    rows = [make_row("near", "mff", 0.105, factor=f, seed=k) for k, f in enumerate((1, 2, 3))]
    table = PaperTable(Summarize(rows), "near", "all")
    assert "| 5.71 (4.28-7.13), x2.0 | 2.8536 |" in table


def test_the_two_windows_are_kept_apart():
    summary = summary_of(factor=2.0, settled=0.5)
    assert "| 5.71, x2.0 | 2.8536 |" in PaperTable(summary, "near", "all")
    assert "| 1.43, ok | 2.8536 |" in PaperTable(summary, "near", "settled")


def test_a_speed_without_runs_has_no_number_and_no_verdict():
    _, _, *rows = cells(PaperTable([], "near", "all"))
    assert len(rows) == 2 * len(CELLS)
    assert all(row[2::2] == 3 * ["-"] for row in rows)


# In short.


def test_numbers_like_the_papers_are_all_counted_as_reached():
    near, ratio, without = SummaryLines(summary_of())
    assert "21 of 21 medians" in near and "below 0.98 somewhere" in near  # As the paper's are.
    assert "is 1.84 times that at 0.105 rad/s (above 1.15); the paper's is 1.84 times" in ratio
    assert without.startswith("Without") and "2.60 times" in without


def test_cells_that_only_the_search_at_the_start_spoils_are_told_apart():
    (line, *_) = SummaryLines(summary_of("random", factor=3.0))
    assert "0 of 21 medians" in line
    assert "21 more are so without the first 5 s" in line
    assert "Not so" not in line


def test_cells_that_are_worse_in_both_windows_are_named():
    rows = [make_row("near", "mff", omega) for omega in PAPER_OMEGAS]
    for row in rows[1:]:
        row["rms"]["z_mm"] *= 1.5
        row["rms_settled"]["z_mm"] *= 1.5
    (line, *_) = SummaryLines(Summarize(rows))
    assert "19 of 21 medians" in line
    assert "Not so in either window: z at 0.157, 0.314 rad/s." in line


def test_an_error_that_hardly_grows_is_called_invariant():
    rows = [make_row("near", "mff", omega) for omega in (0.105, 0.314)]
    for row, error in zip(rows, (2.0, 2.2), strict=True):
        row["rms_settled"]["position_mm"] = error
    line = list(SummaryLines(Summarize(rows)))[-1]
    assert "is 1.10 times that at 0.105 rad/s (at most 1.15)" in line


def test_the_plain_ga_stands_beside_the_paper():
    lines = [line for line in SummaryLines(summary_of("plain")) if "plain GA" in line]
    assert lines == [
        "The plain GA, which is what the paper describes and no more, has position errors of 15.7, "
        "18.0, 40.9 mm without feedforward (the paper: 15.7, 18.0, 40.9 mm) and 3.1, 6.0, 5.8 mm "
        "with feedforward (the paper: 3.1, 6.0, 5.8 mm)."
    ]


def test_nothing_is_said_of_what_is_not_there():
    assert list(SummaryLines([])) == []


# The other tables.


def test_the_invariance_table_has_ours_the_papers_and_the_fixed_cameras():
    fixed = make_row("fixed", "ga", 0.105) | {"label": "fixed, middle", "curve": "fixed"}
    table = InvarianceTable([*summary_of(settled=0.5), *Summarize([fixed])])
    assert "| MFF + 1-step GA, start near the target | 1.57 | 2.89 | 1.84 |" in table
    assert "| the paper's MFF + 1-step GA, 0-40 s | 3.14 | 5.78 | 1.84 |" in table
    assert "| MFF + 1-step GA, random start | - | - | - |" in table
    assert "| fixed, middle | 15.72 | - | - |" in table


def test_a_variant_that_did_not_run_has_a_remark():
    row = make_row("near", "mff", 0.314)
    failed = row | {"label": "too fast", "status": "unreachable", "error": "a limit | of <S1>"}
    variants = tuple(
        Variant(label=label, curve="a", value=0.0, changes=())
        for label in (row["label"], "too fast")
    )
    study = Study(name="near", title="", question="", axis="", variants=variants, seeds=1)
    lines = StudyTable(Summarize([row, failed]), study).splitlines()
    assert lines[0] == "| variant | seeds | fitness | position [mm] | rotation [deg] | remark |"
    assert lines[2] == "| mff, 0.314 rad/s | 1 | 0.973 | 5.78 | 1.53 |  |"
    assert lines[3] == r"| too fast | 0 | - | - | - | a limit \| of &lt;S1&gt; |"
    assert "remark" not in StudyTable(Summarize([row]), study)


def make_record(omega, *, frequency=0.8, decay=12.0, frames=1200):
    time = 0.033 * np.arange(frames)
    pose = np.zeros((frames, 6))
    swing = pose.copy()
    swing[:, 0] = 0.02 * np.exp(-time / decay) * np.cos(2 * np.pi * frequency * time)
    return SimulationResult(
        scenario=f"hand_path: {{omega: {omega}}}", time=time, true_pose=pose, recognized_pose=pose,
        fitness=np.ones(frames), state=np.ones(frames), confidence=np.ones(frames),
        is_tracking=np.ones(frames), desired_hand_pose=pose, actual_hand_pose=swing,
        joint_positions=np.zeros((frames, 7)), joint_velocities=np.zeros((frames, 7)),
        stages_ms={}, wall_s=1.0,
    )  # fmt: skip


def test_the_swing_is_told_in_hertz_seconds_and_millimeters():
    records = {("mff", 0.105): make_record(0.105), ("mff", 0.314): make_record(0.314, frames=30)}
    table = cells(OscillationTable(Reproduction(studies=(), rows=(), records=records)))
    assert table[2][:3] == ["0.105", "0.800", "12.0"]
    assert table[2][4:] == ["20.0", f"{20.0 * np.exp(-30 / 12.0):.1f}", "1.00"]
    assert table[3][:2] == ["0.314", "too short a run"]


# Pictures.


def drawn(axis):
    """All points of a panel's curves."""
    return [
        (float(x), float(y))
        for line in axis.get_lines() if len(line.get_xdata()) == len(PAPER_OMEGAS)
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    ]  # fmt: skip


def test_the_tables_picture_has_our_medians_and_the_papers_numbers():
    figure = PlotTable(summary_of(factor=2.0))
    assert [axis.get_title().split(" [")[0] for axis in figure.axes] == [
        "mean fitness", "x", "y", "z", "eps1", "eps2", "eps3", "position",
    ]  # fmt: skip
    values = [y for _, y in drawn(figure.axes[3])]
    for method in ("ga", "mff"):
        for omega in PAPER_OMEGAS:
            assert PAPER[method, omega]["z_mm"] in values
            assert any(np.isclose(2.0 * PAPER[method, omega]["z_mm"], values))
    scales = [axis.get_yscale() for axis in figure.axes]
    assert scales == ["linear"] + 7 * ["log"]
    assert len({x for x, _ in drawn(figure.axes[3])}) == 12  # No point hides another one.


QUESTIONS = {
    "random": "Speed", "latency": "Latency", "gain": "Feedforward gain",
    "hand_eye": "Hand-eye calibration", "noise": "Encoder noise", "generations": "Generations",
}  # fmt: skip


def test_the_studies_picture_has_a_panel_for_each_question():
    curve = {"latency": "known", "hand_eye": "x"}
    rows = [
        make_row(study, "mff", omega) | {"curve": curve.get(study, "mff")}
        for study in QUESTIONS for omega in PAPER_OMEGAS
    ]  # fmt: skip
    figure = PlotStudies(Summarize(rows))
    assert [axis.get_title() for axis in figure.axes] == list(QUESTIONS.values())


def test_a_question_that_was_not_asked_has_no_panel():
    """Nor has one of which there is a single point, as there is no curve."""
    single = make_row("gain", "mff", 0.105)
    figure = PlotStudies([*summary_of("random"), *Summarize([single])])
    assert [axis.get_title() for axis in figure.axes] == ["Speed"]
    assert PlotStudies(Summarize([single])) is None
    expected = [(omega, PAPER["mff", omega]["position_mm"]) for omega in PAPER_OMEGAS]
    assert set(expected) <= set(drawn(figure.axes[0]))


# The page.


def test_pictures_are_put_into_the_page(tmp_path):
    (tmp_path / "a.png").write_bytes(b"not really")
    page = MakeHtml("# Title\n\n![what](a.png)\n\n| a | b |\n| --- | --- |\n| 1 | 2 |\n", tmp_path)
    assert 'src="data:image/png;base64,bm90IHJlYWxseQ=="' in page
    assert 'alt="what"' in page and "<td>1</td>" in page
    assert page.startswith("<!DOCTYPE html>") and '<meta charset="utf-8">' in page


def test_a_picture_that_is_missing_is_an_error(tmp_path):
    with pytest.raises(OSError, match=r"a\.png"):
        MakeHtml("![what](a.png)", tmp_path)


def test_pictures_that_there_are_not_are_not_mentioned():
    nothing = Reproduction(studies=(), rows=(), records={})
    assert "](fig8.png)" in MakeText(nothing, [], ["fig8.png"])
    assert "](fig6.png)" not in MakeText(nothing, [], ["fig8.png"])
