"""Time of every metric's arithmetic: `python -m pytest tests/bench/metrics.py --benchmark-only`."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eval.box_iou import box_iou
from eval.boxes import Box3D, Camera, cuboid
from eval.clip_score import clip_score
from eval.dover import PRESETS as DOVER
from eval.dover import Branches
from eval.edge_f1 import PRESETS as EDGES
from eval.flicker import Flicker
from eval.frechet import distance
from eval.fvd import fvd
from eval.identity import similarities
from eval.psnr import Psnr
from eval.seg import Segmentation
from eval.shadow import Shadow, borders
from eval.si_rmse import PRESETS as DEPTHS
from eval.ssim import PRESETS as SSIM
from eval.two_afc import Response, win_rates
from eval.view import View
from eval.visibility import Visibility

pytest.importorskip("pytest_benchmark")
HEIGHT, WIDTH = 704, 1280
RNG = np.random.default_rng(0)
REF = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
GEN = np.clip(REF.astype(int) + RNG.integers(-20, 20, REF.shape), 0, 255).astype(np.uint8)
DEPTH = RNG.uniform(2, 80, (HEIGHT, WIDTH)).astype(np.float32)
NOTHING = np.zeros((HEIGHT, WIDTH), dtype=bool)
VIEW = View(depth=DEPTH, K=np.array([[1000.0, 0, 640], [0, 1000.0, 352], [0, 0, 1]]), sky=NOTHING, moving=NOTHING)


@pytest.mark.parametrize(
    "metric", [Psnr(), *SSIM.values(), *EDGES.values()], ids=["psnr", "ssim", "edge-f1", "edge-f1 pai-bench"]
)
def test_a_frame_of_pictures(benchmark: Any, metric: Any) -> None:
    benchmark(metric.frame, REF, GEN)


@pytest.mark.parametrize("preset", ["eigen", "pai-bench"])
def test_a_frame_of_depth(benchmark: Any, preset: str) -> None:
    benchmark(DEPTHS[preset].frame, DEPTH, 2 * DEPTH)


def test_a_frame_of_labels(benchmark: Any) -> None:
    benchmark(Segmentation().frame, REF[..., 0] % 19, GEN[..., 0] % 19)


def test_flicker_of_a_pair_of_frames(benchmark: Any) -> None:
    benchmark(Flicker().frame, (REF, GEN), (REF, GEN), (VIEW, VIEW))


def test_shadow_of_a_frame(benchmark: Any) -> None:
    benchmark(lambda: Shadow().frame(REF, GEN, borders(REF, ~NOTHING, VIEW)))


def test_visibility_of_a_frame(benchmark: Any) -> None:
    benchmark(Visibility().frame, REF, VIEW)


def test_boxes_of_a_video(benchmark: Any) -> None:
    camera = Camera(K=VIEW.K, width=WIDTH, height=HEIGHT)
    boxes = {}
    for frame in range(57):
        pose = np.eye(4)
        pose[:3, 3] = RNG.uniform((-5, 0, 5), (5, 2, 60))
        boxes[str(frame)] = tuple(Box3D(corners=cuboid(pose, (2, 1.6, 4.5)), category="car") for _ in range(20))
    benchmark(box_iou, boxes, boxes, dict.fromkeys(boxes, camera))


@pytest.mark.parametrize("count", [120, 2048])
def test_frechet_distance(benchmark: Any, count: int) -> None:
    benchmark(distance, RNG.normal(size=(count, 400)), RNG.normal(size=(count, 400)))


def test_fvd_of_120_clips(benchmark: Any) -> None:
    benchmark(fvd, RNG.normal(size=(120, 400)), RNG.normal(size=(120, 400)))


def test_clip_score_of_a_video(benchmark: Any) -> None:
    benchmark(clip_score, RNG.normal(size=(57, 768)), RNG.normal(size=768), tokens=20)


def test_identity_of_200_boxes(benchmark: Any) -> None:
    benchmark(similarities, RNG.normal(size=(200, 256, 1024)), RNG.normal(size=(200, 256, 1024)))


def test_dover_of_480_videos(benchmark: Any) -> None:
    benchmark(DOVER["paper"].score, [Branches(0.1, -0.1)] * 480)


def test_1440_answers(benchmark: Any) -> None:
    benchmark(win_rates, [Response("a", "b", "a")] * 1440)
