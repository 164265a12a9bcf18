"""The report for people and for machines."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table as Grid

from aw4d.reproduce.check import Check, Quantity, Verdict
from aw4d.reproduce.report import Cell, FilledFigure, FilledTable, Report, tables
from aw4d.reproduce.results import read_results

ARROWS = {"up": " ↑", "down": " ↓", "": ""}
COLOURS = {  # in the order in which they are shown
    Verdict.CONTRADICTS: "red",
    Verdict.UNPHYSICAL: "red",
    Verdict.UNEXPLAINED: "yellow",
    Verdict.NOT_PRINTED: "dim",
    Verdict.AGREES: "green",
}


def reproduce_tables(files: Sequence[Path], console: Console, *, as_json: bool) -> None:
    """Print the paper's tables beside the results in these files, and the paper's own arithmetic.

    Raises
    ------
    InputError
        A file that cannot be used: see `read_results` and `tables`.
    """
    report = tables(read_results(files))
    if as_json:
        console.out(to_json(report), highlight=False)
    else:
        show(report, console)


def to_json(report: Report) -> str:
    """The report as strict JSON."""
    return json.dumps(dataclasses.asdict(report), indent=2, allow_nan=False, ensure_ascii=False)


def show(report: Report, console: Console) -> None:
    """Print the report for people."""
    for table in report.tables:
        _show_table(table, console)
    _show_figures(report.figures, console)
    _show_checks(report.checks, console)
    for line in report.not_used:
        console.print(f"[yellow]not used:[/] {escape(line)}", highlight=False)


def _show_table(table: FilledTable, console: Console) -> None:
    measured = any(cell.note for cells in table.rows.values() for cell in cells)
    console.print(f"[bold]{escape(table.name)}[/] ({table.label}): {escape(table.about)}", highlight=False)
    console.print(_grid("paper / this run" if measured else "paper", table))
    for line in _notes(table):
        console.print(escape(line), highlight=False)
    console.print()


def _grid(corner: str, table: FilledTable) -> Grid:
    """The figures, the longer side of the table downwards."""
    parts = zip(table.columns, table.units, table.better, strict=True)
    columns = [(f"{name} [{unit}]" if unit else name) + ARROWS[better] for name, unit, better in parts]
    rows, cells = list(table.rows), [[_side_by_side(cell) for cell in cells] for cells in table.rows.values()]
    if len(columns) > len(rows):
        rows, columns, cells = columns, rows, [list(column) for column in zip(*cells, strict=True)]
    grid = Grid()
    grid.add_column(corner, no_wrap=True)
    for column in columns:
        grid.add_column(escape(column), overflow="fold")
    for row, shown in zip(rows, cells, strict=True):
        grid.add_row(escape(row), *map(escape, shown))
    return grid


def _side_by_side(cell: Cell) -> str:
    """`0.915 / 0.88`; the paper's alone where nothing is measured, `0.915 / –` where nothing was."""
    if not cell.note:
        return cell.printed
    return f"{cell.printed} / {'–' if cell.this_run is None else _shown(cell.this_run)}"


def _notes(table: FilledTable) -> Iterable[str]:
    """What is run, in which convention, and what is not run and why: columns, and how many of their cells."""
    columns: dict[str, Counter[str]] = {}
    for cells in table.rows.values():
        for name, cell in zip(table.columns, cells, strict=True):
            if cell.note:
                line = "not run, " if cell.this_run is None else "this run, convention: "
                columns.setdefault(line + cell.note, Counter())[name] += 1
    for note, names in columns.items():
        yield f"{note} ({'; '.join(f'{count} {name}' for name, count in names.items())})"


def _show_figures(figures: Sequence[FilledFigure], console: Console) -> None:
    console.print("[bold]Numbers in the text[/]")
    grid = Grid(expand=True)
    for column in ("what", "where", "paper", "this run"):
        grid.add_column(column, overflow="fold")
    for figure in figures:
        cell = figure.cell
        run = _shown(cell.this_run) if cell.this_run is not None else cell.note or "not a result"
        grid.add_row(*map(escape, (f"{figure.name}: {figure.about}", figure.section, _with_unit(figure), run)))
    console.print(grid)
    console.print()


def _with_unit(figure: FilledFigure) -> str:
    bare = isinstance(figure.cell.paper, bool) or not figure.cell.printed[0].isdigit()
    return figure.cell.printed if bare else f"{figure.cell.printed} {figure.unit}".rstrip()


def _show_checks(checks: Sequence[Check], console: Console) -> None:
    """What is wrong first; under each line where it stands and the arithmetic."""
    console.print("[bold]The paper's own arithmetic[/]")
    grid = Grid(expand=True)
    for column, ratio in (("what", 4), ("the paper", 2), ("its numbers give", 5), ("verdict", 2)):
        grid.add_column(column, overflow="fold", ratio=ratio)
    order = list(COLOURS)
    for c in sorted(checks, key=lambda check: order.index(check.verdict)):
        what, where, printed, gives, how = map(escape, (c.what, c.where, _shown(c.printed), _shown(c.gives), c.how))
        verdict = f"[{COLOURS[c.verdict]}]{c.verdict}[/]"
        grid.add_row(f"{what}\n[dim]{where}[/]", printed, f"{gives}\n[dim]{how}[/]", verdict)
    console.print(grid)
    counted = Counter(check.verdict for check in checks)
    console.print(", ".join(f"{counted[verdict]} {verdict}" for verdict in order), highlight=False)


def _shown(value: Quantity) -> str:
    """A quantity in five digits."""
    if value is None:
        return "–"
    if isinstance(value, tuple):
        return " and ".join(map(_shown, value))
    return f"{value:.5g}" if isinstance(value, float) else str(value)
