"""Plan of the street: what stands where.

World axes: x along the road (the way the camera drives), y up, z to the right of it; metres. The road's surface is
y = 0 and its middle z = 0. The street is a loop: what stands at x stands at x + `LOOP` too, so that a drive of any
length sees the same street again.
"""

from __future__ import annotations

import math
from functools import lru_cache
from random import Random

from aw4d.street.cars import Car, car_parts, random_car
from aw4d.street.houses import house
from aw4d.street.parts import Material, Part
from aw4d.street.plants import hedge, tree
from aw4d.street.shapes import Point, Solid, box, box_planes, ellipsoid, rod

SPEED = 10.0  # [m/s] of the camera, and of the cars on average
RATE = 10.0  # frames a second
BLOCK = 120.0  # from crossing to crossing [m]
LOOP = 2 * BLOCK
CROSSING = 100.0  # x of the first crossing's middle [m]
CROSSING_HALF = 4.5
ROAD_HALF = 5.5  # from the middle of the road to the kerb [m]
LANE_EDGE = 3.3  # from the middle of the road to the parked cars [m]
EGO_Z = 1.7  # middle of the camera's lane
KERB = 0.12  # height of the pavement [m]
FRONT = 9.2  # from the middle of the road to the house fronts [m]
GROUND_END = 1500.0  # the earth ends here: a horizon with a finite depth [m]
BEHIND, AHEAD = 45.0, 300.0  # what is built around the camera [m]; behind it for the shadows
LAMP_STEP, LAMP_HEIGHT = 24.0, 7.4
FIRST_LAMP = 10.0  # x of one on the right; the step divides a block, so all stay clear of the crossings
TREE_STEP, FIRST_TREE = 12.0, 7.5  # along a block; midway between the lamps
FIRST_PARKED, FIRST_COPY = 100, 20
CORNER = 1.6  # cut off the pavement's corners [m]


def ego_x(index: int) -> float:
    """World x of the camera in a frame [m]; the loop brings it back."""
    return (index * SPEED / RATE) % LOOP


def _blocks() -> range:
    """Numbers of the blocks that any frame can see: block b lies between the crossings b - 1 and b."""
    first = math.floor((-BEHIND - CROSSING) / BLOCK) + 1
    last = math.ceil((LOOP + AHEAD - CROSSING) / BLOCK) + 1
    return range(first, last + 1)


def _block_span(block: int) -> tuple[float, float]:
    """World x of a block's ends: the kerbs of the crossing streets."""
    start = CROSSING + (block - 1) * BLOCK + CROSSING_HALF
    return start, start + BLOCK - 2 * CROSSING_HALF


@lru_cache(maxsize=1)
def static_parts() -> tuple[Part, ...]:
    """Everything that stands still, in every block."""
    parts = _ground()
    for block in _blocks():
        for side in (-1, 1):
            parts += _houses(block, side) + _plants(block, side)
            parts += _furniture(block, side)
        parts += _signals(block)
    for number, (x, side) in enumerate(_lamp_places(), start=1):
        parts += _lamp(number, x, side)
    for car in parked_cars():
        parts += car_parts(car)
    return tuple(parts)


def _ground() -> list[Part]:
    """The road, and a raised slab with cut corners for each block and side."""
    end = GROUND_END
    low, high = (-200.0, -1.0, -400.0), (end, 0.0, 400.0)
    parts = [Part(shape=Solid((low, high), box_planes(low, high)), material=Material.ASPHALT)]
    for block in _blocks():
        x0, x1 = _block_span(block)
        for side in (-1, 1):
            parts.append(Part(shape=_slab(x0, x1, side), material=Material.PAVEMENT, origin=(x0, 0.0, 0.0)))
    return parts


def _slab(x0: float, x1: float, side: int) -> Solid:
    z0, z1 = sorted((side * ROAD_HALF, side * 400.0))
    low, high = (x0, -1.0, z0), (x1, KERB, z1)
    diagonal = math.sqrt(0.5)
    cuts = tuple(
        ((sign * diagonal, 0.0, -side * diagonal), diagonal * (sign * x - ROAD_HALF - CORNER))
        for sign, x in ((-1, x0), (1, x1))
    )
    return Solid((low, high), box_planes(low, high) + cuts)


