"""Intervals: frames that count as often as they are drawn give what pooling the drawn frames gives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from eval.box_iou import BoxIoU, Match
from eval.edge_f1 import Counts, EdgeF1
from eval.flicker import Change, Flicker
from eval.psnr import Psnr
from eval.score import RESAMPLES, Additive, pooled
from eval.seg import Picture, Segmentation
from eval.shadow import Products, Shadow
from eval.si_rmse import DepthError, SiRmse
from eval.ssim import Ssim
from eval.values import Undefined, percentiles

RNG = np.random.default_rng(0)
FRAMES = 12
NOTHING = Undefined("nothing is there")


def some(low: int, high: int) -> list[int]:
    """A whole number for every frame."""
    return [int(value) for value in RNG.integers(low, high, FRAMES)]


def matches() -> list[Match]:
    """Boxes of frames, of which the last has none."""
    found = [Match(tuple(RNG.random(pairs)), pairs % 3, pairs % 2, 1) for pairs in some(0, 5)]
    return [*found[:-1], Match((), 0, 0, 2)]


METRICS: dict[str, tuple[Additive[Any], Sequence[Any]]] = {
    "psnr": (Psnr(), [float(error) for error in RNG.random(FRAMES) * 100]),
    "ssim": (Ssim(), [float(value) for value in RNG.random(FRAMES)]),
    "edge-f1": (EdgeF1(), [Counts(*of) for of in zip(some(0, 900), some(0, 900), some(0, 900), strict=True)]),
    "si-rmse": (SiRmse(), [DepthError(float(e) if e > 0.2 else NOTHING, 0.1) for e in RNG.random(FRAMES)]),
    "iou": (BoxIoU(), matches()),
    "flicker": (Flicker(), [Change(9.0, float(gen), 1 + gen % 7, 900) for gen in some(0, 99)]),
    "shadow": (Shadow(), [Products(4.0, 1 + gen, 1.5, 100 + gen) for gen in some(0, 9)]),
    "seg": (Segmentation(classes=("a", "b", "c")), [Picture(RNG.integers(0, 9, (3, 3)), 0.5) for _ in range(FRAMES)]),
}


@pytest.fixture(params=METRICS)
def metric_and_records(request: pytest.FixtureRequest) -> tuple[Additive[Any], Sequence[Any]]:
    """A metric, and what it kept of some frames."""
    return METRICS[request.param]


def test_the_sums_say_what_pooling_says(metric_and_records: tuple[Additive[Any], Sequence[Any]]) -> None:
    metric, records = metric_and_records
    assert metric.of_sums(metric.summands(records).sum(axis=0)) == pytest.approx(metric.pool(records).value, rel=1e-12)


def test_the_interval_is_that_of_pooling_drawn_frames(
    metric_and_records: tuple[Additive[Any], Sequence[Any]],
) -> None:
    metric, records = metric_and_records
    rng = np.random.default_rng(5)
    picks = [rng.integers(0, FRAMES, FRAMES) for _ in range(RESAMPLES)]
    expected = percentiles([metric.pool([records[i] for i in pick]).value for pick in picks])
    found = pooled(metric, records, seed=5)
    assert expected is not None
    assert expected[0] < expected[1]
    assert found.interval == pytest.approx(expected, rel=1e-9)
    assert found.value == metric.pool(records).value


@pytest.mark.parametrize(("metric", "nothing"), [(SiRmse(), DepthError(NOTHING, 1.0)), (BoxIoU(), Match((), 0, 0, 0))])
def test_frames_without_any_value_have_no_interval(metric: Additive[Any], nothing: Any) -> None:
    found = pooled(metric, [nothing] * 3)
    assert isinstance(found.value, Undefined)
    assert found.interval is None
    assert metric.of_sums(metric.summands([nothing] * 3).sum(axis=0)) == found.value
