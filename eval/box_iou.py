"""IoU of 3D boxes in the picture: corners through K, smallest upright rectangle, intersection over union."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from eval.boxes import Array, Box3D, Camera, kind
from eval.errors import MetricError
from eval.score import Score, pooled
from eval.values import Undefined, Value, mean

NEAR = 0.1  # [m]; nothing that a driving camera records is closer to it

UNSEEN = Undefined("box is not in the picture")
EMPTY = Undefined("no box in the picture")

_FACES = ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))


class Rectangle(NamedTuple):
    """Upright rectangle [px]."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def area(self) -> float:
        """Width times height [px^2]; 0 where one of them is negative.

        >>> Rectangle(1, 2, 4, 4).area
        6
        """
        return max(self.right - self.left, 0) * max(self.bottom - self.top, 0)


def projected(corners: ArrayLike, K: ArrayLike) -> Rectangle | Undefined:
    """Rectangle about the eight projected corners, as the paper prints it: nothing is clipped.

    (u, v) = (x / z, y / z) with (x, y, z) = K X. A corner behind the camera (z < 0) lands on the other side of the
    principal point, and the rectangle is then not that of the object.

    Parameters
    ----------
    corners
        Camera frame, (8, 3) [m].
    K
        Intrinsic matrix, (3, 3) [px].

    >>> from eval.boxes import cuboid
    >>> K = [[100, 0, 50], [0, 100, 50], [0, 0, 1]]
    >>> pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]
    >>> projected(cuboid(pose, (2, 2, 2)), K)  # the near face, at 4 m
    Rectangle(left=25.0, top=25.0, right=75.0, bottom=75.0)
    """
    points = np.asarray(corners, dtype=np.float64)
    if (points[:, 2] == 0).any():
        return Undefined("a corner is in the plane of the camera")
    return _bounds(points, np.asarray(K, dtype=np.float64))


def visible(corners: ArrayLike, camera: Camera, near: float = NEAR) -> Rectangle | Undefined:
    """Rectangle about the part of a box that is beyond the near plane and in the picture.

    The six faces are cut by the near plane and by the four planes through the eye and the picture's sides; u and v are
    largest and smallest at the vertices of what is left (Sutherland & Hodgman 1974). Cutting the faces is enough,
    although the camera may be in the box: a ray that starts inside leaves through a face, at the same pixel. This is
    not the projected rectangle clamped to the picture: what widens that may be out of the picture altogether.

    The picture is [0, width] x [0, height], as nuScenes' and Omni3D's tools have it. With pixel centres at integers
    it would be half a pixel to the left and up, on both sides of the comparison.

    Parameters
    ----------
    corners
        Camera frame, (8, 3) [m], in the order of `Box3D.corners`.
    camera
        K and size of the picture.
    near
        Distance of the near plane [m], positive.

    Returns
    -------
    Rectangle [px]; Undefined where no part of the box, of more than no area, is in the picture.

    >>> from eval.boxes import cuboid
    >>> camera = Camera(K=np.array([[1000, 0, 640], [0, 1000, 352], [0, 0, 1]]), width=1280, height=704)
    >>> beside = np.eye(4)
    >>> beside[:3, 3] = 2.5, 0.9, 2  # a car that the camera passes: its rear is 25 cm behind the lens
    >>> [round(side, 1) for side in visible(cuboid(beside, (2, 1.6, 4.5)), camera)]
    [992.9, 375.5, 1280.0, 704.0]
    """
    points = np.asarray(corners, dtype=np.float64)
    planes = _frustum(camera, near)
    outside = points @ planes[:, :3].T + planes[:, 3] < 0
    if outside.all(axis=0).any():
        return UNSEEN
    if outside.any():
        points = np.concatenate([_cut(points[list(face)], planes) for face in _FACES])
    if not len(points):
        return UNSEEN
    rectangle = _bounds(points, camera.K)
    return rectangle if rectangle.area > 0 else UNSEEN


def iou(a: Rectangle, b: Rectangle) -> Value:
    """Area of the intersection over area of the union, 0 to 1; Undefined where neither has an area.

    >>> iou(Rectangle(0, 0, 2, 2), Rectangle(1, 0, 3, 2))
    0.3333333333333333
    """
    common = Rectangle(max(a.left, b.left), max(a.top, b.top), min(a.right, b.right), min(a.bottom, b.bottom)).area
    union = a.area + b.area - common
    return float(common / union) if union > 0 else Undefined("rectangles have no area")


def _bounds(points: Array, K: Array) -> Rectangle:
    pixels = points @ K.T
    u, v = pixels[:, 0] / pixels[:, 2], pixels[:, 1] / pixels[:, 2]
    return Rectangle(float(u.min()), float(v.min()), float(u.max()), float(v.max()))


