"""What each material looks like: its painter.

Fine patterns are averaged over the sample's footprint: far brickwork and markings turn grey instead of crawling.
"""

from __future__ import annotations

from collections.abc import Callable

from aw4d.street import paint_car, paint_ground, paint_house, paint_small
from aw4d.street.parts import Material, Part
from aw4d.street.surface import Samples, Surface

Painter = Callable[[Part, Samples, Surface], None]
PAINTERS: dict[Material, Painter] = {
    Material.ASPHALT: paint_ground.asphalt,
    Material.PAVEMENT: paint_ground.pavement,
    Material.FACADE: paint_house.facade,
    Material.WALL: paint_house.wall,
    Material.CLOTH: paint_house.cloth,
    Material.ROOF: paint_house.roof,
    Material.CAR_BODY: paint_car.body,
    Material.CAR_CABIN: paint_car.cabin,
    Material.WHEEL: paint_car.wheel,
    Material.METAL: paint_small.metal,
    Material.BARK: paint_small.bark,
    Material.LEAVES: paint_small.leaves,
    Material.SIGNAL: paint_small.signal,
    Material.SIGN: paint_small.sign,
    Material.LAMP_HEAD: paint_small.lamp_head,
}
# Materials whose painters read the footprint.
FILTERED = frozenset(
    {Material.ASPHALT, Material.PAVEMENT, Material.FACADE, Material.WALL, Material.CLOTH, Material.ROOF}
)
