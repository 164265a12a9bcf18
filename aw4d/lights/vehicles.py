"""Lights of other vehicles: which ones move, their head and tail lights, and the lamps' faces in the picture."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from aw4d.boxes import Box
from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.errors import InputError
from aw4d.lights.faces import Shown, add_disc
from aw4d.lights.lenses import add_tail_face, find_lens
from aw4d.lights.light import Light, Vector
from aw4d.lights.photometry import on_picture
from aw4d.params import RGB, VehicleLightParams

Array = NDArray[np.float64]

DRIVEN = frozenset({"car", "van", "truck", "bus", "tram", "trailer", "construction_vehicle", "motorcycle", "motorbike"})
SINGLE = frozenset({"motorcycle", "motorbike"})  # one lamp in the middle
SETBACK = 0.2  # [m] of a lamp's face behind the box's end: bodies are rounded at their corners
# [m] of the surface in the depth from a lamp: what is nearer hides it; lasers pass through glass to what is behind.
NEARER, FARTHER = 0.4, 5.0
TRAVEL = 1.5  # [m] that the box of a parked vehicle may wander
FADE = 0.2  # cosine to a face's axis under which it goes out of sight


@lru_cache(maxsize=256)
def _words(category: str) -> frozenset[str]:
    return frozenset(category.lower().split("."))


@dataclass(frozen=True, eq=False)
class _Motion:
    """A track in time: its frames, (n,), its boxes in them, and their velocities, (n, 3) world [m/s]."""

    frames: NDArray[np.int64]
    boxes: list[Box]
    velocity: Array

    @cached_property
    def speed(self) -> Array:
        """Over the ground [m/s]."""
        return np.asarray(np.hypot(self.velocity[:, 0], self.velocity[:, 2]), dtype=np.float64)

    @cached_property
    def front(self) -> int:
        """1 where the boxes' x axis leads, -1 where the track moves the other way."""
        ahead = np.array([box.object_to_world[:3, 0] for box in self.boxes])
        return -1 if float(np.sum(ahead * self.velocity)) < 0 else 1

    @cached_property
    def drives(self) -> float:
        """Its highest speed [m/s]; 0 for one that stays where it is, whose boxes merely jitter."""
        centres = np.array([box.object_to_world[[0, 2], 3] for box in self.boxes])
        return float(self.speed.max()) if np.hypot(*np.ptp(centres, axis=0)) > TRAVEL else 0.0

    def box(self, index: int) -> Box | None:
        """Box in a frame of the clip, if the track has one."""
        place = int(np.searchsorted(self.frames, index))
        return self.boxes[place] if place < len(self.frames) and self.frames[place] == index else None


def _velocities(times: Array, centres: Array, window_s: float) -> Array:
    """Slope at every time of the straight line fitted to the centres within the window, (n, 3); 0 for one alone."""
    window = window_s * (1 + 1e-6)
    first = np.searchsorted(times, times - window, side="left")
    last = np.searchsorted(times, times + window, side="right")
    t, p = times - times.mean(), centres - centres.mean(axis=0)
    columns = np.column_stack([np.ones(len(t)), t, t * t, p, t[:, None] * p])
    sums = np.concatenate([np.zeros((1, columns.shape[1])), np.cumsum(columns, axis=0)])
    n, st, stt, *rest = (sums[last] - sums[first]).T
    sp, stp = np.array(rest[:3]), np.array(rest[3:])
    alone = last - first < 2
    spread = np.where(alone, 1.0, n * stt - st**2)
    return np.asarray(np.where(alone, 0.0, (n * stp - st * sp) / spread).T, dtype=np.float64)


class ClipKey:
    """A clip as a key: the same object is the same clip."""

    def __init__(self, info: ClipInfo) -> None:
        self.info = info

    def __hash__(self) -> int:
        return id(self.info)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ClipKey) and other.info is self.info


def _motions(info: ClipInfo, window_s: float) -> Mapping[int, _Motion]:
    """All tracks of vehicles, by number."""
    return _motions_of(ClipKey(info), window_s)


@lru_cache(maxsize=4)  # every frame asks for all of them
def _motions_of(key: ClipKey, window_s: float) -> Mapping[int, _Motion]:
    info = key.info
    tracks: dict[int, list[tuple[int, Box]]] = {}
    for index, boxes in enumerate(info.boxes):
        for box in boxes:
            if _words(box.category) & DRIVEN:
                tracks.setdefault(box.track_id, []).append((index, box))
    motions = {}
    for track, held in sorted(tracks.items()):
        frames, boxes = np.array([index for index, _ in held]), [box for _, box in held]
        centres = np.array([box.object_to_world[:3, 3] for box in boxes])
        motions[track] = _Motion(frames, boxes, _velocities(info.times[frames], centres, window_s))
    return motions