def _houses(block: int, side: int) -> list[Part]:
    """A row of houses between two crossings, with an alley here and there."""
    random = Random((block % 2) * 2 + (side > 0) + 40)
    x0, x1 = _block_span(block)
    x, end = x0 + 3.6, x1 - 3.6
    parts: list[Part] = []
    while end - x > 6:
        width = random.uniform(8.0, 12.5)
        if end - x - width < 7:
            width = end - x
        front = FRONT + random.choice((0.0, 0.0, 0.0, 1.6))
        parts += house(x, x + width, side, front, KERB, random)
        if front > FRONT:
            parts += hedge(x + 0.3, x + width - 0.3, side * (FRONT + 0.5), KERB, random)
        x += width + random.choice((0.0, 0.0, 3.0))
    return parts


def _plants(block: int, side: int) -> list[Part]:
    """Street trees, midway between the lamps."""
    random = Random((block % 2) * 2 + (side > 0) + 900)
    x0, x1 = _block_span(block)
    parts: list[Part] = []
    x = x0 + FIRST_TREE
    while x < x1 - 7:
        if random.random() < 0.6:
            parts += tree((x, KERB, side * 6.7), random)
        x += TREE_STEP
    return parts


def _lamp_places() -> list[tuple[float, int]]:
    """World x and side of every street lamp, in the order of their ids; the two sides alternate."""
    first = LAMP_STEP * math.floor(-BEHIND / LAMP_STEP) + FIRST_LAMP
    count = math.ceil((LOOP + AHEAD - first) / LAMP_STEP)
    places = []
    for number in range(count):
        x = first + number * LAMP_STEP
        places += [(x - LAMP_STEP / 2, -1), (x, 1)]
    return places


def _lamp_head(x: float, side: int) -> Point:
    return x, LAMP_HEIGHT, side * (ROAD_HALF + 0.55 - 1.7)


def lamp_heads() -> list[Point]:
    """World positions of the lamp heads [m], in the order of their ids from 1."""
    return [_lamp_head(x, side) for x, side in _lamp_places()]


def _lamp(number: int, x: float, side: int) -> list[Part]:
    """A post, an arm that rises over the road, and a head at its end."""
    z = side * (ROAD_HALF + 0.55)
    knee, head = (x, LAMP_HEIGHT - 0.75, z), _lamp_head(x, side)
    tip = (x, LAMP_HEIGHT - 0.02, head[2] + side * 0.25)
    grey = (0.20, 0.22, 0.23)
    solids = (
        (rod((x, KERB, z), (x, KERB + 1.1, z), 0.11), Material.METAL),
        (rod((x, KERB + 1.0, z), knee, 0.07), Material.METAL),
        (rod(knee, tip, 0.045), Material.METAL),
        (ellipsoid(head, (0.17, 0.10, 0.38)), Material.LAMP_HEAD),
    )
    return [
        Part(shape=solid, material=material, colour=grey, origin=head, street_light=number)
        for solid, material in solids
    ]


def _furniture(block: int, side: int) -> list[Part]:
    """Signs, litter bins and bollards between the kerb and the walkers."""
    random = Random((block % 2) * 2 + (side > 0) + 300)
    x0, x1 = _block_span(block)
    z = side * (ROAD_HALF + 0.45)
    parts: list[Part] = []
    for number in range(4):
        x = x0 + 15 + number * 25 + random.uniform(-3, 3)
        parts.append(
            Part(shape=rod((x, KERB, z), (x, 2.65, z), 0.035), material=Material.METAL, colour=(0.4, 0.41, 0.42))
        )
        face = (x - side * 0.05, 2.45, z)
        disc = rod((x - side * 0.04, 2.45, z), (x - side * 0.06, 2.45, z), 0.26)
        parts.append(Part(shape=disc, material=Material.SIGN, origin=face, heading=-side, size=(0.26, 0, 0)))
        x += random.uniform(5, 9)
        bin_ = rod((x, KERB, z), (x, KERB + 0.9, z), 0.22)
        parts.append(
            Part(shape=bin_, material=Material.METAL, colour=random.choice(((0.05, 0.14, 0.07), (0.5, 0.22, 0.02))))
        )
    for x in (x0 + 1.9, x0 + 3.4, x0 + 4.9, x1 - 3.4, x1 - 4.9):
        parts.append(
            Part(shape=rod((x, KERB, z), (x, KERB + 1.0, z), 0.06), material=Material.METAL, colour=(0.06, 0.06, 0.065))
        )
    return parts


