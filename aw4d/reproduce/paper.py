"""The paper's tables and the numbers in its text, as printed: `aw4d/data/paper_tables.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cache
from importlib.resources import files

NOT_PRINTED = "-"
OURS = "Ours"

Printed = bool | int | Decimal | str  # a Decimal keeps the digits that were printed: 0.580


def digits_place(value: Decimal) -> int:
    """Power of ten of the last digit that is printed: -3 of 0.580."""
    exponent = value.as_tuple().exponent
    assert isinstance(exponent, int), f"{value} is no number"
    return exponent


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a table.

    Parameters
    ----------
    name, unit
        As shown.
    better
        "up" or "down"; empty where nothing is measured.
    best
        Whether the paper marks its own row as the best.
    match
        Keys of a result that belongs here, besides its method.
    needs
        What measuring it takes.
    of
        Name of the column whose increase over the table's first row this is [%].
    """

    name: str
    unit: str = ""
    better: str = ""
    best: bool = False
    match: Mapping[str, str] = field(default_factory=dict)
    needs: str = ""
    of: str = ""


@dataclass(frozen=True, kw_only=True)
class Table:
    """One table: its label in the paper's source, and a figure a column in each row."""

    label: str
    name: str
    about: str
    columns: tuple[Column, ...]
    rows: Mapping[str, tuple[Printed, ...]]

    def column(self, name: str) -> dict[str, Printed]:
        """The figures of one column by row, without those that are not printed."""
        index = [column.name for column in self.columns].index(name)
        return {row: cells[index] for row, cells in self.rows.items() if cells[index] != NOT_PRINTED}

    def numbers(self, name: str) -> dict[str, Decimal]:
        """The same of a column of numbers, all with the digits of the one that has most: a 0 among them is 0.000."""
        values = {row: Decimal(value) for row, value in self.column(name).items()}
        finest = min(values.values(), key=digits_place)
        return {row: value.quantize(finest) for row, value in values.items()}


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A number or a statement of the text.

    Parameters
    ----------
    section
        Heading under which it stands, or the label of the table in whose caption.
    printed
        The paper's words where it is no plain number.
    match, needs
        As of a column. Without `needs` it is a setting, which nothing measures.
    """

    name: str
    section: str
    about: str
    value: bool | int | Decimal
    unit: str = ""
    printed: str = ""
    match: Mapping[str, str] = field(default_factory=dict)
    needs: str = ""


@dataclass(frozen=True)
class Paper:
    """All that is typed in: tables by label, figures by name, tokens by prompt."""

    tables: Mapping[str, Table]
    figures: Mapping[str, Figure]
    prompt_tokens: Mapping[str, int]

    def count(self, name: str) -> int:
        """A whole number of the text."""
        return int(self.figures[name].value)

    def number(self, name: str) -> Decimal:
        """A number of the text, with the digits that are printed."""
        return Decimal(self.figures[name].value)


@cache
def paper() -> Paper:
    """What the paper prints."""
    text = (files("aw4d") / "data" / "paper_tables.toml").read_text(encoding="utf-8")
    raw = tomllib.loads(text, parse_float=Decimal)
    tables = [
        Table(
            label=t["label"],
            name=t["name"],
            about=t["about"],
            columns=tuple(Column(**column) for column in t["columns"]),
            rows={row: tuple(cells) for row, cells in t["rows"].items()},
        )
        for t in raw["table"]
    ]
    figures = [Figure(**figure) for figure in raw["figure"]]
    return Paper({t.label: t for t in tables}, {f.name: f for f in figures}, raw["prompt_tokens"])
