"""Segmentation: confusion of the data set against scikit-learn and by hand; absent classes are not counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.score import score
from eval.seg import CITYSCAPES, IGNORED, PRESETS, Segmentation, confusion, train_ids
from eval.values import Undefined

Labels = NDArray[np.uint8]
TWO = Segmentation(classes=("a", "b"))


def labels(seed: int, shape: tuple[int, ...] = (20, 30), classes: int = 19, share_ignored: float = 0.1) -> Labels:
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, classes, shape).astype(np.uint8)
    drawn[rng.random(shape) < share_ignored] = IGNORED
    return drawn


class TestByHand:
    # 3 right and 1 wrong of class 0, 2 wrong and 4 right of class 1
    REF = np.array([0, 0, 0, 0, 1, 1, 1, 1, 1, 1], np.uint8)
    GEN = np.array([0, 0, 0, 1, 0, 0, 1, 1, 1, 1], np.uint8)

    def test_confusion(self) -> None:
        assert confusion(self.REF, self.GEN, 2).tolist() == [[3, 1], [2, 4]]

    def test_score(self) -> None:
        found = score(TWO, [self.REF], [self.GEN])
        assert found.value == pytest.approx((3 / 6 + 4 / 7) / 2)
        assert found.others["mAcc"] == pytest.approx((3 / 4 + 4 / 6) / 2)
        assert found.others["share of right pixels"] == pytest.approx(0.7)
        assert (found.others["IoU a"], found.others["IoU b"]) == pytest.approx((3 / 6, 4 / 7))


class TestPeers:
    def test_confusion_equals_scikit_learn(self) -> None:
        sklearn = pytest.importorskip("sklearn.metrics")
        ref, gen = labels(1), labels(2, share_ignored=0)
        known = ref != IGNORED
        expected = sklearn.confusion_matrix(ref[known], gen[known], labels=range(19))
        assert np.array_equal(confusion(ref, gen, 19), expected)

    def test_means_equal_scikit_learn(self) -> None:
        """Its means are over the labels that occur on either side: those that torchmetrics' MeanIoU counts as 0."""
        sklearn = pytest.importorskip("sklearn.metrics")
        ref, gen = labels(1, classes=12), labels(2, classes=12, share_ignored=0)
        known = ref != IGNORED
        found = score(PRESETS["paper"], [ref], [gen])
        assert found.value == pytest.approx(sklearn.jaccard_score(ref[known], gen[known], average="macro"))
        assert found.others["mAcc"] == pytest.approx(sklearn.balanced_accuracy_score(ref[known], gen[known]))


class TestDataSet:
    def test_pictures_of_several_videos_make_one_confusion(self) -> None:
        metric = PRESETS["paper"]
        records = [metric.frame(labels(i), labels(i + 9, share_ignored=0)) for i in range(5)]
        together = metric.pool([*records[:2], *records[2:]])
        total = sum(record.counts for record in records)
        ious = [total[i, i] / (total[i].sum() + total[:, i].sum() - total[i, i]) for i in range(19)]
        assert together.value == pytest.approx(np.mean(ious))
        assert together.value != pytest.approx(np.mean([metric.pool(of).value for of in (records[:2], records[2:])]))

    def test_confusion_is_summed_not_means_averaged(self) -> None:
        ref = [np.array([0, 0, 0, 1], np.uint8), np.array([0, 1, 1, 1], np.uint8)]
        gen = [np.array([0, 0, 0, 0], np.uint8), np.array([1, 1, 1, 1], np.uint8)]
        found = score(TWO, ref, gen)
        assert found.value == pytest.approx((3 / 5 + 3 / 5) / 2)
        assert found.frames == pytest.approx((3 / 4 / 2, 3 / 4 / 2))

    @settings(deadline=None)
    @given(st.permutations(range(6)))
    def test_order_and_division_into_pictures_do_not_matter(self, order: list[int]) -> None:
        ref, gen = labels(3, (6, 50)), labels(4, (6, 50), share_ignored=0)
        metric = PRESETS["paper"]
        whole = metric.pool([metric.frame(ref, gen)])
        parts = metric.pool([metric.frame(ref[i], gen[i]) for i in order])
        assert parts.value == whole.value
        assert parts.others == whole.others


