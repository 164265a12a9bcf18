"""The planes of one frame from what a recording gives: picture, laser returns, boxes; no learned weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.calibrate.ground import GroundPlane
from aw4d.camera import Camera
from aw4d.colour import decode_srgb8
from aw4d.errors import InputError
from aw4d.extract.borders import settle_outlines
from aw4d.extract.completion import complete_depth
from aw4d.extract.emissive import emissive
from aw4d.extract.fringes import without_fringes
from aw4d.extract.materials import materials
from aw4d.extract.monocular import monocular_depth
from aw4d.extract.normals import normals_from_depth
from aw4d.extract.pixels import pixels_of
from aw4d.extract.road import lane_ground, road_mask
from aw4d.extract.sky import sky_mask
from aw4d.extract.solid import solid_depth
from aw4d.extract.vehicles import vehicle_ids
from aw4d.extract.visibility import above_scan
from aw4d.gbuffer import Plane

ON_GROUND = 1.5  # depth of the ground behind a pixel over its own, from which on it is above the ground

# How a plane comes about where the recording does not give it.
PROVENANCE: dict[str, str] = {
    "depth": "laser returns, completed along the picture's edges",
    "normal": "derivatives of depth",
    "albedo": "picture, cast shadows and shading divided out",
    "roughness": "by kind of surface",
    "metallic": "by kind of surface",
    "sky": "colour, smoothness and laser returns",
    "road": "height above the ground plane, colour and laser reflectance",
    "vehicle": "surface inside the boxes, or standing on the road where there are none",
    "emissive": "coloured lights told by colour, brightness, size and place",
    "street_light": "none found: no lamp is told from a pole without learned weights",
}


# What a user must know of planes that were not measured; the first key decides whether the sentence holds.
APPROXIMATIONS: dict[str, str] = {
    "depth": "Depth between laser returns is interpolated; above the scan it continues what is below: trees and "
    "facades there may stand at a wrong distance.",
    "vehicle": "Masks of sky, road and vehicles are estimated from colour, geometry and boxes.",
    "albedo": "Cast shadows are taken out of the albedo where the road shows sun and shadow: nearly all of them on "
    "the road; some stay on walls, plants and vehicles. Patches of another road surface are evened out. Roughness and "
    "metallic are set by kind of surface.",
}


def _depth(
    rgb: NDArray[np.uint8],
    *,
    camera: Camera,
    points: NDArray[np.float32] | None,
    sky: NDArray[np.bool_],
    camera_height_m: float | None,
) -> NDArray[np.float32]:
    if points is not None:
        return complete_depth(points, rgb=rgb, camera=camera, sky=sky)
    if camera_height_m is not None:
        return monocular_depth(rgb, camera=camera, camera_height_m=camera_height_m, sky=sky)
    raise InputError("depth: expected a depth plane, laser returns or the height of the camera, got none of them")


def _ground(planes: Mapping[str, Plane], *, camera: Camera, points: NDArray[np.float32] | None) -> GroundPlane | None:
    surface = points if points is not None else camera.unproject(planes["depth"])[~planes["sky"]].astype(np.float32)
    return lane_ground(surface)


def _level(ground: GroundPlane | None, camera: Camera) -> NDArray[np.float64]:
    """Inverse depth of the ground plane [1/m]; 0 where there is none."""
    if ground is None:
        return np.zeros(camera.shape)
    return np.asarray(np.maximum(camera.rays() @ -ground.normal / ground.offset, 0), dtype=np.float64)


def _beyond_scan(points: NDArray[np.float32], camera: Camera) -> NDArray[np.bool_]:
    row, column, _ = pixels_of(points, camera)
    return above_scan(np.column_stack([column, row]).astype(np.float64), camera)


def _settled(
    rgb: NDArray[np.uint8], planes: Mapping[str, Plane], *, camera: Camera, level: NDArray[np.float64]
) -> dict[str, Plane]:
    """Depth and vehicles that agree with the picture on the vehicles' outlines."""
    depth, vehicle = settle_outlines(
        planes["depth"], planes["vehicle"], rgb=rgb, ground=level, sky=planes["sky"], focal=float(camera.K[0, 0])
    )
    return {"depth": solid_depth(depth, vehicle), "vehicle": vehicle}


def _materials(planes: Mapping[str, Plane], beyond: NDArray[np.bool_]) -> dict[str, NDArray[np.float32]]:
    """Materials without fringes; `beyond` the scan no beam tells leaves from sky."""
    rgb, depth, sky = planes["rgb"], planes["depth"], planes["sky"]
    found = materials(rgb, sky=sky, **{name: planes[name] for name in ("road", "vehicle", "normal")})
    found["albedo"] = without_fringes(found["albedo"], rgb_linear=rgb, depth=depth, sky=sky, guessed=beyond)
    return found


def extract_frame(
    rgb: NDArray[np.uint8],
    *,
    camera: Camera,
    points: NDArray[np.float32] | None,
    boxes: Sequence[Box],
    given: Mapping[str, Plane],
    camera_height_m: float | None = None,
) -> dict[str, Plane]:
    """All planes of a frame.

    Parameters
    ----------
    rgb
        Recorded picture, (H, W, 3) sRGB uint8.
    camera
        The frame's camera.
    points
        Laser returns, (n, 4): camera frame [m] and reflectance 0..1; or None.
    boxes
        3D boxes of vehicles and others in the world; may be empty.
    given
        Planes that are known already; they are kept as they are and the others are derived from them.
    camera_height_m
        Height of the camera above a level road [m]: stands in for depth where there are neither returns nor a plane.

    Raises
    ------
    InputError
        There is nothing to take depth from, or a piece refuses its input.
    """
    xyz = None if points is None else points[:, :3]
    planes: dict[str, Plane] = {"rgb": decode_srgb8(rgb), **given}
    if "sky" not in planes:
        planes["sky"] = sky_mask(rgb, camera=camera, points=xyz)
    sky = planes["sky"]
    if "depth" not in planes:
        planes["depth"] = _depth(rgb, camera=camera, points=xyz, sky=sky, camera_height_m=camera_height_m)
    ground = _ground(planes, camera=camera, points=xyz)
    level = _level(ground, camera)
    if "vehicle" not in planes:
        planes["vehicle"] = vehicle_ids(
            depth=planes["depth"], camera=camera, boxes=boxes, points=xyz, ground=ground, sky=sky, rgb=rgb
        )
        if "depth" not in given:
            planes |= _settled(rgb, planes, camera=camera, level=level)
    beyond = ~sky if xyz is None else _beyond_scan(xyz, camera)
    if "normal" not in planes:
        guessed = None if xyz is None or "depth" in given else beyond & (planes["depth"] * level < 1 / ON_GROUND)
        planes["normal"] = normals_from_depth(planes["depth"], camera=camera, sky=sky, guessed=guessed)
    if "road" not in planes:
        road = road_mask(
            rgb,
            camera=camera,
            depth=planes["depth"],
            normal=planes["normal"],
            points=xyz,
            sky=sky,
            reflectance=None if points is None else points[:, 3],
        )
        planes["road"] = road & (planes["vehicle"] == 0)
    if not {"albedo", "roughness", "metallic"} <= planes.keys():
        planes = {**_materials(planes, beyond), **planes}
    if "emissive" not in planes:
        regions = {name: planes[name] for name in ("sky", "road", "vehicle", "depth")}
        planes["emissive"] = emissive(planes["rgb"], camera=camera, **regions)
    planes.setdefault("street_light", np.zeros(camera.shape, dtype=np.int32))
    return planes