def _frustum(camera: Camera, near: float) -> Array:
    """Planes (a, b, c, d), a x + b y + c z + d >= 0 in the picture: near, left, right, top, bottom; (5, 4)."""
    across, down, forward = camera.K
    sides = np.stack([forward, across, camera.width * forward - across, down, camera.height * forward - down])
    return np.column_stack([sides, [-near, 0, 0, 0, 0]])


def _cut(polygon: Array, planes: Array) -> Array:
    """What all planes leave of a convex polygon, (n, 3)."""
    for plane in planes:
        distance = polygon @ plane[:3] + plane[3]
        inside = distance >= 0
        if inside.all():
            continue
        crossing = inside != np.roll(inside, -1)
        here, there = distance[crossing], np.roll(distance, -1)[crossing]
        edges = (np.roll(polygon, -1, axis=0) - polygon)[crossing]
        cuts = polygon[crossing] + (here / (here - there))[:, None] * edges
        places = np.concatenate([np.flatnonzero(inside), np.flatnonzero(crossing) + 0.5])
        polygon = np.concatenate([polygon[inside], cuts])[np.argsort(places)]
    return polygon


@dataclass(frozen=True)
class Match:
    """What became of one frame's boxes."""

    ious: tuple[float, ...]  # of the pairs
    missed: int  # boxes of the reference without a partner
    extra: int  # boxes of the generated side without a partner
    unseen: int  # boxes of both sides that are not in the picture
    unsure: int = 0  # detections of both sides under the least score

    @property
    def values(self) -> tuple[float, ...]:
        """One number a pair, and 0 for each box without a partner."""
        return self.ious + (0.0,) * (self.missed + self.extra)


@dataclass(frozen=True)
class BoxIoU:
    """Structural consistency by boxes: mean IoU over pairs of boxes and boxes without a partner, which count 0.

    What moves the number: boxes that reach behind the camera (`clip`), which boxes are compared (`kind`, `min_score`),
    and whether boxes without a partner count. `Score.others` has the mean over pairs alone.

    Parameters
    ----------
    clip
        Rectangles of what is visible; False: of all eight corners, as printed, also of those behind the camera.
    near
        Near plane [m], where boxes are clipped.
    kind
        Compare only boxes of this kind, see `eval.boxes.kind`; None: all, and boxes pair only within their kind.
    pairing
        "id": the same identity on both sides; "iou": the pairs of each kind that have the largest sum of IoU (Kuhn
        1955), of which those that do not touch are none; None: by identity where every box of the frame has one.
    min_score
        Detections of a lower score are left out, and counted; boxes without a score stay. None: all stay.
    """

    clip: bool = True
    near: float = NEAR
    kind: str | None = None
    pairing: Literal["id", "iou"] | None = None
    min_score: float | None = None

    def rectangle(self, box: Box3D, camera: Camera) -> Rectangle | Undefined:
        """The box in the picture under this convention."""
        return visible(box.corners, camera, self.near) if self.clip else projected(box.corners, camera.K)

    def match(self, ref: Sequence[Box3D], gen: Sequence[Box3D], camera: Camera) -> Match:
        """Pair the boxes of one frame.

        Raises
        ------
        MetricError
            They pair by identity, and a box has none or two boxes of one side share one.
        """
        ref, gen = self._of_kind(ref), self._of_kind(gen)
        found = len(ref) + len(gen)
        ref, gen = self._sure(ref), self._sure(gen)
        ref_seen, gen_seen = self._seen(ref, camera), self._seen(gen, camera)
        named = all(box.track_id is not None for box in (*ref, *gen))
        pair = _pair_by_id if self.pairing == "id" or (self.pairing is None and named) else _pair_by_iou
        ious = pair(ref_seen, gen_seen)
        return Match(
            ious=tuple(ious),
            missed=len(ref_seen) - len(ious),
            extra=len(gen_seen) - len(ious),
            unseen=len(ref) + len(gen) - len(ref_seen) - len(gen_seen),
            unsure=found - len(ref) - len(gen),
        )

    def _of_kind(self, boxes: Sequence[Box3D]) -> list[Box3D]:
        return [box for box in boxes if self.kind in (None, kind(box.category))]

    def _sure(self, boxes: Sequence[Box3D]) -> list[Box3D]:
        least = self.min_score
        return [box for box in boxes if least is None or box.score is None or box.score >= least]

    def _seen(self, boxes: Sequence[Box3D], camera: Camera) -> list[tuple[Box3D, Rectangle]]:
        rectangles = [(box, self.rectangle(box, camera)) for box in boxes]
        return [(box, rectangle) for box, rectangle in rectangles if not isinstance(rectangle, Undefined)]

    def pool(self, matches: Sequence[Match]) -> Score:
        """Mean over all boxes of all frames; `frames` has the mean of each frame."""
        frames = tuple(mean(match.values) if match.values else EMPTY for match in matches)
        pairs = [value for match in matches for value in match.ious]
        values = [value for match in matches for value in match.values]
        return Score(
            value=mean(values) if values else EMPTY,
            frames=frames,
            others={
                "mean over pairs": mean(pairs) if pairs else Undefined("no box has a partner"),
                "mean of frames": mean(frames),
                "pairs": float(len(pairs)),
                "missed boxes": float(sum(match.missed for match in matches)),
                "extra boxes": float(sum(match.extra for match in matches)),
                "boxes not in the picture": float(sum(match.unseen for match in matches)),
                "boxes under the least score": float(sum(match.unsure for match in matches)),
            },
        )

    def summands(self, matches: Sequence[Match]) -> Array:
        """IoU and boxes, those without a partner too."""
        return np.array([(sum(match.values), len(match.values)) for match in matches], dtype=np.float64)

    def of_sums(self, sums: Array) -> Value:
        """Mean over all boxes."""
        return float(sums[0] / sums[1]) if sums[1] else EMPTY


