"""Identity: crops of boxes, and how their similarities are averaged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from eval.errors import MetricError
from eval.identity import Identity, by_frame, similarities
from eval.values import Undefined, Value

Picture = NDArray[np.uint8]
PLAIN = Identity(padding=0, min_side=1)


def picture(seed: int = 0, height: int = 60, width: int = 100) -> Picture:
    """A random picture."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def mean_colours(crops: Sequence[Picture]) -> NDArray[np.float64]:
    """Stands for a model: features (N, 3)."""
    return np.array([crop.mean(axis=(0, 1)) for crop in crops])


def halves(crops: Sequence[Picture]) -> NDArray[np.float64]:
    """Stands for a model of patches: features (N, 2, 3)."""
    return np.array([[part.mean(axis=(0, 1)) for part in np.array_split(crop, 2, axis=1)] for crop in crops])


def test_a_crop_is_the_pixels_whose_centres_the_box_holds() -> None:
    source = picture()
    crop = PLAIN.crop(source, (10, 20, 40, 45))
    assert np.array_equal(crop, source[20:46, 10:41])


def test_padding_is_a_share_of_each_side() -> None:
    source = picture()
    crop = Identity(padding=0.1, min_side=1).crop(source, (20, 20, 60, 40))
    assert np.array_equal(crop, source[18:43, 16:65])


def test_a_square_is_as_wide_as_the_longer_side() -> None:
    crop = Identity(padding=0, square=True, min_side=1).crop(picture(), (30, 20, 60, 40))
    assert not isinstance(crop, Undefined)
    assert crop.shape == (31, 31, 3)


def test_a_crop_ends_where_the_picture_does() -> None:
    source = picture()
    assert np.array_equal(PLAIN.crop(source, (-30, 40, 20, 90)), source[40:, :21])


@pytest.mark.parametrize(
    ("box", "reason"),
    [
        ((10, 10, 30, 90), "box under 32 px"),
        ((-40, 0, 20, 59), "box under 32 px"),  # 60 px wide, of which 20 are seen
        ((120, 10, 200, 50), "box outside the picture"),
    ],
)
def test_boxes_that_show_too_little_are_undefined(box: tuple[float, ...], reason: str) -> None:
    assert Identity().crop(picture(), box) == Undefined(reason)
    assert Identity().frame(picture(), picture(), [box], mean_colours) == (Undefined(reason),)


@pytest.mark.parametrize("box", [(1, 2, 3), (5, 5, 5, 9), (9, 0, 3, 5), (0, 0, np.nan, 5)])
def test_a_box_that_is_none_is_refused(box: tuple[float, ...]) -> None:
    with pytest.raises(MetricError, match=r"box: expected \(left, top, right, bottom\)"):
        PLAIN.crop(picture(), box)


def test_the_same_picture_is_the_same_vehicle_exactly() -> None:
    source = picture()
    boxes = [(3, 4, 40, 44), (50, 10, 95, 55)]
    for encode in (mean_colours, halves):
        assert PLAIN.frame(source, source.copy(), boxes, encode) == (1.0, 1.0)


def test_boxes_keep_their_order_past_those_that_are_undefined() -> None:
    ref = picture()
    gen = ref.copy()
    gen[10:50, 50:90] = (0, 0, 255)
    found = Identity(padding=0).frame(ref, gen, [(0, 0, 40, 40), (0, 0, 5, 5), (50, 10, 89, 49)], mean_colours)
    assert found[0] == 1
    assert found[1] == Undefined("box under 32 px")
    assert isinstance(found[2], float)
    assert found[2] < 0.9


def test_pictures_of_two_sizes_are_refused() -> None:
    with pytest.raises(MetricError, match="two of one size"):
        PLAIN.frame(picture(), picture(width=90), [], mean_colours)


def test_patches_are_compared_place_by_place() -> None:
    a = np.array([[[1.0, 0.0], [0.0, 1.0]]])
    assert similarities(a, a) == (1.0,)
    assert similarities(a, a[:, ::-1]) == (0.0,)
    assert similarities(a.mean(axis=1), a[:, ::-1].mean(axis=1)) == (1.0,)  # which a feature of the whole cannot see


def test_features_of_two_shapes_are_refused() -> None:
    with pytest.raises(MetricError, match="features: expected two of"):
        similarities(np.zeros((2, 3)), np.zeros((2, 4)))


RECORDS: list[list[Value]] = [[1.0, 0.5, 0.0], [0.9], [], [Undefined("box under 32 px")]]


def test_the_mean_is_of_boxes_or_of_frames() -> None:
    boxes, frames = (Identity(mean_per=of).pool(RECORDS) for of in ("box", "frame"))  # type: ignore[arg-type]
    assert boxes.value == frames.others["mean of boxes"] == pytest.approx(0.6)
    assert frames.value == boxes.others["mean of frames"] == pytest.approx(0.7)
    assert boxes.frames == (1.0, 0.5, 0.0, 0.9, Undefined("box under 32 px"))
    assert frames.frames[2:] == (Undefined("no box in the frame"),) * 2
    assert boxes.others["boxes"] == 5
    assert boxes.others["boxes undefined"] == 1


@pytest.mark.parametrize("records", [[], [[], []], [[Undefined("box outside the picture")]]])
def test_without_a_box_there_is_no_score(records: list[list[Value]]) -> None:
    assert Identity().pool(records).value == Undefined("no box to compare")


def test_values_are_gathered_by_frame() -> None:
    assert by_frame([0.1, 0.2, 0.3], np.array([1, 0, 1])) == [[0.2], [0.1, 0.3]]
    assert by_frame([], np.array([], dtype=int)) == []
