"""Metrics of tables that others filled: DOVER's scores, answers of people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aw4d.evaluation.request import Found, Request, Watch
from eval.dover import read_scores
from eval.two_afc import read_responses, two_afc, win_rates


def dover(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """DOVER of the videos of a file of scores, as one set."""
    path = request.need("scores", "--scores", "a CSV or JSON with DOVER's technical and aesthetic score of each video")
    videos = read_scores(path)
    return {"dover": Found(scores={path.stem: conventions["dover"].score(list(videos.values()))})}


def choices(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Win rate of every method of a file of answers."""
    path = request.need("responses", "--responses", "a CSV of answers with the columns left, right and choice")
    responses = read_responses(path)
    return {"2afc": Found(scores={method: two_afc(responses, method) for method in win_rates(responses)})}
