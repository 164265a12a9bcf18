"""Values that are known exactly: what each metric must answer, and what it does answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eval import self_test_scenes as scenes
from eval.box_iou import Rectangle, iou, visible
from eval.clip_score import clip_score
from eval.dover import paper_fusion, released_fusion
from eval.edge_f1 import PRESETS as EDGES
from eval.edge_f1 import counts, f1
from eval.frechet import distance
from eval.fvd import fvd
from eval.identity import similarities
from eval.psnr import Psnr
from eval.score import score
from eval.seg import Segmentation
from eval.si_rmse import PRESETS as DEPTHS
from eval.ssim import PRESETS as SSIMS
from eval.two_afc import WinRate, round_robin, wilson
from eval.values import Undefined, Value


@dataclass(frozen=True, kw_only=True)
class Case:
    """One value.

    Parameters
    ----------
    metric, what
        Of which metric; what it is given.
    expected
        What it must answer, to `digits` after the point; None for "undefined".
    found
        Computes what it answers.
    """

    metric: str
    what: str
    expected: float | None
    found: Callable[[], Value]
    digits: int = 9

    @property
    def expected_text(self) -> str:
        """The value as it is printed."""
        return "undefined" if self.expected is None else f"{self.expected:.6g}"

    def agrees(self, found: Value) -> bool:
        """Whether an answer is the expected one."""
        if isinstance(found, Undefined) or self.expected is None:
            return isinstance(found, Undefined) and self.expected is None
        return found == self.expected or abs(found - self.expected) < 0.5 * 10.0**-self.digits


def _side(rectangle: Callable[[], Rectangle | Undefined], side: int) -> Callable[[], Value]:
    def found() -> Value:
        of = rectangle()
        return of if isinstance(of, Undefined) else of[side]

    return found


def _of_flat(level: int) -> np.ndarray:
    return np.full((16, 16), level, np.uint8)


FIRST, SECOND = scenes.squares()
DEPTH = np.random.default_rng(0).uniform(2, 80, (32, 32))
HALF = DEPTH * np.where(np.arange(32) < 16, 2.0, 1.0)
LABELS = Segmentation(classes=("a", "b"))
TRUE, PREDICTED = np.repeat([0, 1], [4, 6]), np.array([0, 0, 0, 1, 0, 0, 1, 1, 1, 1])  # confusion [[3, 1], [2, 4]]
# 3 edge pixels in both, 1 in gen alone, 2 in ref alone
COUNTS = counts(np.array([1, 1, 1, 1, 1, 0], np.bool_), np.array([1, 1, 1, 0, 0, 1], np.bool_))
WINS = {"a": 0, "b": 245, "c": 334, "d": 385, "ours": 476}

CASES: tuple[Case, ...] = (
    Case(
        metric="clip",
        what="embeddings that are equal",
        expected=1.0,
        found=lambda: clip_score(np.array([[0.1, 0.7]]), np.array([0.1, 0.7]), tokens=9).value,
    ),
    Case(
        metric="clip",
        what="cosines 1 and 0.6, mean",
        expected=0.8,
        found=lambda: clip_score(np.array([[1.0, 0.0], [3.0, 4.0]]), np.array([2.0, 0.0]), tokens=9).value,
    ),
    Case(
        metric="clip",
        what="tokens cut of a text of 130",
        expected=53,
        found=lambda: clip_score(np.array([[1.0]]), np.array([1.0]), tokens=130).others["tokens cut"],
    ),
    Case(
        metric="identity",
        what="the same crop",
        expected=1.0,
        found=lambda: similarities(np.array([[0.3, 0.4]]), np.array([[0.3, 0.4]]))[0],
    ),
    Case(
        metric="identity",
        what="one patch of two turned by 90 degrees",
        expected=0.5,
        found=lambda: similarities(np.array([[[1.0, 0], [1, 0]]]), np.array([[[2.0, 0], [0, 2]]]))[0],
    ),
    *(
        Case(
            metric="iou",
            what=f"box behind the camera, clipped: {name} [px]",
            expected=expected,
            found=_side(lambda: visible(*scenes.beside()), side),
            digits=0,
        )
        for side, (name, expected) in enumerate((("left", 993), ("top", 375.5), ("right", 1280), ("bottom", 704)))
    ),
    Case(
        metric="iou",
        what="the printed rectangle of that box against it",
        expected=0.001,
        found=scenes.printed_against_visible,
        digits=3,
    ),
    Case(
        metric="iou",
        what="squares that share half",
        expected=1 / 3,
        found=lambda: iou(Rectangle(0, 0, 2, 2), Rectangle(1, 0, 3, 2)),
    ),
    Case(
        metric="si-rmse",
        what="three times the depth, eigen",
        expected=0.0,
        found=lambda: score(DEPTHS["eigen"], [DEPTH], [3 * DEPTH]).value,
    ),
    Case(
        metric="si-rmse",
        what="half of the pixels twice as far, eigen: ln 2 / 2",
        expected=math.log(2) / 2,
        found=lambda: score(DEPTHS["eigen"], [DEPTH], [HALF]).value,
    ),
    Case(
        metric="si-rmse",
        what="no pixel with a depth",
        expected=None,
        found=lambda: score(DEPTHS["eigen"], [DEPTH], [0 * DEPTH]).value,
    ),
    Case(
        metric="edge-f1",
        what="the same picture",
        expected=1.0,
        found=lambda: score(EDGES["paper"], [FIRST], [FIRST]).value,
    ),
    Case(
        metric="edge-f1",
        what="edges elsewhere",
        expected=0.0,
        found=lambda: score(EDGES["paper"], [FIRST], [SECOND]).value,
    ),
    Case(
        metric="edge-f1",
        what="no edges on either side",
        expected=None,
        found=lambda: score(EDGES["paper"], [0 * FIRST], [0 * FIRST]).value,
    ),
    *(
        Case(metric="edge-f1", what=f"5 edge pixels against 4, 3 in common: {name}", expected=expected, found=found)
        for name, expected, found in (
            ("in both", 3, lambda: float(COUNTS.true_positive)),
            ("in gen alone", 1, lambda: float(COUNTS.false_positive)),
            ("in ref alone", 2, lambda: float(COUNTS.false_negative)),
            ("F1", 2 / 3, lambda: f1(COUNTS)),
        )
    ),
    Case(
        metric="fvd",
        what="8 features 0 against 8 features 1, d = 3",
        expected=3.0,
        found=lambda: fvd(np.zeros((8, 3)), np.ones((8, 3))).value,
    ),
    Case(
        metric="fvd",
        what="variances 2 and 18, means alike",
        expected=8.0,
        found=lambda: distance(np.array([[-1.0], [1.0]]), np.array([[-3.0], [3.0]])),
    ),
    Case(
        metric="fvd",
        what="a set against itself, 50 features of 400 numbers",
        expected=0.0,
        found=lambda: fvd(*[np.random.default_rng(1).normal(size=(50, 400))] * 2).value,
        digits=300,
    ),
    Case(
        metric="dover",
        what="paper's fusion of technical 1, aesthetic 0",
        expected=0.572,
        found=lambda: float(paper_fusion(1.0, 0.0)),
    ),
    Case(
        metric="dover",
        what="released fusion at the mean of both branches",
        expected=0.5,
        found=lambda: float(released_fusion(0.1107, -0.08285)),
    ),
    Case(
        metric="dover",
        what="released fusion one spread above both means: 1 / (1 + exp -1)",
        expected=1 / (1 + math.exp(-1)),
        found=lambda: float(released_fusion(0.1107 + 0.07355, -0.08285 + 0.03774)),
    ),
    Case(
        metric="psnr",
        what="of the mean of the errors 0.5 and 0.1",
        expected=5.23,
        found=lambda: Psnr(data_range=1.0).pool([0.5, 0.1]).value,
        digits=2,
    ),
    Case(
        metric="psnr",
        what="mean of the PSNR of the same",
        expected=6.51,
        found=lambda: Psnr(data_range=1.0).pool([0.5, 0.1]).others["mean of PSNR"],
        digits=2,
    ),
    Case(
        metric="psnr",
        what="the same picture",
        expected=math.inf,
        found=lambda: score(Psnr(), [FIRST], [FIRST]).value,
    ),
    Case(
        metric="ssim",
        what="the same picture",
        expected=1.0,
        found=lambda: score(next(iter(SSIMS.values())), [FIRST], [FIRST]).value,
    ),
    Case(
        metric="ssim",
        what="flat 100 against flat 200: (40000 + 2.55^2) / (50000 + 2.55^2)",
        expected=(40000 + 2.55**2) / (50000 + 2.55**2),
        found=lambda: score(next(iter(SSIMS.values())), [_of_flat(100)], [_of_flat(200)]).value,
    ),
    Case(
        metric="seg",
        what="mIoU of [[3, 1], [2, 4]]: (1/2 + 4/7) / 2",
        expected=(1 / 2 + 4 / 7) / 2,
        found=lambda: score(LABELS, [TRUE], [PREDICTED]).value,
    ),
    Case(
        metric="seg",
        what="mAcc of the same: (3/4 + 4/6) / 2",
        expected=(3 / 4 + 4 / 6) / 2,
        found=lambda: score(LABELS, [TRUE], [PREDICTED]).others["mAcc"],
    ),
    Case(
        metric="2afc",
        what="rate of 476 wins in a round robin of five, 144 answers a pair",
        expected=476 / 576,
        found=lambda: round_robin(WINS, 144)["ours"].rate,
    ),
    Case(metric="2afc", what="Wilson interval of it, low", expected=0.793, found=lambda: wilson(476, 576)[0], digits=3),
    Case(
        metric="2afc", what="Wilson interval of it, high", expected=0.855, found=lambda: wilson(476, 576)[1], digits=3
    ),
    Case(metric="2afc", what="5 of 5, binomial test: 2 / 2^5", expected=0.0625, found=lambda: WinRate(5, 5).p_value),
    Case(metric="flicker", what="a scene that stands still", expected=0.0, found=lambda: scenes.flicker(0).value),
    Case(
        metric="flicker",
        what="every second frame 20 codes brighter",
        expected=20.0,
        found=lambda: scenes.flicker(20).value,
    ),
    Case(
        metric="flicker",
        what="variance over time of the same: 20^2 / 4",
        expected=100.0,
        found=lambda: scenes.variance(20),
    ),
    Case(metric="shadow", what="the same picture", expected=1.0, found=lambda: scenes.shadow(1.0).value),
    Case(
        metric="shadow",
        what="half of the contrast, in 8-bit codes: strength left",
        expected=0.5,
        found=lambda: scenes.shadow(0.5).others["strength left"],
        digits=2,
    ),
    Case(
        metric="visibility",
        what="levels of Koschmieder's law in fog of 100 m",
        expected=100.0,
        found=lambda: scenes.visibility(100.0),
        digits=6,
    ),
)

I3D_WHAT = "8 videos of black against 8 of white, (30, 64, 64), through I3D"
I3D_EXPECTED = 151.256


def i3d_case(weights: Path) -> Case:
    """The distance that I3D's published weights give; another file gives another."""

    def found() -> Value:
        from eval.models.i3d import I3D

        model = I3D(weights)
        sides = [model.features([np.full((30, 64, 64, 3), code, np.uint8)] * 8) for code in (0, 255)]
        return fvd(*sides).value

    return Case(metric="fvd", what=I3D_WHAT, expected=I3D_EXPECTED, found=found, digits=2)
