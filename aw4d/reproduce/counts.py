"""Counts, percentages and ranks of the paper, held against its own tables."""

from __future__ import annotations

import math
from decimal import Decimal

from aw4d.reproduce.check import Check, Verdict, compared, follows, same
from aw4d.reproduce.paper import OURS, Column, Paper, Table

GENERAL = "tab:eval_general_uniform"
DOWNSTREAM = "tab:downstream"
PERCEPTUAL = "tab:perceptual_metrics"
STRENGTH = "VidRefiner Ablation Study."
FVD_FEATURES = 400  # logits of I3D
PEAK = 255  # 8-bit codes


def checks(paper: Paper) -> list[Check]:
    """Every line about counts, percentages and ranks."""
    return [
        *_frames(paper),
        *_seconds(paper),
        *_increases(paper.tables[DOWNSTREAM]),
        *_ranks(paper),
        *_fvd(paper),
        _dover(paper),
        *_strength(paper),
    ]


def increase(value: Decimal | float, base: Decimal | float) -> float:
    """By how many per cent a value lies above another.

    >>> round(increase(49.66, 49.20), 3)
    0.935
    """
    return 100 * (float(value) / float(base) - 1)


def rank(table: Table, column: Column, row: str) -> int:
    """Place of a row in a column, 1 the best."""
    values = table.numbers(column.name)
    sign = 1 if column.better == "down" else -1
    return 1 + sum(sign * value < sign * values[row] for value in values.values())


def _frames(paper: Paper) -> list[Check]:
    scenes, weathers, length = (paper.count(name) for name in ("scenes", "weathers", "frames a video"))
    videos, augmented = paper.count("videos"), paper.count("augmented frames")
    made = f"{scenes} scenes x {weathers} weathers"
    return [
        compared("edited videos", "tab:depth_alignment", printed=videos, gives=scenes * weathers, how=made),
        compared(
            "frames evaluated",
            GENERAL,
            printed=paper.count("frames evaluated"),
            gives=scenes * weathers * length,
            how=f"{made} x {length} frames",
        ),
        Check(
            what="frames of each edited video in the augmentation",
            where="Applications",
            printed=f"{augmented} in all",
            gives=augmented / videos,
            verdict=Verdict.UNEXPLAINED if augmented % videos else Verdict.AGREES,
            how=f"{augmented} / {videos} videos; whole videos of {length} frames: {augmented / length:.1f}",
        ),
    ]


def _seconds(paper: Paper) -> list[Check]:
    table, scenes = paper.tables["tab:Running_time"], paper.count("scenes")
    seconds = {column.name: float(table.numbers(column.name)[OURS]) for column in table.columns}
    whole = math.fsum(seconds.values())
    with_mask = seconds["rain"] + seconds["annotation"]
    return [
        follows(
            "seconds, one video in all weathers",
            table.label,
            gives=whole,
            how="sum of the row; without making the G-buffer and without VidRefiner",
        ),
        follows(
            "seconds, mean of the weathers",
            table.label,
            gives=(whole - seconds["annotation"]) / (len(seconds) - 1),
            how="without annotation",
        ),
        follows(
            "seconds, rain and the annotation that gives its road",
            table.label,
            gives=with_mask,
            how=f"the printed {seconds['rain']} s are {100 * seconds['rain'] / with_mask:.1f} % of it",
        ),
        follows(
            "hours on one V100, all videos",
            table.label,
            gives=whole * scenes / 3600,
            how=f"{scenes} scenes in all weathers",
        ),
    ]


def _increases(table: Table) -> list[Check]:
    base = next(iter(table.rows))
    values = {column.name: table.numbers(column.name) for column in table.columns}
    return [
        compared(
            f"{column.of}, {row}: increase [%]",
            table.label,
            printed=printed,
            gives=increase(values[column.of][row], values[column.of][base]),
            how=f"{values[column.of][row]} / {values[column.of][base]} - 1; in points "
            f"{values[column.of][row] - values[column.of][base]}",
        )
        for column in table.columns
        if column.of
        for row, printed in values[column.name].items()
    ]


def _ranks(paper: Paper) -> list[Check]:
    """Of every measured column with several methods."""
    tables = [table for table in paper.tables.values() if len(table.rows) > 1]
    return [_rank(table, column) for table in tables for column in table.columns if column.match]


def _rank(table: Table, column: Column) -> Check:
    values = table.numbers(column.name)
    ours = list(values)[-1]
    place = rank(table, column, ours)
    best = (min if column.better == "down" else max)(set(values) - {ours}, key=lambda row: values[row])
    return Check(
        what=f"place of ours in {column.name}",
        where=table.label,
        printed="best" if column.best else None,
        gives=f"{place} of {len(values)}",
        verdict=same(place == 1) if column.best else Verdict.NOT_PRINTED,
        how=f"{values[ours]} against {values[best]} of {best}: {increase(values[ours], values[best]):+.2f} %",
    )


def _fvd(paper: Paper) -> list[Check]:
    sets, members = paper.count("sets of FVD"), paper.count("videos of an FVD set")
    return [
        Check(
            what="distances that FVD is the average of",
            where=PERCEPTUAL,
            printed=f"{paper.count('videos')} videos",
            gives=sets,
            verdict=Verdict.UNEXPLAINED,
            how=f"the caption averages over videos; the text takes one distance a set of {members} videos",
        ),
        follows(
            "rank of FVD's covariance, at most",
            PERCEPTUAL,
            gives=min(members - 1, FVD_FEATURES),
            how=f"{members} videos of {FVD_FEATURES} features: two halves of one set are far from each other",
        ),
    ]


def _dover(paper: Paper) -> Check:
    weights = [paper.number(f"weight of DOVER's {side} score") for side in ("aesthetic", "technical")]
    where = "Extended Quantitative Evaluations"
    return follows("sum of DOVER's weights", where, gives=float(sum(weights)), how=" + ".join(map(str, weights)))


def _strength(paper: Paper) -> list[Check]:
    adopted, highest = (float(paper.number(f"PSNR at strength {strength}")) for strength in (0.4, 0.6))
    more = increase(10 ** ((highest - adopted) / 10), 1)
    return [
        Check(
            what="PSNR of the strength that the full pipeline uses [dB]",
            where=STRENGTH,
            printed=adopted,
            gives="infinite",
            verdict=Verdict.CONTRADICTS,
            how="ablations are said to be compared with the full pipeline's output; no other reference is named",
        ),
        follows(
            "RMSE of the two strengths [8-bit codes]",
            STRENGTH,
            gives=tuple(PEAK * 10 ** (-decibel / 20) for decibel in (highest, adopted)),
            how=f"{PEAK} x 10^(-PSNR / 20); {highest - adopted:.2f} dB are {more:.0f} % of MSE",
        ),
    ]
