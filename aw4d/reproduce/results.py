"""What this run measured: the results of `aw4d eval --json`, and those that belong to a figure of the paper."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from aw4d.errors import InputError
from aw4d.reproduce.paper import OURS, Paper

# metric, convention, figure, value (None: undefined, with a reason), method, other labels, file
Record = Mapping[str, Any]

KEYS = ("metric", "convention", "value")
UNNAMED = {"figure": "value", "method": OURS}
LABELS = ("method", "set", "stage", "strength")  # that tell figures of one metric apart


def read_results(paths: Iterable[Path]) -> list[Record]:
    """One record a number: of each result its `value`, and what else it has, of all its videos or their mean.

    What a file or a result's settings say besides (`method`, `set`, `stage`, `strength`) labels their numbers. A result
    that has no mean, as answers in forced choices, has a score a method, in place of videos: each is that method's.

    Raises
    ------
    InputError
        A file that cannot be read or is no strict JSON; a result without metric, convention or value.
    """
    return [record for path in paths for result in _results(path) for record in _numbers(result)]


def _results(path: Path) -> list[Record]:
    """The results of one file, each with the labels of the file and of its settings."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected the JSON of `aw4d eval --json`, got {error}") from None
    if not isinstance(content, dict) or not isinstance(content.get("results"), list):
        raise InputError(f"{path}: expected the JSON of `aw4d eval --json`, got no list of results")
    for result in content["results"]:
        if not isinstance(result, dict) or not all(key in result for key in KEYS):
            raise InputError(f"{path}: expected results with {', '.join(KEYS)}, got {str(result)[:80]}")
        value = result["value"]
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise InputError(f"{path}: value of {result['metric']}: expected a number or null, got {value!r}")
    labels = {**UNNAMED, **{key: label for key, label in content.items() if isinstance(label, str)}}
    return [{**labels, **result.get("settings", {}), **result, "file": str(path)} for result in content["results"]]


def _refuse(name: str) -> float:
    raise ValueError(f"{name}, which is no JSON")


def _numbers(result: Record) -> Iterator[Record]:
    videos = result.get("videos", {})
    if result.get("mean") is False:
        for method, score in videos.items():
            yield {**result, **score, "method": method}
            yield from _figures({**result, "method": method}, [score])
        return
    yield result
    yield from _figures(result, [result] if result.get("others") else list(videos.values()))


def _figures(result: Record, scores: Sequence[Mapping[str, Any]]) -> Iterator[Record]:
    """What scores have besides their values: its mean, where every one of them has it."""
    parts = [score.get("others", {}) for score in scores]
    for name in dict.fromkeys(name for part in parts for name in part):
        values = [part.get(name) for part in parts]
        known = [float(value) for value in values if value is not None]
        mean = math.fsum(known) / len(known) if len(known) == len(values) else None
        yield {**result, "figure": name, "value": mean, "reason": f"no {name} of every video"}


def not_used(records: Sequence[Record], paper: Paper) -> list[str]:
    """Labels of records that no figure of the paper has, by file and name: their numbers are in no table."""
    known = _known(paper)
    strangers = (
        f"{record['file']}: {label} {str(record[label])!r} is in no table"
        for record in records
        for label in LABELS
        if label in record and str(record[label]) not in known[label]
    )
    return list(dict.fromkeys(strangers))


def _known(paper: Paper) -> dict[str, set[str]]:
    """The labels that figures of the paper have."""
    measured_in = [table for table in paper.tables.values() if any(column.match for column in table.columns)]
    matches = [column.match for table in measured_in for column in table.columns]
    matches += [figure.match for figure in paper.figures.values()]
    known = {label: {match[label] for match in matches if label in match} for label in LABELS}
    known["method"] |= {OURS, *(row for table in measured_in for row in table.rows)}
    return known


def measured(records: Sequence[Record], match: Mapping[str, str], method: str) -> tuple[float | None, str]:
    """The mean over the records of one figure, and of which convention it is or why it is undefined.

    Several records, as of four weathers, count alike. Without any record: None and "".

    Raises
    ------
    InputError
        Records of one figure in several conventions.
    """
    asked = {**UNNAMED, **match, "method": method}
    here = [r for r in records if match and all(str(r.get(key)) == value for key, value in asked.items())]
    conventions = sorted({str(record["convention"]) for record in here})
    if len(conventions) > 1:
        raise InputError(f"{match['metric']} of {method}: expected results of one convention, got {conventions}")
    reasons = [str(record.get("reason", "undefined")) for record in here if record["value"] is None]
    if reasons:
        return None, f"{reasons[0]}, in {len(reasons)} of {len(here)} results"
    return (math.fsum(record["value"] for record in here) / len(here), conventions[0]) if here else (None, "")