def vehicle_speeds(info: ClipInfo, *, window_s: float = VehicleLightParams().window_s) -> list[dict[int, float]]:
    """Speed over the ground [m/s] of every vehicle in every frame, by track.

    The slope of a least-squares line through the box's centres in the frames around: a jitter of 0.1 m at 10 frames a
    second leaves 0.2 m/s. 0 where a track has a single frame.

    Parameters
    ----------
    info
        Boxes and times of a clip.
    window_s
        Frames within this time count [s].
    """
    speeds: list[dict[int, float]] = [{} for _ in range(len(info))]
    for track, motion in _motions(info, window_s).items():
        for index, speed in zip(motion.frames, motion.speed, strict=True):
            speeds[index][track] = float(speed)
    return speeds


def moving_vehicles(info: ClipInfo, params: VehicleLightParams) -> dict[int, Array]:
    """Centres of the boxes in the frames that have one, (n, 3) world [m], of every vehicle that drives, by track.

    Parameters
    ----------
    info
        Boxes and times of a clip.
    params
        `moving_m_s` and `window_s`: from which speed on a vehicle drives.
    """
    return {
        track: np.array([box.object_to_world[:3, 3] for box in motion.boxes])
        for track, motion in _motions(info, params.window_s).items()
        if motion.drives >= params.moving_m_s
    }


@dataclass(frozen=True, eq=False)
class _Lamp:
    """A lamp on a vehicle: id, place at the end of the box and the way it looks (world), and which kind it is."""

    name: str
    position: Array
    facing: Array
    up: Array
    head: bool


def _lamps(info: ClipInfo, index: int, params: VehicleLightParams) -> tuple[_Lamp, ...]:
    """Lamps of the vehicles in a frame that move somewhere in the clip; one that waits keeps its lights on."""
    return _lamps_of(ClipKey(info), index, params)


@lru_cache(maxsize=4)  # a frame's lights, their lenses and their faces ask for them
def _lamps_of(key: ClipKey, index: int, params: VehicleLightParams) -> tuple[_Lamp, ...]:
    return tuple(
        lamp
        for track, motion in _motions(key.info, params.window_s).items()
        if motion.drives >= params.moving_m_s and (box := motion.box(index)) is not None
        for lamp in _box_lamps(box, motion.front, f"vehicle-{track}", params)
    )


def _box_lamps(box: Box, front: int, name: str, params: VehicleLightParams) -> Iterator[_Lamp]:
    forward, up, right = box.object_to_world[:3, :3].T * np.array([front, 1, front])[:, None]
    length, height, width = box.size
    middle = box.object_to_world[:3, 3]
    sides = {"": 0.0} if _words(box.category) & SINGLE else {"-left": -params.aside, "-right": params.aside}
    for end, facing, above in (("head", forward, params.head_height_m), ("tail", -forward, params.tail_height_m)):
        centre = middle + up * (min(above, 0.8 * height) - height / 2)
        for side, aside in sides.items():
            position = centre + facing * length / 2 + right * aside * width / 2
            yield _Lamp(f"{name}-{end}{side}", position, facing, up, end == "head")


def _vector(values: Array) -> Vector:
    x, y, z = (float(v) for v in values)
    return x, y, z


def vehicle_lights(info: ClipInfo, index: int, params: VehicleLightParams, *, white_cd_m2: float) -> list[Light]:
    """Headlights and tail lights of the vehicles that move, "vehicle-<track>-head-left" and so on.

    A vehicle that reaches `moving_m_s` in any frame of the clip is no parked one; the way it goes tells its front.
    Paper, "Light Source Implementation".

    Parameters
    ----------
    info
        Boxes and times of a clip; tracks whose category is no vehicle have no lights.
    index
        Number of the frame.
    params
        Place, strength and cones of the lamps.
    white_cd_m2
        The luminance that the picture shows as white.
    """
    return list(_vehicle_lights(ClipKey(info), index, params, white_cd_m2))


@lru_cache(maxsize=4)  # a frame's lamps and their faces ask for them
def _vehicle_lights(key: ClipKey, index: int, params: VehicleLightParams, white_cd_m2: float) -> tuple[Light, ...]:
    info, dip = key.info, math.radians(params.head_dip_deg)
    head = on_picture(params.head_candela, params.head_color, white_cd_m2)
    tail = on_picture(params.tail_candela, params.tail_color, white_cd_m2)
    return tuple(
        Light(
            kind="spot",
            position=_vector(lamp.position),
            direction=_vector(lamp.facing * math.cos(dip) - lamp.up * math.sin(dip) if lamp.head else lamp.facing),
            intensity=head if lamp.head else tail,
            inner_deg=params.head_inner_deg if lamp.head else params.tail_inner_deg,
            outer_deg=params.head_outer_deg if lamp.head else params.tail_outer_deg,
            r_max_m=params.head_r_max_m if lamp.head else params.tail_r_max_m,
            name=lamp.name,
        )
        for lamp in _lamps(info, index, params)
    )


