"""Two-alternative forced choice: rates, intervals and tests against the paper's numbers, peers and by hand."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.errors import MetricError
from eval.two_afc import (
    Response,
    WinRate,
    pair_rates,
    read_responses,
    round_robin,
    two_afc,
    wilson,
    win_rates,
)
from eval.values import Undefined

PAPER = {"Video-P2P": 0, "Ditto": 245, "Cosmos-Transfer2.5": 334, "WAN-FUN 2.2": 385, "Ours": 476}
PRINTED = {"Video-P2P": 0.0, "Ditto": 0.425, "Cosmos-Transfer2.5": 0.580, "WAN-FUN 2.2": 0.668, "Ours": 0.826}
COUNTS = st.integers(1, 2000).flatmap(lambda trials: st.tuples(st.integers(0, trials), st.just(trials)))


class TestThePaper:
    def test_round_robin_has_the_printed_rates(self) -> None:
        rates = round_robin(PAPER, answers_a_pair=144)
        assert {rate.trials for rate in rates.values()} == {576}
        assert sum(PAPER.values()) == 10 * 144 == 1440
        for name, rate in rates.items():
            assert isinstance(rate.rate, float)
            assert round(rate.rate, 3) == PRINTED[name]

    def test_printed_rates_have_no_other_wins(self) -> None:
        assert {name: round(576 * rate) for name, rate in PRINTED.items()} == PAPER

    def test_wilson_interval(self) -> None:
        low, high = wilson(476, 576)
        assert (round(low, 3), round(high, 3)) == (0.793, 0.855)

    def test_a_study_of_answers_gives_the_same(self) -> None:
        """A round robin with the paper's wins, answer by answer."""
        responses = answers(PAPER, 144)
        assert len(responses) == 1440
        assert {name: rate.wins for name, rate in win_rates(responses).items()} == PAPER
        assert len(pair_rates(responses)) == 10
        score = two_afc(responses, "Ours")
        assert score.value == 476 / 576
        assert score.interval == wilson(476, 576)
        assert score.others["trials"] == 576


def answers(wins: dict[str, int], a_pair: int) -> list[Response]:
    """Answers of a round robin with these wins: each pair's go to the one whose wins are furthest from used up."""
    pairs = [pair for pair in itertools.combinations(wins, 2) for _ in range(a_pair)]
    left = dict(wins)
    chosen = []
    for a, b in pairs:
        chosen.append(max((a, b), key=lambda name: left[name]))
        left[chosen[-1]] -= 1
    responses = [Response(a, b, name) for (a, b), name in zip(pairs, chosen, strict=True)]
    while any(left.values()):  # move a win from one that has too many, over the methods between, to one that lacks
        path = _path(responses, next(n for n in left if left[n] < 0), next(n for n in left if left[n] > 0))
        for index, winner in path:
            left[responses[index].choice] += 1
            left[winner] -= 1
            responses[index] = responses[index]._replace(choice=winner)
    return responses


def _path(responses: list[Response], rich: str, poor: str) -> list[tuple[int, str]]:
    """Answers to turn, each with its new winner, so that `rich` has a win less and `poor` one more."""
    seen: dict[str, list[tuple[int, str]]] = {rich: []}
    queue = [rich]
    while poor not in seen:
        name = queue.pop(0)
        for index, response in enumerate(responses):
            other = response.right if response.left == name else response.left
            if response.choice == name and other not in seen:
                seen[other] = [*seen[name], (index, other)]
                queue.append(other)
    return seen[poor]


class TestIntervals:
    @settings(deadline=None)
    @given(COUNTS)
    def test_wilson_equals_scipy(self, counts: tuple[int, int]) -> None:
        from scipy.stats import binomtest

        expected = binomtest(*counts).proportion_ci(confidence_level=0.95, method="wilson")
        assert wilson(*counts) == pytest.approx((expected.low, expected.high), abs=1e-12)

    @settings(deadline=None)
    @given(COUNTS)
    def test_wilson_mirrors_and_contains_the_rate(self, counts: tuple[int, int]) -> None:
        wins, trials = counts
        low, high = wilson(wins, trials)
        assert 0 <= low <= wins / trials <= high <= 1
        mirrored = wilson(trials - wins, trials)
        assert (1 - high, 1 - low) == pytest.approx(mirrored, abs=1e-12)

    def test_wilson_ends_are_where_the_normal_test_just_rejects(self) -> None:
        """The interval inverts the score test: at its ends, p^ is 1.96 standard errors away."""
        low, high = wilson(30, 100)
        for end in (low, high):
            assert abs(0.3 - end) / math.sqrt(end * (1 - end) / 100) == pytest.approx(1.959964, abs=1e-6)

    @settings(deadline=None)
    @given(st.integers(1, 60).flatmap(lambda trials: st.tuples(st.integers(0, trials), st.just(trials))))
    def test_binomial_test_by_summing(self, counts: tuple[int, int]) -> None:
        wins, trials = counts
        ways = [math.comb(trials, k) for k in range(trials + 1)]
        expected = sum(way for way in ways if way <= ways[wins]) / 2**trials
        assert WinRate(wins, trials).p_value == pytest.approx(expected)

    def test_without_trials(self) -> None:
        empty = WinRate(0, 0)
        assert (empty.rate, empty.p_value, empty.interval) == (Undefined("never shown"), Undefined("never shown"), None)

    def test_impossible_counts(self) -> None:
        with pytest.raises(MetricError, match="expected 0 to 3"):
            WinRate(4, 3)


