"""The results of an evaluation: a table for people, files for programs; and what is known exactly, computed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from aw4d.errors import InputError
from aw4d.evaluation.plot import check_plot, write_plot
from aw4d.evaluation.request import Request
from aw4d.evaluation.result import Result, to_json, write_csv, write_json
from aw4d.evaluation.run import Findings
from aw4d.output import sidecar_path
from eval.self_test import CASES, I3D_EXPECTED, I3D_WHAT, i3d_case
from eval.values import Undefined, Value

ARROWS = {"higher": "↑", "lower": "↓", "neither": ""}


RESERVED = ("versions", "inputs", "results", "skipped", "failed")  # keys of the JSON


def labels_of(texts: Sequence[str]) -> dict[str, str]:
    """KEY=VALUE texts as a mapping.

    Raises
    ------
    InputError
        A text is no such, or its key is one that the JSON has already.
    """
    found = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (key and equals) or key in RESERVED:
            raise InputError(f"--label: expected KEY=VALUE with a key other than {', '.join(RESERVED)}, got {text!r}")
        found[key] = value
    return found


def check_outputs(
    request: Request, json_file: Path | None, csv_file: Path | None, plot: Path | None, *, overwrite: bool
) -> None:
    """Refuse, before anything is computed, files that cannot be or must not be written.

    Raises
    ------
    InputError
        Two are the same, one is read or belongs to what is read, one exists (unless `overwrite`), or has no folder.
    """
    if plot is not None:
        check_plot(plot)
    files = [path for path in (json_file, csv_file, plot) if path is not None]
    read = {path.resolve() for path in request.paths()}
    read |= {sidecar_path(path) for path in read}
    for path in files:
        if files.count(path) > 1:
            raise InputError(f"{path}: expected a file for each of --json, --csv and --plot, got one for two")
        if path.resolve() in read or read & set(path.resolve().parents):
            raise InputError(f"{path}: expected another file than what is read or belongs to it")
        if not path.parent.is_dir() or path.is_dir():
            raise InputError(f"{path}: cannot be written (there is no such folder, or it is one itself)")
        if path.exists() and not overwrite:
            raise InputError(f"{path}: exists already; give another path or --overwrite")


def report(
    found: Findings,
    request: Request,
    labels: Mapping[str, str],
    console: Console,
    *,
    json_file: Path | None = None,
    csv_file: Path | None = None,
    plot: Path | None = None,
) -> None:
    """Print what was found, and write those files that are asked for."""
    show(found, console)
    if json_file is not None:
        write_json(json_file, to_json(found.results, found.skipped, found.failed, request.given(), labels))
    if csv_file is not None:
        write_csv(csv_file, found.results)
    if plot is not None and found.results:
        write_plot(plot, found.results)


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


def show(found: Findings, console: Console) -> None:
    """Print a row a metric (and one a video, if there are several), what belongs with it, and what was not computed."""
    if found.results:
        console.print(_table(found.results))
    for result in found.results:
        for name, score in result.scores.items():
            told = [number(score.value)] if isinstance(score.value, Undefined) else []
            told += [f"{other} {number(value)}" for other, value in score.others.items()]
            if told:
                console.print(f"{result.metric}, {name}: {'; '.join(told)}", style="dim", markup=False, soft_wrap=True)
    for name, lacks in found.skipped.items():
        console.print(f"{name} skipped: {lacks}", style="yellow", markup=False, soft_wrap=True)
    for name, cause in found.failed.items():
        console.print(f"{name} failed: {cause}", style="red", markup=False, soft_wrap=True)


def _table(results: Sequence[Result]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for column in ("metric", "convention", "value", "95 %"):
        table.add_column(column, no_wrap=True)
    table.add_column("video", overflow="fold")
    table.add_column("frames", justify="right")
    table.add_column("undef.", justify="right")
    for result in results:
        several = len(result.scores) > 1
        for name, score in result.scores.items():
            value = _with_unit(score.value, result), _ends(score.interval)
            table.add_row(*(("", "") if several else _head(result)), *value, name, *_counts(score.frames))
        if several and result.averaged:
            frames = [value for score in result.scores.values() for value in score.frames]
            of = "all as one" if result.whole is not None else f"mean of {len(result.scores)}"
            value = _with_unit(result.value, result), _ends(result.interval)
            table.add_row(*_head(result), *value, of, *_counts(frames))
        elif several:
            table.add_row(*_head(result))
    return table


def _head(result: Result) -> tuple[str, str]:
    """Name, with an arrow to the better side, and convention."""
    return f"{result.metric} {ARROWS[result.better]}".strip(), result.convention


def _counts(frames: Sequence[Value]) -> tuple[str, str]:
    return str(len(frames) or ""), str(sum(isinstance(value, Undefined) for value in frames) or "")


def _with_unit(value: Value, result: Result) -> str:
    if isinstance(value, Undefined):  # its reason stands below the table
        return "undefined"
    return number(value) + ("" if result.unit == "1" else f" {result.unit}")


def _ends(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"{ends[0]:.4g} to {ends[1]:.4g}"