def add_vehicle_faces(
    out: NDArray[np.float32],
    info: ClipInfo,
    index: int,
    planes: Mapping[str, NDArray[np.generic]],
    params: VehicleLightParams,
    *,
    white_cd_m2: float,
    lit: frozenset[str] | None = None,
) -> None:
    """Add the radiance that the lamps' faces send towards the camera, in place, linear on the picture's scale.

    A disc of `radius_m` on the surface of the vehicle, seen from the lamp's side only. Its share of every pixel is
    analytic: a lamp that is smaller than a pixel dims the pixel, its flux stays. `head_cd_m2` is that beside the beam;
    into a headlight's beam one sees a hundred times more.

    Parameters
    ----------
    out
        (H, W, 3) radiance that is added to.
    info, index, params, white_cd_m2
        As for `vehicle_lights`.
    planes
        `vehicle` (H, W), 0 = none, and `depth` (H, W) [m]; of `albedo` (H, W, 3), where it is given, the red parts are
        the lenses of near tail lights.
    lit
        Names of the lamps that burn; all of them by default.

    Raises
    ------
    InputError
        A plane has another size than the clip.
    """
    camera, shown = info.camera(index), _shown(planes, info.camera(index))
    for lamp in _lamps(info, index, params):
        if lit is None or lamp.name in lit:
            centre = _face_centre(lamp, camera)
            radiance = _seen(lamp, centre, camera) * np.array(_face(lamp, params, white_cd_m2))
            if radiance.any():
                face = out, centre, params.radius_m, radiance.tolist(), camera, shown
                if lamp.head or "albedo" not in planes:
                    add_disc(*face)
                else:
                    add_tail_face(*face, planes["albedo"])


def _shown(planes: Mapping[str, NDArray[np.generic]], camera: Camera) -> Shown:
    """Where the surface of a vehicle is seen at about a depth [m]."""
    vehicle, depth = planes["vehicle"], planes["depth"]
    for name, plane in (("vehicle", vehicle), ("depth", depth)):
        if plane.shape != camera.shape:
            raise InputError(f"{name}: expected a plane of {camera.shape}, got {plane.shape}")

    def shown(window: tuple[NDArray[np.intp], ...], z: float) -> NDArray[np.bool_]:
        gap = depth[window].astype(np.float64) - z
        return np.asarray((vehicle[window] != 0) & (gap > -NEARER) & (gap < FARTHER), dtype=np.bool_)

    return shown


def _face_centre(lamp: _Lamp, camera: Camera) -> Array:
    return camera.to_camera(lamp.position - SETBACK * lamp.facing)


def at_faces(
    lights: Sequence[Light],
    info: ClipInfo,
    index: int,
    planes: Mapping[str, NDArray[np.generic]],
    params: VehicleLightParams,
) -> list[Light]:
    """Vehicles' lights, each that is seen moved into the line of sight to its face, so that its glow is around that.

    Boxes end before bodies do, and tail lights have their faces where the picture shows a lens. Distances [z] stay.

    Parameters
    ----------
    lights
        Those of `vehicle_lights`.
    info, index, planes, params
        As for `add_vehicle_faces`.

    Raises
    ------
    InputError
        A plane has another size than the clip.
    """
    camera, shown = info.camera(index), _shown(planes, info.camera(index))
    moved: dict[str, Vector] = {}
    for lamp in _lamps(info, index, params):
        face, place = _face_centre(lamp, camera), camera.to_camera(lamp.position)
        seen = _seen(lamp, face, camera)
        if not (seen > 0 and min(face[2], place[2]) > 0):
            continue
        if not lamp.head and "albedo" in planes:
            lens = find_lens(face, params.radius_m, camera, shown, planes["albedo"])
            face = face if lens is None else face + lens.weight * lens.offset
        move = camera.camera_to_world[:3, :3] @ (seen * (face * (place[2] / face[2]) - place))
        moved[lamp.name] = _vector(lamp.position + move)
    return [
        dataclasses.replace(light, position=moved[light.name]) if light.name in moved else light for light in lights
    ]


def _face(lamp: _Lamp, params: VehicleLightParams, white_cd_m2: float) -> RGB:
    if lamp.head:
        return on_picture(params.head_cd_m2, params.head_color, white_cd_m2)
    return on_picture(params.tail_cd_m2, params.tail_color, white_cd_m2)


def _seen(lamp: _Lamp, centre: Array, camera: Camera) -> float:
    """1 from where a lamp looks to, 0 from beside and behind it, smooth between them."""
    distance = float(np.linalg.norm(centre))
    cosine = -float(centre @ (lamp.facing @ camera.camera_to_world[:3, :3])) / distance if distance > 0 else 0.0
    return min(max(cosine / FADE, 0.0), 1.0)
