"""Cars: where they are at a time, the solids they are made of, and their exact boxes.

A car is described once, on a template of unit proportions (metres of a middle-sized car), and scaled. Template axes: x
forward, y up from the ground, z right, origin on the ground under the middle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from random import Random

import numpy as np
from numpy.typing import NDArray

from aw4d.street.parts import Material, Part
from aw4d.street.shapes import Point, Quadric, Solid, box_planes, rod

HALF_LENGTH, BELT, HALF_WIDTH = 2.2, 0.93, 0.86  # of the template's body [m]
MIRROR_REACH = 1.0  # half of the width that is claimed by the box: the mirrors stick out of the body
WHEEL_X, WHEEL_RADIUS = 1.36, 0.33
SLACK = 0.002  # [m] of a box, so that points on the car's outermost faces stay inside in single precision

PAINTS: tuple[Point, ...] = (
    (0.62, 0.63, 0.64),
    (0.75, 0.75, 0.73),
    (0.035, 0.037, 0.042),
    (0.22, 0.23, 0.25),
    (0.45, 0.03, 0.025),
    (0.03, 0.09, 0.28),
    (0.38, 0.40, 0.42),
    (0.05, 0.17, 0.14),
    (0.52, 0.38, 0.18),
)


@dataclass(frozen=True)
class Style:
    """Side view of a cabin on the template: x of the four corners and height of the roof [m]."""

    screen_foot: float
    screen_top: float
    rear_top: float
    rear_foot: float
    roof: float
    hood: float
    tail: float


STYLES = (
    Style(0.95, 0.22, -0.95, -1.62, 1.44, 0.74, 0.90),  # saloon
    Style(1.05, 0.32, -1.55, -2.02, 1.50, 0.78, 0.93),  # hatchback
    Style(1.00, 0.42, -1.80, -2.10, 1.68, 0.88, 0.93),  # tall estate
)


@dataclass(frozen=True)
class Car:
    """One car at one time: ground position, heading (+1 along world x), scale, style, paint, identity."""

    track: int
    x: float
    z: float
    heading: int
    scale: Point
    style: int
    paint: Point

    @property
    def size(self) -> tuple[float, float, float]:
        """Length, height and width of the box [m], with `SLACK` on every side; the width includes the mirrors."""
        sx, sy, sz = self.scale
        tight = 2 * HALF_LENGTH * sx, STYLES[self.style].roof * sy, 2 * MIRROR_REACH * sz
        return tight[0] + 2 * SLACK, tight[1] + 2 * SLACK, tight[2] + 2 * SLACK

    @property
    def object_to_world(self) -> NDArray[np.float64]:
        """Pose of the box: x forward, y up, z right, origin at its centre."""
        pose = np.diag([float(self.heading), 1.0, float(self.heading), 1.0])
        pose[:3, 3] = self.x, self.size[1] / 2 - SLACK, self.z
        return pose


def random_car(track: int, x: float, z: float, heading: int) -> Car:
    """A car whose size, style and paint follow from its track number."""
    random = Random(track * 7919 + 5)
    style = random.choices((0, 1, 2), (4, 4, 3))[0]
    scale = (random.uniform(0.93, 1.06), random.uniform(0.97, 1.05), random.uniform(0.97, 1.03))
    return Car(track, x, z, heading, scale, style, PAINTS[int(random.random() * len(PAINTS))])


def car_parts(car: Car) -> list[Part]:
    """The solids of a car, placed in the world."""
    style = STYLES[car.style]
    solids = [(_body(style), Material.CAR_BODY), (_cabin(style), Material.CAR_CABIN)]
    for x in (WHEEL_X, -WHEEL_X):
        for side in (-1, 1):
            hub = (x, WHEEL_RADIUS, side * (HALF_WIDTH + 0.012))
            solids.append((rod((x, WHEEL_RADIUS, side * 0.6), hub, WHEEL_RADIUS), Material.WHEEL))
    for side in (-1, 1):
        z0, z1 = sorted((side * 0.80, side * 0.99))
        low, high = (style.screen_foot - 0.28, 0.93, z0), (style.screen_foot - 0.12, 1.05, z1)
        solids.append((Solid((low, high), box_planes(low, high)), Material.METAL))
    return [
        Part(
            shape=_place(solid, car),
            material=material,
            colour=car.paint,
            origin=(car.x, 0.0, car.z),
            heading=car.heading,
            size=car.scale,
            seed=car.style,
            vehicle=car.track,
        )
        for solid, material in solids
    ]


def _plane(x0: float, y0: float, x1: float, y1: float) -> tuple[Point, float]:
    """Plane across the car through two points of the side view; the car lies to the right of the way from 0 to 1."""
    n = np.array([-(y1 - y0), x1 - x0])
    n /= np.hypot(*n)
    return (float(n[0]), float(n[1]), 0.0), float(n @ (x0, y0))


def _body(style: Style) -> Solid:
    """Lower body: hood, tail, chamfered bumpers, and rounded corners."""
    low, high = (-HALF_LENGTH, 0.20, -HALF_WIDTH), (HALF_LENGTH, 0.97, HALF_WIDTH)
    foot = style.screen_foot
    planes = (
        *box_planes(low, high),
        _plane(foot - 0.1, 0.965, HALF_LENGTH - 0.15, style.hood),
        _plane(HALF_LENGTH - 0.28, style.hood + 0.02, HALF_LENGTH, 0.56),
        _plane(HALF_LENGTH, 0.40, HALF_LENGTH - 0.20, 0.20),
        _plane(-HALF_LENGTH, 0.60, -HALF_LENGTH + 0.10, style.tail),
        _plane(-HALF_LENGTH + 0.18, 0.20, -HALF_LENGTH, 0.42),
        ((0.0, 0.20, 0.98), 0.98 * HALF_WIDTH + 0.20 * 0.70),
        ((0.0, 0.20, -0.98), 0.98 * HALF_WIDTH + 0.20 * 0.70),
    )
    return Solid((low, high), planes, (_plan(1.0),))


def _plan(share: float) -> Quadric:
    """Elliptic cylinder that rounds a car's corners seen from above."""
    return Quadric((0.0, 0.0, 0.0), ((1 / (2.66 * share), 0.0, 0.0), (0.0, 0.0, 1 / (0.985 * share))))


