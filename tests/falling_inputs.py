"""Clips, frames and runs for the tests of what falls."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend_numpy import NumpyBackend
from aw4d.camera import Camera
from aw4d.clip import ClipInfo
from aw4d.compare import BAR_MAX, BAR_P9999, error
from aw4d.environment import Environment, arrays, environment
from aw4d.gbuffer import GBuffer
from aw4d.lights.light import Light, in_camera
from aw4d.params import AmbientParams, RainStreaksParams, SnowFallParams
from aw4d.passes import PASSES
from aw4d.scene import Scene
from aw4d.world import anchor
from aw4d.world.falling import rain_arguments, snow_arguments
from reference_numpy.capsules import UNITS

Params = RainStreaksParams | SnowFallParams
LEVEL = np.diag([1.0, -1.0, -1.0])  # camera to world: looks along -z, upright
NAMES: dict[type[Params], str] = {RainStreaksParams: "rain_streaks", SnowFallParams: "snow_fall"}


def clip(
    width: int = 96,
    height: int = 54,
    *,
    frames: int = 3,
    start_s: float = 0.0,
    step_s: float = 0.1,
    speed_m_s: float = 10.0,
    turn: NDArray[np.float64] = LEVEL,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    focal: float = 0.8,
) -> ClipInfo:
    """A straight drive along the view."""
    pose = np.tile(np.eye(4), (frames, 1, 1))
    pose[:, :3, :3] = turn
    pose[:, :3, 3] = (0.3, 1.6, -0.2) + np.arange(frames)[:, None] * step_s * speed_m_s * turn[:, 2]
    K = np.array([[focal * width, 0, width / 2 - 0.3], [0, focal * width, height / 2 + 0.2], [0, 0, 1]])
    return ClipInfo(
        name="drive",
        width=width,
        height=height,
        K=np.tile(K, (frames, 1, 1)),
        camera_to_world=pose,
        times=start_s + np.arange(frames) * step_s,
        world_origin=origin,
    )


def frame(info: ClipInfo, index: int = 1, seed: int = 0, **planes: Any) -> GBuffer:
    """Random colours on a ragged wall 1 to 30 m away, the upper third sky; `planes` replace what is drawn."""
    rng = np.random.default_rng(seed)
    size = (info.height, info.width)
    drawn = {
        "rgb": rng.random((*size, 3), dtype=np.float32),
        "depth": np.exp(rng.uniform(0, np.log(30), size)).astype(np.float32),
        "sky": np.arange(info.height)[:, None] < np.full(info.width, info.height // 3),
    }
    return GBuffer(drawn | planes, camera=info.camera(index), time=float(info.times[index]))


@cache
def overcast() -> Environment:
    """A grey sky over grey ground."""
    return environment(AmbientParams(preset="overcast"))


def even(radiance: float = 1.0) -> Environment:
    """As bright all around."""
    around = np.full((8, 16, 3), radiance)
    return Environment(
        radiance=around, backdrop=around, sun_direction=np.array([0.0, 1.0, 0.0]), sun_irradiance=np.zeros(3)
    )


def scene(
    info: ClipInfo,
    p: Params,
    index: int = 1,
    *,
    lights: list[Light] | None = None,
    around: Environment | None = None,
    white_cd_m2: float = 2_000.0,
    haze: float = 0.0,
    haze_color: tuple[float, float, float] = (0.4, 0.45, 0.5),
) -> Scene:
    """What the pass takes."""
    camera: Camera = info.camera(index)
    rainy = isinstance(p, RainStreaksParams)
    falling = rain_arguments(p, info, index) if rainy else snow_arguments(p, info, index)  # type: ignore[arg-type]
    tables = arrays(overcast() if around is None else around, camera, white_cd_m2).arguments()
    world = anchor(camera, float(info.times[index]), info.world_origin)
    world |= {f"{NAMES[type(p)]}.{name}": value for name, value in falling.items()}
    world |= {"haze_extinction": haze, "haze_color": np.array(haze_color, dtype=np.float32)}
    return Scene(lights=in_camera(lights or [], camera), environment=tables, world=world)


def in_one_tile(where: Scene, p: Params) -> Scene:
    """The same with all particles but those nearer than `near_m` ahead, from 0 to 9 m, within 6 mm of the axis."""
    own = NAMES[type(p)]
    corner, sides = np.array([-(2**30), -(2**30), 0], dtype=np.int32), np.array([0.012, 0.012, 9.0])
    box = {"particle_corner": corner, "particle_axes": np.diag(sides / UNITS).astype(np.float32).ravel()}
    return replace(where, world={**where.world, **{f"{own}.{name}": value for name, value in box.items()}})


def results(p: Params) -> list[str]:
    """Names of the pass' results."""
    return ["rgb", *PASSES[NAMES[type(p)]].layers]


def reference(source: GBuffer, where: Scene, p: Params) -> dict[str, NDArray[np.float64]]:
    """The definition of the result."""
    backend = NumpyBackend()
    planes = backend.upload(source, where)
    backend.run(NAMES[type(p)], planes, p)
    return backend.download64(planes, results(p))


def on(
    backend: Any, source: GBuffer, where: Scene, p: Params, *, layers: bool = True
) -> dict[str, NDArray[np.float32]]:
    """What an OpenCL backend makes of it."""
    wanted = results(p) if layers else ["rgb"]
    planes = backend.upload(source, where, wanted[1:])
    backend.run(NAMES[type(p)], planes, p)
    found: dict[str, NDArray[np.float32]] = backend.download(planes, wanted)
    return found


def check(
    backend: Any, source: GBuffer, where: Scene, p: Params, truth: dict[str, NDArray[np.float64]] | None = None
) -> None:
    """The error bar on every result, with layers and without."""
    expected = reference(source, where, p) if truth is None else truth
    for layers in (True, False):
        for key, found in on(backend, source, where, p, layers=layers).items():
            assert np.isfinite(found).all(), key
            assert (found >= 0).all(), key
            largest, p9999 = error(found, expected[key])
            assert largest <= BAR_MAX, f"{key}: {largest:.2e}"
            assert p9999 <= BAR_P9999, f"{key}: {p9999:.2e}"
