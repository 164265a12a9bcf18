"""Metrics of tables that others filled: DOVER's scores, answers of people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aw4d.evaluation.request import Found, Request, Watch
from eval.dover import read_scores
from eval.two_afc import read_responses, two_afc, win_rates


def dover(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """DOVER of every video of a file of scores."""
    path = request.need("scores", "--scores", "DOVER's technical and aesthetic score of each video, CSV or JSON")
    return {"dover": Found(scores=conventions["dover"].by_video(read_scores(path)))}


def choices(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Win rate of every method of a file of answers."""
    path = request.need("responses", "--responses", "answers, a CSV with the columns left, right and choice")
    responses = read_responses(path)
    return {"2afc": Found(scores={method: two_afc(responses, method) for method in win_rates(responses)})}