class TestRates:
    @settings(deadline=None)
    @given(st.lists(st.tuples(st.permutations("abcd"), st.booleans()), min_size=1, max_size=50))
    def test_wins_add_up_to_answers_and_sides_do_not_matter(self, drawn: list[tuple[list[str], bool]]) -> None:
        responses = [Response(names[0], names[1], names[first]) for names, first in drawn]
        rates = win_rates(responses)
        assert sum(rate.wins for rate in rates.values()) == len(responses)
        assert sum(rate.trials for rate in rates.values()) == 2 * len(responses)
        swapped = [response._replace(left=response.right, right=response.left) for response in responses]
        assert win_rates(swapped) == rates

    def test_pair_that_was_never_shown_is_undefined(self) -> None:
        pairs = pair_rates([Response("a", "b", "a"), Response("c", "b", "c")])
        assert pairs["a", "c"].rate == Undefined("never shown")
        assert pairs["a", "b"] == WinRate(1, 1)

    def test_unknown_method(self) -> None:
        with pytest.raises(MetricError, match="expected one of a, b, got c"):
            two_afc([Response("a", "b", "a")], "c")


class TestRoundRobin:
    def test_wins_that_do_not_add_up(self) -> None:
        with pytest.raises(MetricError, match="expected a sum of 1440, 144 a pair, got 1441"):
            round_robin(PAPER | {"Ours": 477}, answers_a_pair=144)

    def test_wins_that_no_round_robin_has(self) -> None:
        with pytest.raises(MetricError, match="expected at least 10 for any 2 methods, got"):
            round_robin({"a": 4, "b": 4, "c": 22}, answers_a_pair=10)

    @settings(deadline=None)
    @given(st.integers(2, 6), st.integers(1, 8), st.integers(0, 1000))
    def test_any_real_one_is_accepted(self, methods: int, a_pair: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        pairs = [pair for pair in itertools.combinations(map(str, range(methods)), 2) for _ in range(a_pair)]
        responses = [Response(a, b, str(rng.choice([a, b]))) for a, b in pairs]
        rates = win_rates(responses)
        assert round_robin({name: rate.wins for name, rate in rates.items()}, a_pair) == rates


class TestFiles:
    def write(self, path: Path, text: str) -> Path:
        path.write_text(text, encoding="utf-8")
        return path

    def test_reads(self, tmp_path: Path) -> None:
        text = "rater,item,criterion,left,right,choice,seconds\nr1,v3,spatial,ours,ditto,ours,4\n"
        (response,) = read_responses(self.write(tmp_path / "r.csv", text), methods=("ours", "ditto"))
        assert response == Response("ours", "ditto", "ours", rater="r1", item="v3", criterion="spatial")

    def test_raters_and_items_may_be_left_out(self, tmp_path: Path) -> None:
        path = self.write(tmp_path / "r.csv", "choice,left,right\na,a,b\na,a,b\n")
        assert read_responses(path) == [Response("a", "b", "a")] * 2

    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("r2,v1,x,ours,dito,ours", "line 3: expected a method of ours, ditto, wan, got 'dito'"),
            ("r2,v1,x,ours,ditto,wan", "line 3: expected a choice of ours or ditto, got wan"),
            ("r2,v1,x,ours,ours,ours", "line 3: expected two methods, got ours on both sides"),
            ("r2,v1,x,ours,,ours", "line 3: expected a method of ours, ditto, wan, got ''"),
            ("r1,v1,x,ditto,ours,ditto", "line 3: expected each answer once, got that of line 2 again"),
            ("r2,v1,x,ours,ditto", "line 3: expected 6 fields, got 5"),
        ],
    )
    def test_inconsistent_answer_is_named(self, tmp_path: Path, line: str, message: str) -> None:
        path = self.write(
            tmp_path / "r.csv", f"rater,item,criterion,left,right,choice\nr1,v1,x,ours,ditto,ours\n{line}\n"
        )
        with pytest.raises(MetricError, match=rf"r\.csv: {message}"):
            read_responses(path, methods=("ours", "ditto", "wan"))

    def test_columns_by_name(self, tmp_path: Path) -> None:
        with pytest.raises(MetricError, match="expected the columns left, right, choice"):
            read_responses(self.write(tmp_path / "r.csv", "ours,ditto,ours\n"))
