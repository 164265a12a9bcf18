"""The results of an evaluation: a table for people, files for programs; and what is known exactly, computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from aw4d.errors import InputError
from aw4d.evaluation.plot import check_plot, write_plot
from aw4d.evaluation.result import Result, reason, to_json, write_csv, write_json
from eval.self_test import CASES, I3D_EXPECTED, I3D_WHAT, i3d_case
from eval.values import Undefined, Value

ARROWS = {"higher": "↑", "lower": "↓", "neither": ""}


def labels_of(texts: Sequence[str]) -> dict[str, str]:
    """KEY=VALUE texts as a mapping.

    Raises
    ------
    InputError
        A text is no such.
    """
    found = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (key and equals):
            raise InputError(f"--label: expected KEY=VALUE, got {text!r}")
        found[key] = value
    return found


def report(
    results: Sequence[Result],
    skipped: Mapping[str, str],
    labels: Mapping[str, str],
    console: Console,
    *,
    json_file: Path | None = None,
    csv_file: Path | None = None,
    plot: Path | None = None,
) -> None:
    """Print the results, and write those files that are asked for."""
    show(results, skipped, console)
    if json_file is not None:
        write_json(json_file, to_json(results, skipped, labels))
    if csv_file is not None:
        write_csv(csv_file, results)
    if plot is not None:
        check_plot(plot)
        write_plot(plot, results)


def show_self_test(console: Console, i3d_weights: Path | None = None) -> bool:
    """Print every value that is known exactly beside what is computed; whether all agree.

    One of them takes I3D's own weights; without a file of them it is not run, and says so.
    """
    table = Table()
    for column in ("metric", "case", "expected", "found", "agrees"):
        table.add_column(column, overflow="fold")
    cases = CASES if i3d_weights is None else (*CASES, i3d_case(i3d_weights))
    agree = True
    for case in cases:
        found = case.found()
        agrees = case.agrees(found)
        agree &= agrees
        table.add_row(case.metric, case.what, case.expected_text, number(found), "yes" if agrees else "[red]no[/]")
    if i3d_weights is None:
        table.add_row("fvd", I3D_WHAT, f"{I3D_EXPECTED:g}", "not run: needs --i3d-weights", "")
    console.print(table)
    return agree


def number(value: Value) -> str:
    """A value in four digits, or why there is none."""
    return f"undefined: {value.reason}" if isinstance(value, Undefined) else f"{value:.4g}"


def show(results: Sequence[Result], skipped: Mapping[str, str], console: Console) -> None:
    """Print a row a metric (and one a video, if there are several), what belongs with it, and what was skipped."""
    if results:
        console.print(_table(results))
    for result in results:
        for name, score in result.scores.items():
            told = [f"{other} {number(value)}" for other, value in score.others.items()]
            if told:
                console.print(f"{result.metric}, {name}: {'; '.join(told)}", style="dim", markup=False, soft_wrap=True)
    for name, lacks in skipped.items():
        console.print(f"{name} skipped: {lacks}", style="yellow", markup=False, soft_wrap=True)


def _table(results: Sequence[Result]) -> Table:
    table = Table()
    for column in ("metric", "convention", "video", "value", "95 %", "frames", "undefined"):
        table.add_column(column, overflow="fold")
    for result in results:
        several = len(result.scores) > 1
        for name, score in result.scores.items():
            row = name, _with_unit(score.value, result), _ends(score.interval), *_counts(score.frames)
            table.add_row(*(("", "") if several else _head(result)), *row)
        if several:
            frames = [value for score in result.scores.values() for value in score.frames]
            mean = f"mean of {len(result.scores)}", _with_unit(result.value, result), _ends(result.interval)
            table.add_row(*_head(result), *mean, *_counts(frames))
    return table


def _head(result: Result) -> tuple[str, str]:
    """Name, with an arrow to the better side, and convention."""
    return f"{result.metric} {ARROWS[result.better]}".strip(), result.convention


def _counts(frames: Sequence[Value]) -> tuple[str, str]:
    return str(len(frames) or ""), str(sum(reason(value) is not None for value in frames) or "")


def _with_unit(value: Value, result: Result) -> str:
    unit = "" if result.unit == "1" or isinstance(value, Undefined) else f" {result.unit}"
    return number(value) + unit


def _ends(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"{ends[0]:.4g} to {ends[1]:.4g}"
