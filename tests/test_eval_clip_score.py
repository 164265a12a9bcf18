"""CLIP score: cosines, which text is compared, and what of it is not read."""

from __future__ import annotations

import numpy as np
import pytest

from eval.clip_score import PRESETS, ClipScore, clip_score, cut
from eval.cosine import cosines
from eval.errors import MetricError
from eval.values import Undefined


def embeddings(n: int, seed: int = 0) -> np.ndarray:
    """Random embeddings."""
    return np.random.default_rng(seed).normal(size=(n, 768)).astype(np.float32)


def test_identical_embeddings_score_one_exactly() -> None:
    images = np.repeat(embeddings(1), 5, axis=0)
    score = clip_score(images, images[0], tokens=20)
    assert score.value == 1
    assert score.frames == (1.0,) * 5


def test_opposite_and_orthogonal_embeddings() -> None:
    assert cosines(np.array([[1.0, 2.0], [2.0, -1.0]]), np.array([-1.0, -2.0])) == (-1.0, 0.0)


def test_lengths_do_not_matter() -> None:
    images, text = embeddings(6), embeddings(1, seed=1)[0]
    expected = [i @ text / np.linalg.norm(i) / np.linalg.norm(text) for i in images.astype(np.float64)]
    for scale in (1e-30, 1.0, 1e30):
        assert clip_score(images * np.float32(scale), text, tokens=2).frames == pytest.approx(expected, abs=1e-6)


def test_is_the_mean_over_frames() -> None:
    images = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    assert clip_score(images, np.array([1.0, 0.0]), tokens=2).value == 0


def test_a_frame_without_a_direction_is_undefined_and_counted() -> None:
    images = np.array([[1.0, 0.0], [0.0, 0.0]])
    score = clip_score(images, np.array([1.0, 0.0]), tokens=2)
    assert score.value == 1
    assert score.frames[1] == Undefined("a feature of length 0")


@pytest.mark.parametrize(
    ("images", "text"),
    [(np.zeros((3, 4)), np.zeros(5)), (np.zeros(4), np.zeros(4)), (np.full((1, 2), np.nan), np.ones(2))],
)
def test_broken_embeddings_are_refused(images: np.ndarray, text: np.ndarray) -> None:
    with pytest.raises(MetricError, match="features: expected"):
        clip_score(images, text, tokens=2)


@pytest.mark.parametrize(("tokens", "lost"), [(2, 0), (77, 0), (78, 1), (146, 69)])
def test_what_of_a_text_is_cut_is_counted_and_said(tokens: int, lost: int) -> None:
    score = clip_score(embeddings(1), embeddings(1)[0], tokens=tokens)
    assert score.others == {"tokens": tokens, "tokens cut": lost}
    said = cut(tokens, 77)
    assert (said is None) == (lost == 0)
    assert said is None or f"its last {lost} are not scored" in said


def test_the_text_is_of_the_prompt_mode() -> None:
    texts = {"base": "A street. ", "instruction": " Dense fog."}
    assert ClipScore(prompt="base").text(**texts) == "A street."
    assert ClipScore(prompt="instruction").text(**texts) == "Dense fog."
    assert PRESETS["paper"].text(**texts) == "A street. Dense fog."


@pytest.mark.parametrize(
    ("mode", "missing"), [("base", "base"), ("instruction", "instruction"), ("joined", "base and")]
)
def test_a_missing_text_is_refused(mode: str, missing: str) -> None:
    with pytest.raises(MetricError, match=f"prompt mode '{mode}': expected a text for {missing}"):
        ClipScore(prompt=mode).text(base=" ")  # type: ignore[arg-type]
