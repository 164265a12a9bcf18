"""The paper's tables: typed in as printed, its arithmetic redone, this run's results in their places."""

from __future__ import annotations

import doctest
import io
import json
import math
import re
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from aw4d.errors import InputError
from aw4d.evaluation.result import Result, to_json, write_json
from aw4d.reproduce import (
    check,
    counts,
    formulas,
    paper,
    read_results,
    reproduce_tables,
    statements,
    tables,
    user_study,
)
from aw4d.reproduce.check import Check, Verdict
from eval.score import Score
from eval.values import Undefined
from tests import paper_source
from tests.bench.white_furnace import furnace

PAPER = paper.paper()
CHECKS = {c.what: c for c in tables().checks}
PLANS = [label for label in PAPER.tables if label.startswith(("tab:ablation", "tab:syn"))]
MEASURED = [label for label in PAPER.tables if label not in (*PLANS, "tab:comparison")]


@pytest.fixture(scope="module")
def tex(test_data: Path) -> str:
    source = test_data.parent / "paper" / "autoweather4d.tex"
    if not source.is_file():
        pytest.skip(f"no source of the paper: {source} does not exist")
    return paper_source.without_comments(source.read_text(encoding="utf-8"))


def line(start: str) -> Check:
    return next(c for what, c in CHECKS.items() if what.startswith(start))


# ---- What is typed in


def test_every_table_of_the_paper_has_its_entry(tex: str) -> None:
    assert sorted(paper_source.table_labels(tex)) == sorted(PAPER.tables)


@pytest.mark.parametrize("label", MEASURED)
def test_figures_are_the_printed_ones_in_the_printed_order(tex: str, label: str) -> None:
    typed = {row: [str(c) for c in cells if c != "-"] for row, cells in PAPER.tables[label].rows.items()}
    printed = {name: paper_source.numbers(" ".join(cells)) for name, *cells in paper_source.table_rows(tex, label)}
    if label == "tab:Running_time":
        assert list(typed.values()) == list(printed.values())
    else:
        assert typed == printed


def test_capabilities_are_the_printed_ones(tex: str) -> None:
    rows = paper_source.table_rows(tex, "tab:comparison")
    printed = {name: tuple("\\checkmark" in cell for cell in cells) for name, *cells in rows}
    assert dict(PAPER.tables["tab:comparison"].rows) == printed


@pytest.mark.parametrize("label", PLANS)
def test_plans_of_ablations_are_the_printed_ones(tex: str, label: str) -> None:
    outcome = PAPER.tables[label].column("outcome")
    rows = {re.sub(r"\s", "", name): cells[-1] for name, *cells in paper_source.table_rows(tex, label)}
    assert list(outcome) == list(rows)
    for row, typed in outcome.items():
        words = str(typed).removeprefix("same as ").replace("experiment", "Experiment").replace("not", "Not")
        assert words in rows[row], row
        assert str(typed).startswith("same") == ("Duplicate" in rows[row]), row


@pytest.mark.parametrize("figure", PAPER.figures.values(), ids=lambda figure: figure.name)
def test_numbers_of_the_text_stand_in_their_section(tex: str, figure: paper.Figure) -> None:
    text = paper_source.section(tex, figure.section)
    if figure.printed:
        assert figure.printed in text
    else:
        assert re.search(rf"(?<![\d.]){re.escape(str(figure.value))}(?![\d]|\.\d)", text), figure.value


@pytest.mark.parametrize(
    "title",
    [
        "Experimental Setting",
        "User Study",
        "Applications",
        "Light Pass Editing Ablation Study.",
        "VidRefiner Ablation Study.",
        *MEASURED,
    ],
)
def test_every_number_of_a_section_of_results_is_typed_in(tex: str, title: str) -> None:
    values = {str(figure.value) for figure in PAPER.figures.values()}
    values |= {str(cell) for table in PAPER.tables.values() for cells in table.rows.values() for cell in cells}
    assert set(paper_source.numbers(paper_source.section(tex, title))) <= values


def test_tokens_are_those_of_the_printed_prompts(tex: str, open_clip: Any) -> None:
    encode = open_clip.tokenizer.SimpleTokenizer().encode
    text = paper_source.section(tex, "Text Prompt Design and Templates")
    base = re.findall(r"``([^']*)''", text)[-1]
    found = {"base": len(encode(base))}
    for weather, title in (("night", "Night"), ("fog", "Fog"), ("snow", "Snowy"), ("rain", "Rainy")):
        instruction = paper_source.section(tex, f"{title} Scene Conversion Instruction").split("\n")[0]
        found[weather] = len(encode(instruction.split("Instruction:}")[1].strip()))
    assert found == dict(PAPER.prompt_tokens)