class TestAbsent:
    def test_neither_true_nor_predicted_is_undefined_and_left_out(self) -> None:
        found = score(PRESETS["paper"], [np.zeros((4, 4), np.uint8)], [np.zeros((4, 4), np.uint8)])
        assert found.value == 1
        assert found.others["IoU sky"] == Undefined("class is absent")
        assert found.others["mAcc"] == 1

    def test_predicted_but_nowhere_true_counts_zero_in_iou_alone(self) -> None:
        found = score(TWO, [np.array([0, 0, 0, 0], np.uint8)], [np.array([0, 0, 0, 1], np.uint8)])
        assert found.value == pytest.approx((3 / 4 + 0) / 2)
        assert found.others["mAcc"] == pytest.approx(3 / 4)

    def test_no_labelled_pixel(self) -> None:
        blank = np.full((4, 4), IGNORED, np.uint8)
        assert score(TWO, [blank], [blank]).value == Undefined("no pixel is labelled")
        assert TWO.pool([]).value == Undefined("no pixel is labelled")
        found = score(TWO, [blank, np.zeros((4, 4), np.uint8)], [blank, np.zeros((4, 4), np.uint8)])
        assert found.frames == (Undefined("no pixel is labelled"), 1.0)

    def test_ignored_pixels_do_not_count_whatever_is_predicted(self) -> None:
        ref = np.array([0, 1, IGNORED, IGNORED], np.uint8)
        assert score(TWO, [ref], [np.array([0, 1, 0, IGNORED], np.uint8)]).value == 1


def test_train_ids() -> None:
    assert len(CITYSCAPES) == 19
    ids = train_ids(np.arange(256, dtype=np.uint8))
    assert [int(ids[label]) for label in CITYSCAPES.values()] == list(range(19))
    assert np.count_nonzero(ids != IGNORED) == 19
    assert list(CITYSCAPES)[ids[26]] == "car"


def test_label_ids_on_either_side_or_both() -> None:
    ref, gen = labels(5), labels(6, share_ignored=0)
    of_train_id = np.append(list(CITYSCAPES.values()), np.zeros(256 - 19)).astype(np.uint8)  # 0: unlabelled
    expected = score(PRESETS["paper"], [ref], [gen])
    for metric, sides in (
        (PRESETS["label-ids"], (of_train_id[ref], of_train_id[gen])),
        (Segmentation(ref_label_ids=True), (of_train_id[ref], gen)),
        (Segmentation(gen_label_ids=True), (ref, of_train_id[gen])),
    ):
        assert score(metric, [sides[0]], [sides[1]]).others == expected.others


def test_real_labels_against_themselves_and_moved(kitti_drive: Path) -> None:
    import cv2

    sklearn = pytest.importorskip("sklearn.metrics")
    paths = sorted((kitti_drive / "semantic_gt").glob("*_labelIds.png"))
    ref = [train_ids(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)) for path in paths]
    assert len(ref) == 2
    assert score(PRESETS["paper"], ref, ref).value == 1
    known = np.stack(ref) != IGNORED
    moved = np.where(known, np.roll(np.stack(ref), 8, axis=2), 0).astype(np.uint8)
    moved[moved == IGNORED] = 0
    expected = sklearn.jaccard_score(np.stack(ref)[known], moved[known], average="macro")
    assert score(PRESETS["paper"], ref, list(moved)).value == pytest.approx(expected)
    assert 0 < expected < 1


class TestBroken:
    def test_shapes(self) -> None:
        with pytest.raises(MetricError, match=r"same shape on both sides, got \(2, 2\) and \(2, 3\)"):
            confusion(np.zeros((2, 2), np.uint8), np.zeros((2, 3), np.uint8), 19)

    def test_labels_are_no_classes(self) -> None:
        good, bad = np.zeros(2, np.uint8), np.array([0, 26], np.uint8)
        with pytest.raises(MetricError, match=r"true labels: expected 0 to 18 .* got \[26\] \(label ids"):
            confusion(bad, good, 19)
        with pytest.raises(MetricError, match=r"predicted labels: expected 0 to 18 .* got \[26\]"):
            confusion(good, bad, 19)

    def test_unlabelled_where_the_class_is_known(self) -> None:
        with pytest.raises(MetricError, match=r"predicted labels: .* got \[255\]"):
            confusion(np.zeros(2, np.uint8), np.full(2, IGNORED, np.uint8), 19)

    def test_kinds_of_numbers(self) -> None:
        with pytest.raises(MetricError, match="expected integers, got float64"):
            confusion(np.zeros(2), np.zeros(2, np.uint8), 19)
        with pytest.raises(MetricError, match="expected uint8"):
            train_ids(np.zeros(2, np.int64))  # type: ignore[arg-type]
