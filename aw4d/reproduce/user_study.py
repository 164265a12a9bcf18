"""The user study's arithmetic: which design has 1,440 answers and the printed win rates."""

from __future__ import annotations

import math
from collections.abc import Mapping
from decimal import Decimal

from aw4d.reproduce.check import Check, Verdict, compared, follows, rounds_to, same
from aw4d.reproduce.paper import OURS, Paper
from eval.two_afc import WinRate, round_robin

STUDY = "User Study"
RATES = "tab:eval_general_uniform"


def checks(paper: Paper) -> list[Check]:
    """Every line about the study."""
    rates = paper.tables[RATES].numbers("human")
    return [
        _answers(paper),
        _clips(paper, len(rates)),
        _rate_of_ours(rates),
        _attainable(paper, rates),
        _design(paper, rates),
        *_intervals(all_against_all(paper, rates)),
    ]


def wins(rates: Mapping[str, Decimal], answers: int) -> dict[str, list[int]]:
    """Counts of wins in so many answers that round to each rate.

    >>> wins({"a": Decimal("0.425"), "b": Decimal("0.580")}, 240)
    {'a': [102], 'b': []}
    """
    return {name: [won for won in range(answers + 1) if rounds_to(won / answers, rate)] for name, rate in rates.items()}


def all_against_all(paper: Paper, rates: Mapping[str, Decimal]) -> dict[str, WinRate]:
    """The printed rates as those of methods that all meet equally often, in the printed number of answers.

    Raises
    ------
    MetricError
        No such round robin has these rates.
    """
    answers_a_pair = paper.count("answers") // math.comb(len(rates), 2)
    counts = wins(rates, (len(rates) - 1) * answers_a_pair)
    return round_robin({name: won for name, (won,) in counts.items()}, answers_a_pair)


def _answers(paper: Paper) -> Check:
    names = ("raters", "baselines", "pairs a baseline", "criteria")
    counts = [paper.count(name) for name in names]
    how = " x ".join(f"{count} {name}" for count, name in zip(counts, names, strict=True))
    return compared("answers", STUDY, printed=paper.count("answers"), gives=math.prod(counts), how=how)


def _clips(paper: Paper, methods: int) -> Check:
    meetings, asked = math.comb(methods, 2), paper.count("raters") * paper.count("criteria")
    return compared(
        "pairs of clips for each two methods, in a round robin",
        STUDY,
        printed=paper.count("pairs a baseline"),
        gives=paper.count("answers") / (asked * meetings),
        how=f"{paper.count('answers')} answers / ({asked} of raters and criteria x {meetings} pairs of methods)",
    )


def _rate_of_ours(rates: Mapping[str, Decimal]) -> Check:
    others = [rate for name, rate in rates.items() if name != OURS]
    return compared(
        "win rate of ours, if it met each baseline as the text has it",
        RATES,
        printed=rates[OURS],
        gives=float(1 - sum(others) / len(others)),
        how="1 - mean of the baselines' win rates: what they do not win is ours",
    )


def _attainable(paper: Paper, rates: Mapping[str, Decimal]) -> Check:
    answers = paper.count("raters") * paper.count("pairs a baseline") * paper.count("criteria")
    missing = [str(rates[name]) for name, counts in wins(rates, answers).items() if name != OURS and not counts]
    return Check(
        what="baselines' win rates as shares of their answers",
        where=RATES,
        printed=f"shares of {answers} answers",
        gives=f"no count of wins gives {' or '.join(missing)}",
        verdict=same(not missing),
        how=f"k / {answers} for every k, rounded to the digits printed",
    )


def _design(paper: Paper, rates: Mapping[str, Decimal]) -> Check:
    met = all_against_all(paper, rates).values()
    won = [rate.wins for rate in met]
    return Check(
        what="design of the study",
        where=STUDY,
        printed="ours against each baseline",
        gives=f"each against each: {', '.join(map(str, won))} of {max(r.trials for r in met)} won, {sum(won)} in all",
        verdict=Verdict.CONTRADICTS,
        how=f"the rates add to {sum(rates.values())}; those of {len(rates)} methods that all meet, to {len(rates) / 2}",
    )


def _intervals(met: Mapping[str, WinRate]) -> list[Check]:
    return [
        follows(
            f"win rate of {name}, 95 % interval",
            RATES,
            gives=rate.interval,
            how=f"Wilson, {rate.wins} of {rate.trials}; takes one rater's answers for independent",
        )
        for name, rate in met.items()
    ]
