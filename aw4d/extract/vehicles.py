"""Vehicle instances of one frame from 3D boxes, and from clusters of laser returns where there is no box.

A box gives the silhouette of a generic car of its size: body, cabin and wheels, each a convex solid. That covers
windows and black paint, of which a laser sees nothing. The depth adds what the generic car lacks and takes away what
stands in front.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.calibrate.ground import GroundPlane
from aw4d.camera import Camera
from aw4d.extract.pixels import check_sizes, pixels_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ids = NDArray[np.int32]

CARS = frozenset({"car", "van"})
LARGE = frozenset({"truck", "bus", "tram", "trailer", "construction_vehicle", "construction"})
CLEARANCE = 0.20  # [m] between the road and a car's body
WHEEL_RADIUS = 0.32  # [m]
NEAR_PLANE = 0.1  # [m]
CELL = 0.25  # [m] side of the cells in which returns are gathered
AHEAD = 45.0  # [m] beyond it a car is a handful of returns
ASIDE = 8.0  # [m] beyond it the ground need not be level with the lane


def is_vehicle(box: Box) -> bool:
    """Whether a box is one of those that the plane `vehicle` knows."""
    return bool(set(box.category.lower().split(".")) & (CARS | LARGE))


def _snapped(box: Box, ground: GroundPlane | None, camera: Camera) -> Box:
    """The box with its underside on the ground, where it is within 0.4 m of it: drawn boxes float by a decimetre."""
    if ground is None:
        return box
    up = box.object_to_world[:3, 1]
    gap = float(ground.height(camera.to_camera(box.object_to_world[:3, 3] - up * box.size[1] / 2)))
    if abs(gap) > 0.4:
        return box
    pose = box.object_to_world.copy()
    pose[:3, 3] -= up * gap
    return Box(track_id=box.track_id, category=box.category, object_to_world=pose, size=box.size)


def _slab(front: float, rear: float, low: float, high: float, half_width: float) -> Array:
    return np.array([(x, y, z) for x in (front, rear) for y in (low, high) for z in (-half_width, half_width)])


def _solids(box: Box) -> list[Array]:
    """Corners, object frame [m], of the convex solids that make up a generic vehicle of the box's size."""
    length, height, width = box.size
    bottom = -height / 2
    floor = bottom + min(CLEARANCE, 0.15 * height)
    if set(box.category.lower().split(".")) & LARGE:
        return [_slab(length / 2, -length / 2, bottom + 0.15 * height, height / 2, width / 2), *_wheels(box)]
    belt = bottom + 0.58 * height
    body = np.concatenate(
        [
            _slab(0.50 * length, -0.50 * length, floor, bottom + 0.45 * height, 0.33 * width),
            _slab(0.40 * length, -0.42 * length, floor, bottom + 0.45 * height, 0.48 * width),
            _slab(0.46 * length, -0.48 * length, belt, belt, 0.42 * width),
        ]
    )
    cabin = np.concatenate(
        [
            _slab(0.25 * length, -0.48 * length, belt, belt, 0.45 * width),
            _slab(0.08 * length, -0.38 * length, height / 2, height / 2, 0.36 * width),
        ]
    )
    return [body, cabin, *_wheels(box)]


def _wheels(box: Box) -> list[Array]:
    length, height, width = box.size
    radius, half_width = min(WHEEL_RADIUS, 0.25 * height), min(0.1, 0.1 * width)
    turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    rim = [(radius * np.cos(t), radius * np.sin(t), z) for t in turn for z in (-half_width, half_width)]
    side = width / 2 - half_width
    hubs = [(x * length, radius - height / 2, z) for x in (-0.3, 0.3) for z in (-side, side)]
    return [np.array(rim) + np.array(hub) for hub in hubs]


def _outline(corners: Array, camera: Camera) -> NDArray[np.int32] | None:
    """Convex outline in the image [px] of a convex solid, camera frame, cut at the near plane; None if behind it."""
    front = corners[:, 2] > NEAR_PLANE
    if not front.any():
        return None
    visible = corners[front]
    if not front.all():
        a, b = np.repeat(visible, (~front).sum(), axis=0), np.tile(corners[~front], (front.sum(), 1))
        share = (a[:, 2] - NEAR_PLANE) / (a[:, 2] - b[:, 2])
        visible = np.concatenate([visible, a + share[:, None] * (b - a)])
    pixels = camera.project(visible)[:, :2]
    return np.asarray(cv2.convexHull(np.rint(np.clip(pixels, -1e6, 1e6)).astype(np.int32)), dtype=np.int32)