def _signals(block: int) -> list[Part]:
    """Traffic lights at the end of a block, one on each side, looking at the traffic that comes."""
    _, x1 = _block_span(block)
    parts: list[Part] = []
    for side, x, heading in ((1, x1 - 1.9, -1), (-1, x1 + 2 * CROSSING_HALF + 1.9, 1)):
        z = side * (ROAD_HALF + 0.5)
        dark = (0.035, 0.04, 0.04)
        parts.append(
            Part(shape=rod((x, KERB, z), (x, 3.75, z), 0.06), material=Material.METAL, colour=(0.1, 0.11, 0.11))
        )
        low, high = (x - 0.14, 2.75, z - 0.17), (x + 0.14, 3.70, z + 0.17)
        parts.append(
            Part(shape=box(low, high), material=Material.SIGNAL, colour=dark, origin=(x, 3.22, z), heading=heading)
        )
        plate = (x - heading * 0.02, 3.22, z)
        low, high = (plate[0] - 0.015, 2.62, z - 0.3), (plate[0] + 0.015, 3.83, z + 0.3)
        parts.append(Part(shape=box(low, high), material=Material.METAL, colour=(0.02, 0.02, 0.02)))
    return parts


@lru_cache(maxsize=1)
def parked_cars() -> tuple[Car, ...]:
    """Parked cars along both kerbs, clear of the crossings."""
    cars = []
    track = FIRST_PARKED
    for block in _blocks():
        x0, x1 = _block_span(block)
        for side in (-1, 1):
            random = Random((block % 2) * 2 + (side > 0) + 70)
            x = x0 + 9.5
            while x < x1 - 10:
                if random.random() < 0.72:
                    z = side * (ROAD_HALF - 1.12 - random.uniform(0, 0.08))
                    cars.append(random_car(track, x + random.uniform(-0.25, 0.25), z, side))
                track += 1
                x += 6.1
    return tuple(cars)


def moving_cars(index: int) -> list[Car]:
    """One car ahead, and oncoming cars that drive the loop the other way at the camera's speed."""
    time, ego = index / RATE, ego_x(index)
    turn = 2 * math.pi * time * SPEED / LOOP
    cars = [random_car(1, ego + 21.0 + 2.5 * math.sin(2 * turn), EGO_Z + 0.05, 1)]
    for number, start in enumerate((78.0, 136.0, 176.0), start=2):
        first = (start - 2 * SPEED * time + BEHIND) % LOOP - BEHIND
        for copy in range(2):
            ahead = first + copy * LOOP
            if ahead < AHEAD:
                car = random_car(number, ego + ahead, -EGO_Z, -1)
                cars.append(Car(number + copy * FIRST_COPY, car.x, car.z, -1, car.scale, car.style, car.paint))
    return cars


def cars(index: int) -> list[Car]:
    """All cars around the camera in a frame."""
    ego = ego_x(index)
    near = [car for car in parked_cars() if ego - BEHIND < car.x < ego + AHEAD]
    return moving_cars(index) + near


def parts(index: int) -> list[Part]:
    """All parts around the camera in a frame, in an order that no other frame has a say in."""
    ego = ego_x(index)
    near = [
        part
        for part in static_parts()
        if part.shape.bounds[1][0] > ego - BEHIND and part.shape.bounds[0][0] < ego + AHEAD
    ]
    for car in moving_cars(index):
        near += car_parts(car)
    return near