def test_every_measured_column_says_what_it_needs() -> None:
    for table in PAPER.tables.values():
        for column in table.columns:
            assert bool(column.match) == bool(column.needs), column.name
            assert bool(column.better) == bool(column.match or column.of), column.name
            assert not column.of or column.of in [other.name for other in table.columns]
        assert all(len(cells) == len(table.columns) for cells in table.rows.values()), table.label


# ---- The paper's own arithmetic


def test_no_two_lines_have_one_name() -> None:
    assert len(CHECKS) == len(tables().checks)


@pytest.mark.parametrize(
    ("what", "verdict"),
    [
        ("answers", Verdict.CONTRADICTS),
        ("pairs of clips", Verdict.CONTRADICTS),
        ("win rate of ours", Verdict.CONTRADICTS),
        ("baselines' win rates", Verdict.CONTRADICTS),
        ("design of the study", Verdict.CONTRADICTS),
        ("edited videos", Verdict.AGREES),
        ("frames evaluated", Verdict.AGREES),
        ("RainyGS", Verdict.CONTRADICTS),
        ("Ditto is", Verdict.CONTRADICTS),
        ("modules 1+4+5", Verdict.CONTRADICTS),
        ("modules 1+3+4+5", Verdict.CONTRADICTS),
        ("place of ours in box IoU", Verdict.AGREES),
        ("blue over red", Verdict.CONTRADICTS),
        ("share of the schedule", Verdict.AGREES),
        ("coverage where there is no snow", Verdict.UNPHYSICAL),
    ],
)
def test_verdicts(what: str, verdict: Verdict) -> None:
    assert line(what).verdict is verdict


def test_answers_of_the_described_study_are_960() -> None:
    assert (line("answers").printed, line("answers").gives) == (1440, 12 * 4 * 10 * 2)


def test_printed_win_rates_are_those_of_a_round_robin_of_1440_answers() -> None:
    rates = PAPER.tables["tab:eval_general_uniform"].numbers("human")
    met = user_study.all_against_all(PAPER, rates)
    assert [rate.wins for rate in met.values()] == [0, 245, 334, 385, 476]
    assert {rate.trials for rate in met.values()} == {576}
    assert sum(rate.wins for rate in met.values()) == 1440
    low, high = met["Ours"].interval or (0, 0)
    assert (low, high) == pytest.approx((0.793, 0.855), abs=5e-4)


def test_if_every_baseline_met_ours_alone_ours_would_have_won_58_per_cent() -> None:
    assert line("win rate of ours").gives == pytest.approx(1 - (0 + 0.425 + 0.580 + 0.668) / 4)


@given(st.integers(1, 1000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), st.integers(1, 6))
def test_the_count_behind_a_rounded_rate_is_among_those_that_give_it(counted: tuple[int, int], digits: int) -> None:
    won, answers = counted
    rate = Decimal(f"{won / answers:.{digits}f}")
    assert won in user_study.wins({"": rate}, answers)[""]


def test_all_printed_percentages_hold() -> None:
    lines = [c for what, c in CHECKS.items() if what.endswith("increase [%]")]
    assert len(lines) == 8
    for c in lines:
        assert c.verdict is Verdict.AGREES
        assert f"{c.gives:.2f}" == f"{c.printed:.2f}"


def test_a_wrong_percentage_is_found() -> None:
    assert check.compared("", "", printed=Decimal("0.94"), gives=counts.increase(49.66, 49.20), how="").verdict == (
        Verdict.CONTRADICTS
    )


def test_ranks_follow_the_direction_that_is_better() -> None:
    table = PAPER.tables["tab:perceptual_metrics"]
    fvd, dover = table.columns
    assert [counts.rank(table, fvd, row) for row in table.rows] == [4, 5, 1, 3, 2]
    assert [counts.rank(table, dover, row) for row in table.rows] == [5, 4, 3, 1, 2]


def test_the_literal_brdf_returns_29_times_the_light() -> None:
    """Against the quadrature over microfacets and cosine that the bench uses."""
    for NoV, convention in ((0.05, "paper"), (1.0, "paper"), (0.05, "physical"), (1.0, "physical")):
        found = formulas.white_furnace(0.3, NoV, convention)
        assert found == pytest.approx(furnace(convention, 0.3, NoV, nodes=300), rel=0.02)
    assert line("light that a white metal").gives == pytest.approx(29.3, abs=0.05)