def _to_camera(local: Array, box: Box, camera: Camera) -> Array:
    return camera.to_camera(local @ box.object_to_world[:3, :3].T + box.object_to_world[:3, 3])


def _draw(solids: list[Array], box: Box, camera: Camera) -> Mask:
    canvas = np.zeros(camera.shape, np.uint8)
    for solid in solids:
        outline = _outline(_to_camera(solid, box, camera), camera)
        if outline is not None:
            cv2.fillConvexPoly(canvas, outline, 1)
    return canvas > 0


def _grown(box: Box, margin: float) -> Box:
    size = (box.size[0] + margin, box.size[1] + margin, box.size[2] + margin)
    return Box(track_id=box.track_id, category=box.category, object_to_world=box.object_to_world, size=size)


def _silhouette(box: Box, depth: NDArray[np.float32], surface: Array, height: Array, camera: Camera) -> Mask:
    """Pixels of one box's vehicle: the generic car and the surface in the box, without what stands before it."""
    length, tall, width = box.size
    whole = [_slab(length / 2, -length / 2, -tall / 2, tall / 2, width / 2)]
    hull = _draw(whole, box, camera)
    inside = _grown(box, 0.3).contains(camera.to_world(surface[hull])) & (height[hull] > 0.15)
    mask = _draw(_solids(box), box, camera)
    mask[hull] |= inside
    nearest = _to_camera(whole[0], box, camera)[:, 2].min()
    # The road before the car is nearer too; only what rises from it hides the car.
    return np.asarray(mask & ~((depth < nearest - 0.5) & (height > 0.3)), dtype=np.bool_)


def _clusters(points: Array, height: Array) -> Iterator[NDArray[np.int64]]:
    """Indices of the points of every car-sized thing that stands alone on the road."""
    near = (points[:, 2] > 0) & (points[:, 2] < AHEAD) & (np.abs(points[:, 0]) < ASIDE) & (height < 6)
    seen = np.flatnonzero(near)
    column, row = ((points[seen][:, [0, 2]] + (ASIDE, 0)) / CELL).astype(np.int64).T
    upright = height[seen] > 0.25
    grid = np.zeros((int(AHEAD / CELL) + 1, int(2 * ASIDE / CELL) + 1), np.uint8)
    grid[row[upright], column[upright]] = 1
    # Half a metre of ground around each thing tells what it stands on.
    spread = cv2.dilate(grid, np.ones((5, 5), np.uint8))
    label = cv2.connectedComponents(spread, connectivity=4)[1][row, column]
    on_road = np.abs(height[seen]) < 0.08 + 0.004 * points[seen, 2]
    for number in range(1, int(label.max(initial=0)) + 1):
        members = label == number
        body, base = seen[members & upright], members & ~upright
        if len(body) >= 30 and np.count_nonzero(base & on_road) > 0.6 * np.count_nonzero(base):
            yield body


def _fit_rectangle(plan: Array) -> tuple[float, Array, Array]:
    """Heading [rad], centre and sides [m] of the rectangle whose edges lie closest to the points, plan view (N, 2).

    Of a car one corner is seen, an L in plan view, which a rectangle of least area would cut across. The criterion
    is the closeness of Zhang et al. 2017 (Efficient L-shape fitting for vehicle detection using laser scanners).
    """
    best = (-np.inf, 0.0, np.zeros(2), np.zeros(2))
    for heading in np.deg2rad(np.arange(0, 90, 2)):
        axes = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        local = plan @ axes
        low, high = local.min(axis=0), local.max(axis=0)
        distance = np.minimum(local - low, high - local).min(axis=1)
        closeness = float(np.sum(1 / np.maximum(distance, 0.05)))
        if closeness > best[0]:
            best = (closeness, float(heading), axes @ (low + high) / 2, high - low)
    return best[1:]


