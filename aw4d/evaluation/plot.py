"""Curves by frame and distributions of an evaluation, as one picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aw4d.errors import InputError
from aw4d.evaluation.result import Result, plain
from aw4d.io.files import replacing
from eval.score import Score

SUFFIXES = (".png", ".svg", ".pdf")


def check_plot(path: Path) -> None:
    """Refuse a file that no plot can be written to.

    Raises
    ------
    InputError
        The suffix is none of a plot's.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"--plot: expected a file ending in {', '.join(SUFFIXES)}, got {path}")


def write_plot(path: Path, results: Sequence[Result]) -> None:
    """Draw a row a metric: its value by frame, a curve a video, and how its values are distributed.

    Metrics without parts have a bar a video instead.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    check_plot(path)
    figure, rows = plt.subplots(len(results), 2, figsize=(11, 2.4 * len(results)), squeeze=False, layout="constrained")
    for (curve, spread), result in zip(rows, results, strict=True):
        _draw(curve, spread, result)
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.lower().lstrip("."), dpi=120)
    plt.close(figure)


def _draw(curve: Any, spread: Any, result: Result) -> None:
    better = "" if result.better == "neither" else f", {result.better} is better"
    curve.set_title(f"{result.metric} ({result.convention}){better}", loc="left", fontsize=9)
    parts = {name: _numbers(score) for name, score in result.scores.items()}
    if any(len(numbers) > 1 for numbers in parts.values()):
        for name, numbers in parts.items():
            curve.plot(numbers, linewidth=1, label=name)
        curve.set_xlabel("frame", fontsize=8)
        known = [number for numbers in parts.values() for number in numbers if not math.isnan(number)]
    else:
        known = [number for number in (plain(score.value) for score in result.scores.values()) if number is not None]
        curve.barh([name for name, score in result.scores.items() if plain(score.value) is not None], known)
    curve.tick_params(labelsize=7)
    if len(curve.lines) > 1 and len(parts) <= 8:
        curve.legend(fontsize=7)
    if known:
        spread.hist(known, bins=min(40, max(5, int(np.sqrt(len(known)) * 2))))
    spread.set_xlabel(f"{result.metric} [{result.unit}]", fontsize=8)
    spread.tick_params(labelsize=7)


def _numbers(score: Score) -> list[float]:
    """Values by frame; NaN, which a curve leaves out, where there is none."""
    return [math.nan if (number := plain(value)) is None else number for value in score.frames]