def test_poly6_integrates_to_one_and_its_slope_is_the_printed_one() -> None:
    """A density over the ball; 945 / (32 pi rho^9) r (rho^2 - r^2)^2 downwards."""
    rho = 0.5
    r = np.linspace(0, rho, 2001)
    density = np.array([formulas.poly6(float(x), rho) for x in r])
    assert np.trapezoid(4 * np.pi * r**2 * density, r) == pytest.approx(1, abs=1e-5)
    slope = (formulas.poly6(0.2 + 1e-6, rho) - formulas.poly6(0.2 - 1e-6, rho)) / 2e-6
    assert slope == pytest.approx(-945 / (32 * math.pi * rho**9) * 0.2 * (rho**2 - 0.2**2) ** 2, rel=1e-6)
    assert line("height of one metaball").gives == pytest.approx((12.5, 1567), rel=5e-3)


def test_numbers_of_the_formulas() -> None:
    assert line("coverage where").gives == pytest.approx((1 / (1 + math.exp(0.8 * 0.03))) ** 0.9)
    assert line("index of the first").gives == 20 - 1 - math.floor(19 * 0.4)
    assert line("share of the schedule").gives == pytest.approx(8 / 20)
    assert line("fog towards").gives == pytest.approx((1.8 / 0.2) ** 3)
    assert line("blue over red").gives == pytest.approx(1.25 / 0.70)
    assert line("share of the fog's colour").gives == 0.5
    assert line("largest sum of the puddles").gives == 7 / 8
    assert 0.5 < float(str(line("share of a large road").gives)) < 0.7


def test_prompts_are_longer_than_clip_reads() -> None:
    assert line("tokens of a prompt").gives == (128, 146)
    assert statements.CLIP_CONTEXT < 128


def test_examples_in_docstrings() -> None:
    for module in (check, counts, formulas, paper, statements, user_study):
        assert doctest.testmod(module).failed == 0


# ---- This run beside the paper


def record(metric: str, value: float | None, **more: str) -> dict[str, Any]:
    return {
        "metric": metric,
        "convention": "paper",
        "figure": "value",
        "value": value,
        "method": "Ours",
        "file": "r",
        **more,
    }


def written(path: Path, result: dict[str, Any], **labels: str) -> Path:
    path.write_text(json.dumps({"results": [result], "skipped": {}, **labels}), encoding="utf-8")
    return path


def cell(results: list[dict[str, Any]], label: str, row: str, column: str) -> Any:
    table = next(table for table in tables(results).tables if table.label == label)
    return table.rows[row][table.columns.index(column)]


def test_without_results_every_measured_figure_names_what_is_missing() -> None:
    report = tables()
    for table in report.tables:
        for cells in table.rows.values():
            for better, one in zip(table.better, cells, strict=True):
                assert one.this_run is None
                skipped = not better or (table.label == "tab:downstream" and one.printed == "-")
                assert one.note.startswith("missing: ") != skipped, (table.label, one)
    needed = [figure for figure in report.figures if PAPER.figures[figure.name].needs]
    assert needed
    assert all(figure.cell.note.startswith("missing: ") for figure in needed)


def test_a_result_lands_in_its_cell_alone() -> None:
    results = [record("edge-f1", 0.25), record("edge-f1", 0.5, method="Ditto")]
    filled = [
        (table.label, row, one.this_run)
        for table in tables(results).tables
        for row, cells in table.rows.items()
        for one in cells
        if one.this_run is not None
    ]
    assert filled == [("tab:edge_f1", "Ditto", 0.5), ("tab:edge_f1", "Ours", 0.25)]
    assert cell(results, "tab:edge_f1", "Ours", "edge F1").note == "paper"
    assert cell(results, "tab:edge_f1", "Ours", "edge F1").printed == "0.129"


def test_weathers_count_alike() -> None:
    results = [record("clip", mean, weather=weather) for mean, weather in ((0.2, "fog"), (0.3, "rain"))]
    assert cell(results, "tab:eval_general_uniform", "Ours", "CLIP score").this_run == pytest.approx(0.25)


