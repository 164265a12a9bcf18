"""FVD: what a clip is, and what the score says of its own reliability. With models: test_eval_models."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.frechet import distance, statistics
from eval.fvd import MIN_FRAMES, Fvd, fvd, same_set_split
from eval.values import Undefined


def video(n: int, height: int = 6, width: int = 8) -> NDArray[np.uint8]:
    """Frames that hold their own number."""
    return np.broadcast_to(np.arange(n, dtype=np.uint8)[:, None, None, None], (n, height, width, 3)).copy()


@pytest.mark.parametrize(
    ("convention", "expected"),
    [
        (Fvd(), range(57)),
        (Fvd(stride=5), range(0, 57, 5)),
        (Fvd(frames=16), range(16)),
        (Fvd(frames=16, stride=3), range(0, 48, 3)),
    ],
)
def test_a_clip_is_these_frames(convention: Fvd, expected: range) -> None:
    assert convention.clip(iter(video(57)))[:, 0, 0, 0].tolist() == list(expected)


def test_a_clip_reads_no_further_than_it_must() -> None:
    frames = iter(video(57))
    Fvd(frames=10, stride=2).clip(frames)
    assert next(frames)[0, 0, 0] == 19


@pytest.mark.parametrize("n", [0, 1, MIN_FRAMES - 1])
def test_a_video_of_too_few_frames_is_refused(n: int) -> None:
    with pytest.raises(MetricError, match=rf"night\.mp4: expected at least 10 frames at stride 1, got {n}"):
        Fvd().clip(video(n), "night.mp4")
    assert len(Fvd().clip(video(MIN_FRAMES))) == MIN_FRAMES


def test_clips_of_one_set_have_one_length() -> None:
    with pytest.raises(MetricError, match="expected at least 16 frames at stride 2, got 15"):
        Fvd(frames=16, stride=2).clip(video(30))


def test_area_averages_what_a_pixel_covers() -> None:
    frames = np.random.default_rng(0).integers(0, 256, (10, 448, 672, 3), dtype=np.uint8)
    found = Fvd(resize="area").clip(frames)
    expected = frames.reshape(10, 224, 2, 224, 3, 3).mean(axis=(2, 4))
    assert found.shape == (10, 224, 224, 3)
    assert np.abs(found - expected).max() <= 0.5 + 1e-4
    assert np.array_equal(Fvd().clip(frames), frames)


@pytest.mark.parametrize("settings", [{"frames": 9}, {"stride": 0}])
def test_conventions_that_i3d_cannot_take_are_refused(settings: dict[str, int]) -> None:
    with pytest.raises(MetricError, match=r"expected at least"):
        Fvd(**settings)  # type: ignore[arg-type]


def normal(n: int, d: int = 20, seed: int = 0) -> NDArray[np.float64]:
    """Features."""
    return np.random.default_rng(seed).normal(size=(n, d))


def test_the_score_says_how_many_videos_there_were() -> None:
    score = fvd(normal(40), normal(30, seed=1) + 1)
    assert score.value == distance(normal(40), normal(30, seed=1) + 1)
    assert score.others["videos of ref"] == 40
    assert score.others["videos of gen"] == 30
    assert score.others["videos over d"] == 1.5


def test_identical_videos_are_at_zero_though_their_halves_are_not() -> None:
    score = fvd(normal(40), normal(40))
    assert score.value == 0
    split = score.others["same-set split"]
    assert isinstance(split, float)
    assert split > 1


def test_the_split_is_of_disjoint_halves_that_the_seed_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    halves: list[set[float]] = []

    def look(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
        halves.extend((set(a[:, 0]), set(b[:, 0])))
        return 0.0

    monkeypatch.setattr("eval.fvd.distance", look)
    for seed in (0, 0, 1):
        same_set_split(np.arange(41.0)[:, None], seed=seed)
    assert {len(half) for half in halves} == {20}
    assert halves[0].isdisjoint(halves[1])
    assert halves[:2] == halves[2:4] != halves[4:]


def test_statistics_stand_for_features() -> None:
    ref, gen = normal(40), normal(30, seed=1)
    score = fvd(statistics(ref), statistics(gen))
    assert score.value == pytest.approx(fvd(ref, gen).value, rel=1e-9)
    assert score.others["videos of gen"] == 30
    assert score.others["same-set split"] == Undefined("only statistics are kept")


@pytest.mark.parametrize("n", [0, 1])
def test_a_set_of_one_video_has_no_distribution(n: int) -> None:
    score = fvd(normal(5), normal(n))
    assert score.value == Undefined("a set has fewer than 2 videos")
    assert score.others["videos of gen"] == n


def test_two_videos_cannot_be_halved() -> None:
    assert same_set_split(normal(3)) == Undefined("fewer than 4 videos to halve")


@pytest.mark.parametrize("gen", [normal(5, d=3), np.full((5, 20), np.nan), np.zeros((5, 4, 5))])
def test_broken_features_are_refused(gen: NDArray[Any]) -> None:
    with pytest.raises(MetricError, match="expected"):
        fvd(normal(5), gen)
