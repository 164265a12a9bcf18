"""Every figure of the paper beside this run's, or what it would take to have one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal

from aw4d.reproduce import counts, formulas, statements, user_study
from aw4d.reproduce.check import Check
from aw4d.reproduce.paper import NOT_PRINTED, OURS, Column, Figure, Paper, Printed, Table, paper
from aw4d.reproduce.results import Record, measured, not_used


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One figure.

    Parameters
    ----------
    paper
        As a number, truth value or text; None where the paper prints none.
    printed
        In the paper's digits or words.
    this_run
        The same measured here, or None.
    note
        This run's convention, or why there is no number: what is missing. Empty where nothing is measured.
    """

    paper: bool | int | float | str | None
    printed: str
    this_run: float | None
    note: str


@dataclass(frozen=True, kw_only=True)
class FilledTable:
    """A table of the paper: `rows` has a cell a column."""

    label: str
    name: str
    about: str
    columns: tuple[str, ...]
    units: tuple[str, ...]
    better: tuple[str, ...]
    rows: dict[str, tuple[Cell, ...]]


@dataclass(frozen=True, kw_only=True)
class FilledFigure:
    """A number or statement of the paper's text."""

    name: str
    section: str
    about: str
    unit: str
    cell: Cell


@dataclass(frozen=True, kw_only=True)
class Report:
    """All tables, all numbers of the text, the paper's own arithmetic, and which results belong to none of them."""

    tables: tuple[FilledTable, ...]
    figures: tuple[FilledFigure, ...]
    checks: tuple[Check, ...]
    not_used: tuple[str, ...]


def tables(results: Sequence[Record] = ()) -> Report:
    """Every table and number of the paper: what it prints, what this run has, what is missing.

    Parameters
    ----------
    results
        Records of `aw4d eval --json`: `aw4d.reproduce.read_results`.

    Raises
    ------
    InputError
        Results of one figure in several conventions.
    """
    printed = paper()
    return Report(
        tables=tuple(_table(table, results) for table in printed.tables.values()),
        figures=tuple(_figure(figure, results) for figure in printed.figures.values()),
        checks=tuple(contradictions(printed)),
        not_used=tuple(not_used(results, printed)),
    )


def contradictions(printed: Paper) -> list[Check]:
    """The paper's own numbers and formulas held against what it prints."""
    return [check for part in (user_study, counts, statements, formulas) for check in part.checks(printed)]


def _table(table: Table, results: Sequence[Record]) -> FilledTable:
    return FilledTable(
        label=table.label,
        name=table.name,
        about=table.about,
        columns=tuple(column.name for column in table.columns),
        units=tuple(column.unit for column in table.columns),
        better=tuple(column.better for column in table.columns),
        rows={row: _row(table, row, results) for row in table.rows},
    )


def _row(table: Table, row: str, results: Sequence[Record]) -> tuple[Cell, ...]:
    pairs = zip(table.columns, table.rows[row], strict=True)
    return tuple(_cell(value, _this_run(table, column, row, results)) for column, value in pairs)


def _this_run(table: Table, column: Column, row: str, results: Sequence[Record]) -> tuple[float | None, str]:
    """This run's figure, and its note."""
    if not column.of:
        return _measured(results, column.match, row, column.needs)
    first, of = next(iter(table.rows)), next(other for other in table.columns if other.name == column.of)
    if row == first:
        return None, ""
    (value, note), (base, base_note) = (_this_run(table, of, name, results) for name in (row, first))
    if value is None or base is None:
        return None, note if value is None else base_note
    return counts.increase(value, base), note


def _figure(figure: Figure, results: Sequence[Record]) -> FilledFigure:
    this_run = _measured(results, figure.match, OURS, figure.needs)
    return FilledFigure(
        name=figure.name,
        section=figure.section,
        about=figure.about,
        unit=figure.unit,
        cell=_cell(figure.value, this_run, words=figure.printed),
    )


def _measured(results: Sequence[Record], match: Mapping[str, str], row: str, needs: str) -> tuple[float | None, str]:
    value, note = measured(results, match, row)
    return value, note or (f"missing: {needs}" if needs else "")


def _cell(value: Printed, this_run: tuple[float | None, str], words: str = "") -> Cell:
    known = None if value == NOT_PRINTED else float(value) if isinstance(value, Decimal) else value
    shown = ("yes" if value else "no") if isinstance(value, bool) else str(value)
    return Cell(paper=known, printed=words or shown, this_run=this_run[0], note=this_run[1])
