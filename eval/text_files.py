"""Text files of other tools: JSON and CSV, read strictly; what cannot be used is named with its file and place."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from eval.errors import MetricError


def read_text(path: Path) -> str:
    """Text of a UTF-8 file.

    Raises
    ------
    MetricError
        It cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise MetricError(f"{path}: expected a text file that can be read ({error})") from error


def read_json(path: Path) -> Any:
    """What a JSON file holds.

    Raises
    ------
    MetricError
        It cannot be read, or is not strict JSON: NaN and Infinity are none.
    """

    def refuse(constant: str) -> NoReturn:
        raise MetricError(f"{path}: expected strict JSON, got {constant}")

    try:
        return json.loads(read_text(path), parse_constant=refuse)
    except (json.JSONDecodeError, RecursionError) as error:
        raise MetricError(f"{path}: expected JSON ({error})") from error


def read_table(path: Path, *, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, dict[str, str]]:
    """Lines of a CSV file by place ("line 2"), as dictionaries of the named columns; other columns are left out.

    Columns are found by the names in the first line, never by their place. Optional columns that the file has not are
    absent from the dictionaries.

    Raises
    ------
    MetricError
        The file cannot be read, has no line, lacks a required column, names a column twice, or a line has too few or
        too many fields.
    """
    reader = csv.reader(io.StringIO(read_text(path), newline=""))
    names = [name.strip() for name in next(reader, [])]
    wanted = [*required, *(name for name in optional if name in names)]
    if any(names.count(name) != 1 for name in wanted):
        raise MetricError(f"{path}: expected the columns {', '.join(required)}, each once, in line 1, got {names}")
    lines = {}
    for fields in reader:
        if not fields:
            continue
        if len(fields) != len(names):
            raise MetricError(f"{path}: line {reader.line_num}: expected {len(names)} fields, got {len(fields)}")
        line = dict(zip(names, fields, strict=True))
        lines[f"line {reader.line_num}"] = {name: line[name].strip() for name in wanted}
    if not lines:
        raise MetricError(f"{path}: expected lines below the names of the columns, got none")
    return lines


@contextmanager
def entry(path: Path, place: str, expected: str) -> Iterator[None]:
    """Errors in the block become a MetricError that names the file, the place in it and what was expected there."""
    try:
        yield
    except MetricError as error:
        raise MetricError(f"{path}: {place}: {error}") from error
    except KeyError as error:
        raise MetricError(f"{path}: {place}: expected {expected}, got none of the name {error}") from error
    except (TypeError, ValueError, IndexError, AttributeError) as error:
        raise MetricError(f"{path}: {place}: expected {expected} ({error})") from error
