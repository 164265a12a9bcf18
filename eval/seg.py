"""Semantic segmentation: mIoU and mAcc from one confusion matrix of the whole data set."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.score import Score
from eval.values import Undefined, Value, mean

Counts = NDArray[np.int64]

IGNORED = 255

# Cordts et al., CVPR 2016: the 19 classes that are evaluated, by train id, and the label id of each.
CITYSCAPES = {
    "road": 7,
    "sidewalk": 8,
    "building": 11,
    "wall": 12,
    "fence": 13,
    "pole": 17,
    "traffic light": 19,
    "traffic sign": 20,
    "vegetation": 21,
    "terrain": 22,
    "sky": 23,
    "person": 24,
    "rider": 25,
    "car": 26,
    "truck": 27,
    "bus": 28,
    "train": 31,
    "motorcycle": 32,
    "bicycle": 33,
}

ABSENT = Undefined("class is absent")
UNLABELLED = Undefined("no pixel is labelled")


def train_ids(label_ids: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Cityscapes train ids, 0 to 18, of label ids; 255 where the label is not evaluated.

    >>> train_ids(np.array([0, 7, 26, 33], np.uint8)).tolist()
    [255, 0, 13, 18]
    """
    if label_ids.dtype != np.uint8:
        raise MetricError(f"label ids: expected uint8, got {label_ids.dtype}")
    table = np.full(256, IGNORED, dtype=np.uint8)
    table[list(CITYSCAPES.values())] = np.arange(len(CITYSCAPES))
    return np.asarray(table[label_ids], dtype=np.uint8)


def confusion(ref: NDArray[Any], gen: NDArray[Any], classes: int, ignore: int = IGNORED) -> Counts:
    """Pixels by class, (classes, classes): row the true class, column the predicted one. Sums over pictures add.

    Parameters
    ----------
    ref
        True class of each pixel, integers 0 to classes - 1, or `ignore`: such a pixel is not counted.
    gen
        Predicted class of each pixel, the same shape; 0 to classes - 1 wherever the true class is known.
    classes
        How many there are.
    ignore
        Mark of pixels without a true class.

    Raises
    ------
    MetricError
        The shapes differ, the labels are not integers, or a label is no class.

    >>> confusion(np.array([0, 0, 1, 255]), np.array([0, 1, 1, 0]), 2).tolist()
    [[1, 1], [0, 1]]
    """
    if ref.shape != gen.shape:
        raise MetricError(f"labels: expected the same shape on both sides, got {ref.shape} and {gen.shape}")
    if ref.dtype.kind not in "iu" or gen.dtype.kind not in "iu":
        raise MetricError(f"labels: expected integers, got {ref.dtype} and {gen.dtype}")
    known = ref != ignore
    true, predicted = ref[known].astype(np.int64), gen[known].astype(np.int64)
    for side, labels in (("true", true), ("predicted", predicted)):
        strangers = np.unique(labels[(labels < 0) | (labels >= classes)])
        if len(strangers):
            hint = " (label ids instead of train ids?)" if (strangers != ignore).any() else ""
            raise MetricError(
                f"{side} labels: expected 0 to {classes - 1} where the true one is not {ignore}, got "
                f"{strangers[:8].tolist()}{hint}"
            )
    counts = np.bincount(true * classes + predicted, minlength=classes * classes)
    return np.asarray(counts.reshape(classes, classes), dtype=np.int64)


def class_iou(counts: Counts) -> list[Value]:
    """IoU of each class: TP / (TP + FP + FN); Undefined where the class is neither true nor predicted anywhere.

    >>> class_iou(np.array([[3, 1, 0], [2, 4, 0], [0, 0, 0]]))
    [0.5, 0.5714285714285714, Undefined(reason='class is absent')]
    """
    return _shares(*_hits_and_unions(counts))


def _hits_and_unions(counts: Counts) -> tuple[Counts, Counts]:
    """Pixels of each class that are right, and that are of it on either side."""
    hits = np.diag(counts)
    return hits, counts.sum(axis=0) + counts.sum(axis=1) - hits


def class_accuracy(counts: Counts) -> list[Value]:
    """Accuracy (recall) of each class: TP / (TP + FN); Undefined where the class is true nowhere.

    >>> class_accuracy(np.array([[3, 1], [2, 4]]))
    [0.75, 0.6666666666666666]
    """
    return _shares(np.diag(counts), counts.sum(axis=1))


def _shares(parts: Counts, wholes: Counts) -> list[Value]:
    return [float(part / whole) if whole else ABSENT for part, whole in zip(parts, wholes, strict=True)]


class Picture(NamedTuple):
    """One picture: its confusion and its own mIoU."""

    counts: Counts
    iou: Value


@dataclass(frozen=True)
class Segmentation:
    """mIoU over the classes that occur; `Score.others` has mAcc, the share of right pixels, and IoU by class.

    What moves the number: the confusion is summed over the data set (a mean of the pictures' mIoU is another number,
    `Score.frames` has those), and classes that are absent on both sides are left out of the mean, not counted as 0
    (torchmetrics) or 1. A class that is predicted but nowhere true counts 0 in mIoU and not in mAcc.

    Parameters
    ----------
    classes
        Names of the classes, by train id.
    ignore
        Mark of pixels without a true class.
    ref_label_ids, gen_label_ids
        That side has Cityscapes' label ids, as its own files `*_labelIds.png` have, in place of train ids.
    """

    classes: tuple[str, ...] = tuple(CITYSCAPES)
    ignore: int = IGNORED
    ref_label_ids: bool = False
    gen_label_ids: bool = False

    def frame(self, ref: NDArray[Any], gen: NDArray[Any]) -> Picture:
        """One picture; see `confusion` for what it takes.

        >>> Segmentation(ref_label_ids=True).frame(np.array([[0, 7, 26]], np.uint8), np.array([[5, 0, 13]])).iou
        1.0
        """
        ref = train_ids(ref) if self.ref_label_ids else ref
        gen = train_ids(gen) if self.gen_label_ids else gen
        counts = confusion(ref, gen, len(self.classes), self.ignore)
        return Picture(counts, _mean(class_iou(counts)))

    def pool(self, records: Sequence[Picture]) -> Score:
        """mIoU of the summed confusion, of the pictures of one video or of several."""
        size = len(self.classes)
        counts = sum((record.counts for record in records), np.zeros((size, size), dtype=np.int64))
        ious = class_iou(counts)
        pixels = int(counts.sum())
        return Score(
            value=_mean(ious),
            frames=tuple(record.iou for record in records),
            others={
                "mAcc": _mean(class_accuracy(counts)),
                "share of right pixels": float(np.trace(counts) / pixels) if pixels else UNLABELLED,
                "labelled pixels": float(pixels),
                **{f"IoU {name}": value for name, value in zip(self.classes, ious, strict=True)},
            },
        )

    def summands(self, records: Sequence[Picture]) -> NDArray[np.float64]:
        """Pixels of each class that are right, then those that are of it on either side."""
        return np.array([np.concatenate(_hits_and_unions(record.counts)) for record in records], dtype=np.float64)

    def of_sums(self, sums: NDArray[np.float64]) -> Value:
        """mIoU of the summed confusion."""
        return _mean(_shares(*sums.astype(np.int64).reshape(2, len(self.classes))))


def _mean(values: Sequence[Value]) -> Value:
    return UNLABELLED if all(isinstance(value, Undefined) for value in values) else mean(values)


PRESETS = {"paper": Segmentation(), "label-ids": Segmentation(ref_label_ids=True, gen_label_ids=True)}