def test_increases_are_over_this_runs_own_first_row() -> None:
    acdc = {"set": "ACDC"}
    results = [record("seg", 50.0, method="w/ ours", **acdc), record("seg", 40.0, method="w/o augmentation", **acdc)]
    assert cell(results, "tab:downstream", "w/ ours", "ACDC mIoU, increase").this_run == pytest.approx(25)
    assert cell(results, "tab:downstream", "w/ cosmos", "ACDC mIoU, increase").this_run is None
    assert cell(results[:1], "tab:downstream", "w/ ours", "ACDC mIoU, increase").note.startswith("missing: ")


def test_an_undefined_result_is_said_not_dropped() -> None:
    results = [record("edge-f1", None, reason="no edges"), record("edge-f1", 0.5)]
    one = cell(results, "tab:edge_f1", "Ours", "edge F1")
    assert one.this_run is None
    assert one.note == "no edges, in 1 of 2 results"


def test_results_of_two_conventions_are_refused() -> None:
    with pytest.raises(InputError, match=r"edge-f1 of Ours.*one convention.*pai-bench.*paper"):
        tables([record("edge-f1", 0.1), {**record("edge-f1", 0.2), "convention": "pai-bench"}])


def test_what_eval_writes_is_read(tmp_path: Path) -> None:
    """Every result's value is a record, and so is what else its videos have in common."""
    one = Score(value=0.5, others={"mAcc": 0.6})
    two = Score(value=0.7, others={"mAcc": 0.8, "IoU train": Undefined("absent")})
    result = Result(
        metric="seg", unit="1", better="higher", convention="paper", settings={}, scores={"a": one, "b": two}, seconds=1
    )
    content = {**to_json([result], {}, {}), "method": "w/ ours", "set": "ACDC"}
    write_json(tmp_path / "seg.json", content)
    records = read_results([tmp_path / "seg.json"])
    assert cell(records, "tab:downstream", "w/ ours", "ACDC mIoU").this_run == pytest.approx(0.6)
    assert cell(records, "tab:downstream", "w/ ours", "ACDC mAcc").this_run == pytest.approx(0.7)
    assert cell(records, "tab:downstream", "w/ ours", "Dark Zurich mAcc").this_run is None
    assert {record["figure"]: record["value"] for record in records}["IoU train"] is None


def test_what_all_videos_have_as_one_is_not_averaged(tmp_path: Path) -> None:
    """mAcc of one confusion of all videos, not the mean of theirs."""
    one, two = Score(value=0.5, others={"mAcc": 0.6}), Score(value=0.7, others={"mAcc": 0.8})
    result = Result(
        metric="seg",
        unit="1",
        better="higher",
        convention="paper",
        settings={},
        scores={"a": one, "b": two},
        whole=Score(value=0.55, others={"mAcc": 0.65}),
        seconds=1,
    )
    write_json(tmp_path / "seg.json", {**to_json([result], {}), "method": "w/ ours", "set": "ACDC"})
    records = read_results([tmp_path / "seg.json"])
    assert cell(records, "tab:downstream", "w/ ours", "ACDC mIoU").this_run == 0.55
    assert cell(records, "tab:downstream", "w/ ours", "ACDC mAcc").this_run == 0.65


CHOICES = {
    "metric": "2afc",
    "convention": "win rate",
    "mean": False,
    "value": None,
    "reason": "no mean over methods",
    "videos": {
        "Ditto": {"value": 0.25, "others": {"wins": 10}},
        "Ours": {"value": 0.75, "others": {"wins": 30}},
        "Nobody": {"value": None, "reason": "never shown", "others": {"wins": 0}},
    },
}


def test_every_method_of_forced_choices_has_its_own_row(tmp_path: Path) -> None:
    records = read_results([written(tmp_path / "study.json", CHOICES, method="Cosmos-Transfer2.5")])
    human = {
        row: cell(records, "tab:eval_general_uniform", row, "human").this_run
        for row in PAPER.tables["tab:eval_general_uniform"].rows
    }
    assert human == {"Video-P2P": None, "Ditto": 0.25, "Cosmos-Transfer2.5": None, "WAN-FUN 2.2": None, "Ours": 0.75}
    assert {r["method"]: r["value"] for r in records if r["figure"] == "wins"} == {"Ditto": 10, "Ours": 30, "Nobody": 0}
    assert [(r["value"], r["reason"]) for r in records if r["figure"] == "value" and r["method"] == "Nobody"] == [
        (None, "never shown")
    ]


