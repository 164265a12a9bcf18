"""Edge F1: identical is 1, disjoint 0, none undefined; pooled by hand; thresholds where Sobel says."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from eval.edge_f1 import PRESETS, Counts, EdgeF1, counts, edges, f1
from eval.errors import MetricError
from eval.score import score
from eval.values import Undefined, undefined

PAPER, PAI_BENCH = PRESETS["paper"], PRESETS["pai-bench"]
FLAT = np.full((40, 60, 3), 90, np.uint8)


def step(column: int, codes: int) -> np.ndarray:
    """A grey picture that is brighter by so many codes from a column on."""
    picture = FLAT.copy()
    picture[:, column:] += np.uint8(codes)
    return picture


def scene() -> np.ndarray:
    """Tiles of many colours, softened."""
    tiles = np.random.default_rng(0).integers(0, 256, (9, 12, 3), dtype=np.uint8)
    return np.asarray(cv2.GaussianBlur(np.kron(tiles, np.ones((10, 10, 1), np.uint8)), (0, 0), 1))


def test_identical_is_one() -> None:
    found = score(PAPER, [scene()] * 2, [scene()] * 2)
    assert (found.value, found.others["precision"], found.others["recall"]) == (1.0, 1.0, 1.0)


def test_disjoint_is_zero() -> None:
    assert score(PAPER, [step(15, 80)], [step(40, 80)]).value == 0.0


def test_half_of_the_edges() -> None:
    both = step(15, 80)
    both[:, 40:] += np.uint8(80)
    found = score(PAPER, [both], [step(15, 80)])
    assert (found.others["precision"], found.others["recall"]) == (1.0, 0.5)
    assert found.value == pytest.approx(2 / 3)


def test_no_edges_at_all_are_undefined_and_counted() -> None:
    found = score(PAPER, [FLAT, step(15, 80)], [FLAT, step(15, 80)])
    assert undefined(found.frames) == {"no edges in either picture": 1}
    assert found.value == 1.0
    assert isinstance(score(PAPER, [FLAT] * 3, [FLAT] * 3).value, Undefined)
    assert isinstance(PAPER.pool([]).value, Undefined)


@pytest.mark.parametrize(("ref", "gen", "missing"), [(FLAT, step(9, 80), "recall"), (step(9, 80), FLAT, "precision")])
def test_edges_on_one_side_alone_are_not_found_again(ref: np.ndarray, gen: np.ndarray, missing: str) -> None:
    found = score(PAPER, [ref], [gen])
    assert found.value == 0.0
    assert isinstance(found.others[missing], Undefined)


def test_pixels_are_pooled_over_the_video() -> None:
    found = PAPER.pool([Counts(90, 10, 10), Counts(0, 0, 100), Counts(0, 0, 0)])
    assert found.value == pytest.approx(180 / (180 + 10 + 110))
    assert found.others["mean of frames"] == pytest.approx((0.9 + 0.0) / 2)


@pytest.mark.parametrize(("metric", "below", "above"), [(PAPER, 15, 16), (PAI_BENCH, 50, 51)])
def test_an_edge_begins_above_the_high_threshold(metric: EdgeF1, below: int, above: int) -> None:
    # Sobel's gradient of a vertical step is four times its height.
    assert not edges(step(30, below), metric.low, metric.high).any()
    assert edges(step(30, above), metric.low, metric.high).any()


def test_colours_are_weighted_as_grey() -> None:
    def seen(channel: int, codes: int) -> bool:
        picture = FLAT.copy()
        picture[:, 30:, channel] += np.uint8(codes)
        return bool(edges(picture, 30, 60).any())

    assert [seen(channel, 60) for channel in range(3)] == [True, True, False]  # .299, .587, .114 of 60: 18, 35, 7


def test_f1_by_another_library() -> None:
    metrics = pytest.importorskip("sklearn.metrics")
    other = np.clip(scene() + np.random.default_rng(1).normal(0, 12, scene().shape), 0, 255).astype(np.uint8)
    maps = [cv2.Canny(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), 30, 60).ravel() > 0 for picture in (scene(), other)]
    found = score(PAPER, [scene()], [other])
    assert found.value == pytest.approx(metrics.f1_score(*maps))
    assert found.others["precision"] == pytest.approx(metrics.precision_score(*maps))
    assert found.others["recall"] == pytest.approx(metrics.recall_score(*maps))


def test_less_contrast_leaves_fewer_edges() -> None:
    def faded(share: float) -> np.ndarray:
        return (scene() * share + 180 * (1 - share)).astype(np.uint8)

    found = [score(PAPER, [scene()], [faded(share)]).value for share in (1.0, 0.8, 0.5, 0.2)]
    assert found == sorted(found, reverse=True)
    assert found[0] == 1.0


def test_counts_by_hand() -> None:
    ref, gen = np.array([[True, True, False, False]]), np.array([[True, False, True, False]])
    assert counts(ref, gen) == Counts(1, 1, 1)
    assert f1(counts(ref, gen)) == 0.5


@pytest.mark.parametrize(("other", "message"), [(FLAT[:-1], "shape"), (FLAT / 255, "dtype")])
def test_what_is_no_pair_of_pictures_is_refused(other: np.ndarray, message: str) -> None:
    with pytest.raises(MetricError, match=message):
        PAPER.frame(FLAT, other)


def test_thresholds_are_of_codes() -> None:
    with pytest.raises(MetricError, match="8-bit"):
        PAPER.frame(FLAT / 255, FLAT / 255)