def _cluster_box(points: Array, ground: GroundPlane, camera: Camera, track_id: int) -> Box | None:
    """Box around a cluster, on the ground, or None if it has not the size of a car.

    Where only the back of a car is seen, its length lies along the view.
    """
    heading, centre, sides = _fit_rectangle(points[:, [0, 2]])
    tall = float(ground.height(points).max())
    if not (1.2 <= sides.max() <= 5.5 and sides.min() <= 2.3 and 1.15 <= tall <= 2.0):
        return None
    axes = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    along = int(np.argmax(sides) if sides.max() > 2.5 else np.argmax(np.abs(axes @ centre)))
    forward = np.array([axes[along, 0], 0, axes[along, 1]])
    forward -= ground.normal * (forward @ ground.normal)
    forward /= np.linalg.norm(forward) * np.copysign(1, forward[2])
    middle = np.array([centre[0], 0, centre[1]])
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([forward, ground.normal, np.cross(forward, ground.normal)])
    pose[:3, 3] = middle + ground.normal * (tall / 2 - float(ground.height(middle)))
    size = (float(sides[along]), tall, float(sides[1 - along]))
    return Box(track_id=track_id, category="car", object_to_world=camera.camera_to_world @ pose, size=size)


def _tapers(points: Array, height: Array) -> bool:
    """Whether the top is narrower than the rest, as cars' cabins are and slabs, containers and hedges are not."""
    azimuth, tall = points[:, 0] / points[:, 2], height.max()
    top, rest = azimuth[height > 0.75 * tall], azimuth[height < 0.6 * tall]
    return bool(len(rest) > 0 and np.ptp(top) < 0.9 * np.ptp(rest))


def _is_foliage(points: Array, rgb: NDArray[np.uint8], camera: Camera) -> bool:
    """Whether the points' pixels are green on the whole: hedges come in the size of cars."""
    row, column, _ = pixels_of(points, camera)
    colour = rgb[row, column].astype(np.float64)
    red, green, blue = colour.sum(axis=0)
    return bool(2 * green - red - blue > 0.1 * (red + green + blue))


def _found(
    points: Array, ground: GroundPlane, camera: Camera, known: Sequence[Box], rgb: NDArray[np.uint8]
) -> list[Box]:
    """Boxes of clusters outside the known boxes, from left to right, numbered after them."""
    world = camera.to_world(points)
    free = np.ones(len(points), dtype=np.bool_)
    for box in known:
        free &= ~_grown(box, 1.0).contains(world)
    p = points[free]
    number = max((box.track_id for box in known), default=-1) + 1
    boxes: list[Box] = []
    height = ground.height(p)
    for members in sorted(_clusters(p, height), key=lambda m: float(np.mean(p[m, 0] / p[m, 2]))):
        found = _cluster_box(p[members], ground, camera, number + len(boxes))
        if found is None or _is_foliage(p[members], rgb, camera):
            continue
        if _tapers(p[members], height[members]):
            boxes.append(found)
    return boxes


def vehicle_ids(
    *,
    depth: NDArray[np.float32],
    camera: Camera,
    boxes: Sequence[Box] | None,
    points: NDArray[np.float32] | None,
    ground: GroundPlane | None,
    sky: Mask,
    rgb: NDArray[np.uint8],
) -> Ids:
    """Vehicle instance of every pixel.

    Parameters
    ----------
    depth
        Dense metric depth, (H, W) [m].
    camera
        The frame's camera.
    boxes
        3D boxes in the world, of any category; those of cars, vans, trucks, buses, trams and trailers count.
    points
        Laser returns in the camera frame [m], (N, 3), or None: then the depth plane is searched for clusters.
    ground
        Plane of the lane ahead, or None: then boxes are taken as they are and no clusters are sought.
    sky
        (H, W) mask; it is never a vehicle.
    rgb
        Recorded image, (H, W, 3) sRGB, uint8.

    Returns
    -------
    (H, W) int32: 0 for none, track_id + 1 for a vehicle with a box; vehicles found without a box follow, numbered
    from left to right in each frame (so these alone are not the same number in every frame).

    Raises
    ------
    InputError
        A plane is not of the camera's size.
    """
    check_sizes(camera, depth=depth, sky=sky, rgb=rgb)
    surface = camera.unproject(depth)
    known = [_snapped(box, ground, camera) for box in boxes or () if is_vehicle(box)]
    height = np.full(depth.shape, np.inf)
    if ground is not None:
        height = ground.height(surface)
        cloud = surface[::3, ::3][~sky[::3, ::3]] if points is None else points.astype(np.float64)
        known += _found(cloud, ground, camera, known, rgb)
    ids = np.zeros(depth.shape, dtype=np.int32)
    eye = camera.camera_to_world[:3, 3]
    for box in sorted(known, key=lambda b: -float(np.linalg.norm(b.object_to_world[:3, 3] - eye))):
        ids[_silhouette(box, depth, surface, height, camera) & ~sky] = box.track_id + 1
    return ids
