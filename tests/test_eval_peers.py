"""The same numbers from torchmetrics, where it is installed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eval.psnr import Psnr
from eval.score import score
from eval.seg import Segmentation
from eval.ssim import Ssim
from eval.values import Undefined

RNG = np.random.default_rng(0)
REF = RNG.integers(0, 256, (3, 48, 64, 3), dtype=np.uint8)
GEN = np.clip(REF.astype(int) + RNG.integers(-40, 40, REF.shape), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def torchmetrics(torchvision_operators: Any) -> Any:
    return pytest.importorskip("torchmetrics", reason="no torchmetrics")


def channels_first(torch: Any, pictures: np.ndarray) -> Any:
    return torch.from_numpy(pictures.transpose(0, 3, 1, 2).astype(np.float64))


def number(value: float | Undefined) -> float:
    assert not isinstance(value, Undefined)
    return value


def test_psnr_of_the_mean_error(torch: Any, torchmetrics: Any) -> None:
    peer = torchmetrics.image.PeakSignalNoiseRatio(data_range=255.0)
    expected = float(peer(channels_first(torch, GEN), channels_first(torch, REF)))
    assert number(score(Psnr(), REF, GEN).value) == pytest.approx(expected, rel=1e-6)


def test_ssim(torch: Any, torchmetrics: Any) -> None:
    """The peer counts the border, where it mirrors the picture; scikit-image and Wang et al. leave it out."""
    ssim = torchmetrics.functional.image.structural_similarity_index_measure
    _, full = ssim(channels_first(torch, GEN), channels_first(torch, REF), data_range=255.0, return_full_image=True)
    assert number(score(Ssim(), REF, GEN).value) == pytest.approx(float(full[..., 5:-5, 5:-5].mean()), rel=1e-9)


def test_miou_over_classes_that_occur(torch: Any, torchmetrics: Any) -> None:
    ref, gen = (RNG.integers(0, 5, (2, 40, 40)).astype(np.uint8) for _ in range(2))
    ref[:, :5] = 255
    classes = tuple("abcde")
    peer = torchmetrics.classification.MulticlassJaccardIndex(num_classes=5, ignore_index=255)
    expected = float(peer(torch.from_numpy(gen.astype(int)), torch.from_numpy(ref.astype(int))))
    assert number(score(Segmentation(classes=classes), ref, gen).value) == pytest.approx(expected, rel=1e-6)
