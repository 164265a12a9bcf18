"""Two-alternative forced choice: who is preferred to whom, with Wilson intervals and binomial tests."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

from scipy.stats import binomtest, norm

from eval.errors import MetricError
from eval.score import Score
from eval.text_files import entry, read_table
from eval.values import CONFIDENCE, Undefined, Value

REQUIRED = ("left", "right", "choice")
OPTIONAL = ("rater", "item", "criterion")

UNSHOWN = Undefined("never shown")


class Response(NamedTuple):
    """One answer: two methods were shown, one was chosen."""

    left: str
    right: str
    choice: str
    rater: str = ""
    item: str = ""
    criterion: str = ""


@dataclass(frozen=True)
class WinRate:
    """How often one side won.

    Parameters
    ----------
    wins, trials
        Counts, wins at most trials.

    Raises
    ------
    MetricError
        The counts are impossible.

    >>> WinRate(3, 4).rate, WinRate(0, 0).rate
    (0.75, Undefined(reason='never shown'))
    """

    wins: int
    trials: int

    def __post_init__(self) -> None:
        if not 0 <= self.wins <= self.trials:
            raise MetricError(f"wins: expected 0 to {self.trials}, the number of trials, got {self.wins}")

    @property
    def rate(self) -> Value:
        """Wins over trials, 0 to 1."""
        return self.wins / self.trials if self.trials else UNSHOWN

    @property
    def interval(self) -> tuple[float, float] | None:
        """Wilson interval at 95 %; None without trials."""
        return wilson(self.wins, self.trials) if self.trials else None

    @property
    def p_value(self) -> Value:
        """Exact two-sided binomial test against a coin: as unlikely an outcome, or a less likely one.

        >>> WinRate(5, 5).p_value  # 2 / 2^5
        0.0625
        """
        return float(binomtest(self.wins, self.trials, 0.5).pvalue) if self.trials else UNSHOWN


def wilson(wins: int, trials: int) -> tuple[float, float]:
    """Wilson's score interval of a rate at 95 % (Wilson 1927).

    (p + z^2 / 2n -+ z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n), p = wins / trials, n = trials, z = 1.96.
    It takes answers as independent: those of one rater, or about one video, are not quite.

    >>> [round(side, 3) for side in wilson(476, 576)]
    [0.793, 0.855]
    """
    return _least_rate(wins, trials), 1 - _least_rate(trials - wins, trials)


def _least_rate(wins: int, trials: int) -> float:
    z = float(norm.ppf((1 + CONFIDENCE) / 2))
    root = z * math.sqrt(z * z + 4 * wins * (trials - wins) / trials)
    return (2 * wins + z * z - root) / (2 * (trials + z * z))


def win_rates(responses: Sequence[Response]) -> dict[str, WinRate]:
    """Each method against all others, by name in order of appearance.

    >>> win_rates([Response("a", "b", "a"), Response("c", "a", "a")])["a"]
    WinRate(wins=2, trials=2)
    """
    shown = Counter(name for response in responses for name in (response.left, response.right))
    wins = Counter(response.choice for response in responses)
    return {name: WinRate(wins[name], trials) for name, trials in shown.items()}


def pair_rates(responses: Sequence[Response]) -> dict[tuple[str, str], WinRate]:
    """The first of each two methods against the second, for every pair of methods, also one that was never shown.

    >>> pair_rates([Response("a", "b", "a"), Response("b", "a", "b")])
    {('a', 'b'): WinRate(wins=1, trials=2)}
    """
    shown = Counter(frozenset((response.left, response.right)) for response in responses)
    wins = Counter((frozenset((response.left, response.right)), response.choice) for response in responses)
    names = list(win_rates(responses))
    return {(a, b): WinRate(wins[frozenset((a, b)), a], shown[frozenset((a, b))]) for a, b in combinations(names, 2)}


def round_robin(wins: Mapping[str, int], answers_a_pair: int) -> dict[str, WinRate]:
    """Each method's rate from its wins alone, where every two methods were compared the same number of times.

    Parameters
    ----------
    wins
        Wins of each method.
    answers_a_pair
        Answers about each two methods: of five methods ten pairs, and four times this number of trials a method.

    Raises
    ------
    MetricError
        No such round robin has these wins: they do not add up to the number of answers, or some methods won less than
        they must against each other (Landau 1953).

    >>> round_robin({"a": 3, "b": 2, "c": 1}, answers_a_pair=2)["a"]
    WinRate(wins=3, trials=4)
    """
    total = math.comb(len(wins), 2) * answers_a_pair
    if sum(wins.values()) != total:
        raise MetricError(f"wins: expected a sum of {total}, {answers_a_pair} a pair, got {sum(wins.values())}")
    ranked = sorted(wins.values())
    for count in range(1, len(ranked)):
        least = math.comb(count, 2) * answers_a_pair
        if sum(ranked[:count]) < least:
            raise MetricError(f"wins: expected at least {least} for any {count} methods, got {ranked[:count]}")
    return {name: WinRate(number, (len(wins) - 1) * answers_a_pair) for name, number in wins.items()}


def two_afc(responses: Sequence[Response], method: str) -> Score:
    """Win rate of one method against all others, with its Wilson interval; `others` has its test and the rates of all.

    Raises
    ------
    MetricError
        The method was never shown.
    """
    rates = win_rates(responses)
    if method not in rates:
        raise MetricError(f"method: expected one of {', '.join(rates)}, got {method}")
    own = rates[method]
    others: dict[str, Value] = {
        "wins": float(own.wins),
        "trials": float(own.trials),
        "binomial test, p": own.p_value,
    }
    others |= {f"win rate {name}": rate.rate for name, rate in rates.items()}
    others |= {f"win rate {a} over {b}": rate.rate for (a, b), rate in pair_rates(responses).items()}
    return Score(value=own.rate, interval=own.interval, others=others)


def read_responses(path: Path, methods: Collection[str] | None = None) -> list[Response]:
    """Answers from a CSV file, one a line.

    Columns, by name: `left` and `right`, the methods shown on each side; `choice`, the name of the chosen one; and, if
    there, `rater`, `item` (the video or scene) and `criterion`. Other columns are left out.

    Parameters
    ----------
    path
        CSV file.
    methods
        Names that may occur; None: any.

    Raises
    ------
    MetricError
        The file is not such a table, a method is unknown, a choice was not shown, a method was shown against itself,
        or a rater answers the same question about the same pair twice.
    """
    responses: list[Response] = []
    answered: dict[tuple[str, str, str, frozenset[str]], str] = {}
    for place, line in read_table(path, required=REQUIRED, optional=OPTIONAL).items():
        with entry(path, place, "an answer"):
            response = Response(**line)
            _check(response, methods)
            question = (response.rater, response.item, response.criterion, frozenset((response.left, response.right)))
            before = answered.setdefault(question, place)
            if before != place and response.rater and response.item:
                raise MetricError(f"expected each answer once, got that of {before} again")
        responses.append(response)
    return responses


def _check(response: Response, methods: Collection[str] | None) -> None:
    shown = (response.left, response.right)
    unknown = [name for name in (*shown, response.choice) if not name or (methods is not None and name not in methods)]
    if unknown:
        raise MetricError(f"expected a method of {', '.join(methods or ['any name'])}, got {unknown[0]!r}")
    if response.left == response.right:
        raise MetricError(f"expected two methods, got {response.left} on both sides")
    if response.choice not in shown:
        raise MetricError(f"expected a choice of {response.left} or {response.right}, got {response.choice}")