def _cabin(style: Style) -> Solid:
    """Glass house: slanted screens, sides that lean in, and an ellipsoid that crowns the roof."""
    low, high = (style.rear_foot, 0.90, -0.80), (style.screen_foot, style.roof, 0.80)
    lean = math.atan2(0.17, style.roof - BELT)
    planes = (
        *box_planes(low, high),
        _plane(style.screen_top, style.roof, style.screen_foot, BELT),
        _plane(style.rear_foot, BELT, style.rear_top, style.roof),
        ((0.0, math.sin(lean), math.cos(lean)), math.cos(lean) * 0.79 + math.sin(lean) * BELT),
        ((0.0, math.sin(lean), -math.cos(lean)), math.cos(lean) * 0.79 + math.sin(lean) * BELT),
    )
    middle = (style.screen_top + style.rear_top) / 2
    crown = Quadric(
        (middle, 0.0, 0.0), ((1 / 3.6, 0.0, 0.0), (0.0, 1 / (style.roof + 0.01), 0.0), (0.0, 0.0, 1 / 1.45))
    )
    return Solid((low, high), planes, (crown, _plan(0.93)))


def _place(solid: Solid, car: Car) -> Solid:
    """Scale a solid of the template, turn it to the car's heading and move it to the car's place."""
    scale = np.array(car.scale) * (car.heading, 1, car.heading)
    centre = np.array([car.x, 0.0, car.z])

    def point(p: Point) -> Point:
        moved = np.array(p) * scale + centre
        return float(moved[0]), float(moved[1]), float(moved[2])

    def plane(n: Point, offset: float) -> tuple[Point, float]:
        turned = np.array(n) / scale
        length = float(np.linalg.norm(turned))
        turned /= length
        return (float(turned[0]), float(turned[1]), float(turned[2])), offset / length + float(turned @ centre)

    def quadric(q: Quadric) -> Quadric:
        rows = np.array(q.rows) / scale
        return Quadric(point(q.centre), tuple((float(r[0]), float(r[1]), float(r[2])) for r in rows))

    corners = np.sort([point(p) for p in solid.bounds], axis=0)
    low, high = ((float(c[0]), float(c[1]), float(c[2])) for c in corners)
    return Solid((low, high), tuple(plane(n, d) for n, d in solid.planes), tuple(quadric(q) for q in solid.quadrics))