def test_what_eval_writes_of_forced_choices_is_read(tmp_path: Path) -> None:
    scores = {"Ditto": Score(value=0.25), "Ours": Score(value=0.75)}
    result = Result(
        metric="2afc",
        unit="1",
        better="higher",
        convention="win rate",
        settings={},
        scores=scores,
        seconds=1,
        averaged=False,
    )
    write_json(tmp_path / "study.json", to_json([result], {}))
    records = read_results([tmp_path / "study.json"])
    assert [(r["method"], r["value"]) for r in records] == [("Ditto", 0.25), ("Ours", 0.75)]


def test_labels_that_are_in_no_table_are_told_by_name(tmp_path: Path) -> None:
    study = written(tmp_path / "study.json", CHOICES)
    seg = {"metric": "seg", "convention": "paper", "value": 0.5}
    night = written(tmp_path / "night.json", seg, method="w/ ours", set="Dark Zürich", stage="dusk", strength="0.5")
    used = written(tmp_path / "used.json", seg, method="w/ cosmos", set="Dark Zurich", stage="fog", strength="0.4")
    lines = [
        f"{study}: method 'Nobody' is in no table",
        f"{night}: set 'Dark Zürich' is in no table",
        f"{night}: stage 'dusk' is in no table",
        f"{night}: strength '0.5' is in no table",
    ]
    assert tables(read_results([study, night, used])).not_used == tuple(lines)
    shown, machine = io.StringIO(), io.StringIO()
    reproduce_tables([study, night, used], Console(file=shown, width=600), as_json=False)
    reproduce_tables([study, night, used], Console(file=machine, width=600), as_json=True)
    assert all(f"not used: {line}" in shown.getvalue() for line in lines)
    assert json.loads(machine.getvalue())["not_used"] == lines


def test_a_method_of_the_table_without_measurements_is_in_no_table() -> None:
    assert tables([record("clip", 0.25, method="RainyGS")]).not_used == ("r: method 'RainyGS' is in no table",)


def test_labels_come_from_the_file_or_the_settings(tmp_path: Path) -> None:
    result = {"metric": "2afc", "convention": "paper", "value": 0.5}
    by_file = written(tmp_path / "a.json", result, method="Ditto")
    by_settings = written(tmp_path / "b.json", {**result, "settings": {"method": "WAN-FUN 2.2"}})
    records = read_results([by_file, by_settings])
    assert [record["method"] for record in records] == ["Ditto", "WAN-FUN 2.2"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "expected the JSON"),
        ("[]", "no list of results"),
        ('{"skipped": {}}', "no list of results"),
        ('{"results": [{"metric": "fvd", "convention": "paper", "value": NaN}]}', "NaN"),
        ('{"results": [{"metric": "fvd", "value": 1}]}', "metric, convention, value"),
        ('{"results": [3]}', "metric, convention, value"),
        (
            '{"results": [{"metric": "fvd", "convention": "paper", "value": "1"}]}',
            "value of fvd: expected a number or null, got '1'",
        ),
    ],
)
def test_a_broken_file_is_named(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "broken.json"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=rf"broken\.json.*{message}"):
        read_results([file])


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.json"):
        read_results([tmp_path / "none.json"])


def test_json_is_strict_and_whole() -> None:
    out = io.StringIO()
    reproduce_tables([], Console(file=out, width=80), as_json=True)
    read = json.loads(out.getvalue(), parse_constant=lambda name: pytest.fail(name))
    assert [table["label"] for table in read["tables"]] == list(PAPER.tables)
    assert [figure["name"] for figure in read["figures"]] == list(PAPER.figures)
    assert {c["verdict"] for c in read["checks"]} <= set(Verdict)
    general = next(table for table in read["tables"] if table["label"] == "tab:eval_general_uniform")
    assert general["rows"]["Cosmos-Transfer2.5"][3] == {
        "paper": 0.58,
        "printed": "0.580",
        "this_run": None,
        "note": "missing: the raters' answers",
    }


def test_people_see_every_table_and_every_line(tmp_path: Path) -> None:
    file = written(tmp_path / "edge.json", record("edge-f1", 0.25))
    out = io.StringIO()
    reproduce_tables([file], Console(file=out, width=600), as_json=False)
    shown = out.getvalue()
    assert all(f"({label})" in shown for label in PAPER.tables)
    assert all(c.what in shown for c in CHECKS.values())
    assert "0.129 / 0.25" in shown
    assert "this run, convention: paper (1 edge F1)" in shown
    assert "missing: the edited Waymo videos, I3D weights (5 FVD)" in shown