PRESETS: dict[str, BoxIoU] = {"clipped": BoxIoU(), "paper": BoxIoU(clip=False, kind="vehicle")}


def box_iou(
    ref: Mapping[str, Sequence[Box3D]],
    gen: Mapping[str, Sequence[Box3D]],
    cameras: Mapping[str, Camera],
    convention: BoxIoU = PRESETS["clipped"],
    *,
    frames: Collection[str] | None = None,
) -> Score:
    """Mean IoU of two sets of boxes of one video.

    Parameters
    ----------
    ref, gen
        Boxes by frame; a frame that is absent has none.
    cameras
        Camera of each frame to compare, in order.
    convention
        How boxes become rectangles and pairs.
    frames
        Compare only these of the cameras' frames, and only their boxes; None: all.

    Raises
    ------
    MetricError
        There are boxes of a frame that has no camera, boxes do not pair by identity as they should, or categories are
        numbers where their names are needed.
    """
    if frames is not None:
        ref, gen = ({name: boxes for name, boxes in side.items() if name in frames} for side in (ref, gen))
        cameras = {name: camera for name, camera in cameras.items() if name in frames}
    for side, boxes in (("reference", ref), ("generated", gen)):
        strangers = [frame for frame in boxes if frame not in cameras]
        if strangers:
            raise MetricError(
                f"boxes, {side}: expected frames {_some(list(cameras))}, got boxes of {len(strangers)} others: "
                f"{_some(strangers)}"
            )
    _check_categories(ref, gen, convention)
    matches = [convention.match(ref.get(frame, ()), gen.get(frame, ()), camera) for frame, camera in cameras.items()]
    return pooled(convention, matches)


_Side = Mapping[str, Sequence[Box3D]]


def _check_categories(ref: _Side, gen: _Side, convention: BoxIoU) -> None:
    """Numbers of categories, as detectors have them, are of no kind, and never what the other side names."""
    sides = {"reference": _categories(ref), "generated": _categories(gen)}
    named = any(not _is_number(name) for names in sides.values() for name in names)
    if convention.kind is None and (not named or convention.pairing == "id"):
        return
    for side, names in sides.items():
        numbers = [name for name in names if _is_number(name)]
        if numbers:
            raise MetricError(
                f"boxes, {side}: expected categories by name, to compare {convention.kind or 'each with its like'}, "
                f"got numbers: {_some(numbers)} (--categories gives their names)"
            )


def _categories(boxes: _Side) -> list[str]:
    return sorted({box.category for found in boxes.values() for box in found})


def _is_number(category: str) -> bool:
    return category.removeprefix("-").isdecimal()


def _some(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 4 else f"{names[0]}, {names[1]} … {names[-1]}"


_Seen = Sequence[tuple[Box3D, Rectangle]]


def _pair_by_id(ref: _Seen, gen: _Seen) -> list[float]:
    ours, theirs = _by_id(ref), _by_id(gen)
    return [_iou_of_pair(ours[name], theirs[name]) for name in ours if name in theirs]


def _by_id(boxes: _Seen) -> dict[str, Rectangle]:
    ids = [box.track_id for box, _ in boxes]
    repeated = [name for name, count in Counter(ids).items() if count > 1 and name is not None]
    if None in ids or repeated:
        raise MetricError(f"boxes: expected identities, each once in a frame, got {[str(name) for name in ids]}")
    return {str(box.track_id): rectangle for box, rectangle in boxes}


def _pair_by_iou(ref: _Seen, gen: _Seen) -> list[float]:
    ious: list[float] = []
    for name in dict.fromkeys(kind(box.category) for box, _ in ref):
        ours = [rectangle for box, rectangle in ref if kind(box.category) == name]
        theirs = [rectangle for box, rectangle in gen if kind(box.category) == name]
        table = np.array([[_iou_of_pair(a, b) for b in theirs] for a in ours]).reshape(len(ours), len(theirs))
        chosen = table[linear_sum_assignment(table, maximize=True)]
        ious += [float(value) for value in chosen if value > 0]
    return ious


def _iou_of_pair(a: Rectangle, b: Rectangle) -> float:
    value = iou(a, b)
    return 0.0 if isinstance(value, Undefined) else value
