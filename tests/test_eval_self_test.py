"""The self test: every metric has a value that is known, and an answer that is wrong is told."""

from __future__ import annotations

import pytest

from aw4d.evaluation.run import METRICS
from eval.self_test import CASES, Case
from eval.values import Undefined


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.metric}: {case.what}")
def test_what_is_known_is_found(case: Case) -> None:
    found = case.found()
    assert case.agrees(found), f"expected {case.expected_text}, found {found}"


def test_every_metric_has_a_case() -> None:
    assert {case.metric for case in CASES} == set(METRICS)


def test_another_answer_does_not_agree() -> None:
    for case in CASES:
        wrong = 0.25 if case.expected is None else case.expected + 10.0**-case.digits
        assert not case.agrees(wrong) or wrong == case.expected  # infinity has no other beside it
        assert case.agrees(Undefined("no edges")) == (case.expected is None)
