"""The hard cases by family: what a pass must survive, and which passes each concerns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.bench.hard_inputs import Scenery, lamp, turned
from aw4d.gbuffer import GBuffer
from aw4d.passes import PASSES

LIT = ("spot_lights", "fog", "rain_streaks", "snow_fall")  # passes that know lamps
ANCHORED = ("snow_cover", "puddles", "ripples", "rain_streaks", "snow_fall", "reflections", "wet_ground")
FALLING = ("rain_streaks", "snow_fall")
BLOCK_M = 160.0  # side of the world's blocks, on whose borders cells of all sizes end
Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One hard input.

    Parameters
    ----------
    family, name
        What it is called.
    reads
        It concerns the passes that read one of these planes; all if there are none.
    steps
        It concerns these passes alone, where there are any.
    scenery
        What is hard.
    """

    family: str
    name: str
    reads: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()
    scenery: Scenery

    def concerns(self, step: str) -> bool:
        """Whether a pass can be hit by it."""
        if self.steps:
            return step in self.steps
        return not self.reads or not set(self.reads).isdisjoint(PASSES[step].reads)


def _even(**values: float) -> Callable[[GBuffer], dict[str, NDArray[Any]]]:
    """Planes of one value each."""
    return lambda source: {name: np.full_like(source[name], value) for name, value in values.items()}


def _grazing(cosine: float) -> Callable[[GBuffer], dict[str, NDArray[Any]]]:
    """Normals at such an angle to the line of sight."""

    def planes(source: GBuffer) -> dict[str, NDArray[Any]]:
        to_eye = -source.camera.rays() / np.linalg.norm(source.camera.rays(), axis=-1, keepdims=True)
        across = np.cross(to_eye, source["normal"])
        across /= np.linalg.norm(across, axis=-1, keepdims=True)
        normal = np.sqrt(1 - cosine**2) * across + cosine * to_eye
        return {"normal": normal.astype(np.float32)}

    return planes


def _overhanging(source: GBuffer) -> dict[str, NDArray[Any]]:
    """Surfaces that face straight down, to some hundredths."""
    up, n = source.camera.camera_to_world[1, :3], source["normal"].astype(np.float64)
    normal = 0.02 * n - up
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return {"normal": normal.astype(np.float32), "sky": np.zeros_like(source["sky"])}


def _level_mirrors(source: GBuffer) -> dict[str, NDArray[Any]]:
    normal = np.broadcast_to(source.camera.camera_to_world[1, :3], source["normal"].shape)
    return {"normal": normal.astype(np.float32), "roughness": np.full_like(source["roughness"], 0.2)}


def _black_mirrored(source: GBuffer) -> dict[str, NDArray[Any]]:
    return {**_level_mirrors(source), "rgb": np.where(source["sky"][..., None], source["rgb"], np.float32(0))}


def _sparks(source: GBuffer) -> dict[str, NDArray[Any]]:
    """A tenth of all values are 1e5, some beside black ones."""
    bright = np.random.default_rng(1).random(source["rgb"].shape) < 0.1
    return {"rgb": np.where(bright, np.float32(1e5), source["rgb"])}


def _sparks_mirrored(source: GBuffer) -> dict[str, NDArray[Any]]:
    return {**_leaning(0.0)(source), **_sparks(source)}


def _sparks_grazed(source: GBuffer) -> dict[str, NDArray[Any]]:
    """The surface cuts the lobe."""
    return {**_grazing(1e-3)(source), **_even(roughness=0.045)(source), **_sparks(source)}


def _leaning(sine: float) -> Callable[[GBuffer], dict[str, NDArray[Any]]]:
    """Sharp mirrors that lean to the right, whose rays all but stay in their column of the picture."""

    def planes(source: GBuffer) -> dict[str, NDArray[Any]]:
        normal = _level_mirrors(source)["normal"] + np.array([sine, 0.0, 0.0])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return {"normal": normal.astype(np.float32), "roughness": np.full_like(source["roughness"], 1e-3)}

    return planes


def _stepped(source: GBuffer) -> dict[str, NDArray[Any]]:
    steps = np.maximum(np.round(source["depth"] / 150 * 255) / 255 * 150, 0.5)
    return {"depth": steps.astype(np.float32)}


def _spike(source: GBuffer) -> dict[str, NDArray[Any]]:
    depth = source["depth"].copy()
    depth[depth.shape[0] // 2, depth.shape[1] // 2] = 1e4
    return {"depth": depth}


def _near_and_far(source: GBuffer) -> dict[str, NDArray[Any]]:
    """A millimetre beside a hundred kilometres."""
    depth = np.random.default_rng(3).choice(np.array([1e-3, 1e-3, 1e-3, 1e5], np.float32), source["depth"].shape)
    return {"depth": depth, "sky": np.zeros_like(source["sky"])}


def _shafts(source: GBuffer) -> dict[str, NDArray[Any]]:
    """Surfaces at the bottom of shafts: what is beside them all but reaches the eye."""
    depth = np.where(np.random.default_rng(3).random(source["depth"].shape) < 0.4, 0.1, 1.7).astype(np.float32)
    return {"depth": depth, "sky": np.zeros_like(source["sky"])}


def _one_bright(source: GBuffer) -> dict[str, NDArray[Any]]:
    rgb = np.zeros_like(source["rgb"])
    rgb[rgb.shape[0] // 2, rgb.shape[1] // 2] = 1e5
    return {"rgb": rgb}


def _surface() -> list[Case]:
    materials = [(r, m) for r in (0.0, 1e-3, 1.0) for m in (0.0, 1.0)]
    cases = [
        Case(family="surface", name=f"roughness {r:g}, metallic {m:g}", reads=("roughness",),
             scenery=Scenery(planes=_even(roughness=r, metallic=m)))
        for r, m in materials
    ]  # fmt: skip
    cases += [
        Case(family="surface", name=f"n.v = {cosine:g}", reads=("normal",), scenery=Scenery(planes=_grazing(cosine)))
        for cosine in (0.0, 1e-7, 1e-3, -0.2)
    ]
    below = Scenery(size=(5, 1), seed=1, planes=_overhanging)
    cases.append(Case(family="surface", name="facing down", reads=("normal",), scenery=below))
    for value in (0.0, 1.0):
        cases.append(
            Case(
                family="surface",
                name=f"albedo {value:g}",
                reads=("albedo",),
                scenery=Scenery(planes=_even(albedo=value)),
            )
        )
    shining = Scenery(planes=_even(emissive=1e5))
    return [*cases, Case(family="surface", name="emits 1e5", reads=("emissive",), scenery=shining)]


def _many_lamps() -> tuple[Any, ...]:
    where = np.random.default_rng(5).uniform((-30, -8, 2), (30, 0, 90), (10_000, 3))
    return tuple(lamp(p, intensity=(0.1, 0.1, 0.1), r_max_m=6.0) for p in where.tolist())


def _lights() -> list[Case]:
    reach = np.float32(20.0)
    inside, beyond = (float(np.nextafter(reach, np.float32(to))) for to in (0, 99))
    ahead, back = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
    lamps = {
        "dark": lamp(intensity=(0, 0, 0)),
        "at the eye": lamp((0, 0, 0), direction=ahead),
        "a millionth metre from the eye": lamp((1e-6, 0, 0), direction=ahead),
        "an ulp inside r_max": lamp((0, 0, inside), direction=back),
        "at r_max": lamp((0, 0, float(reach)), direction=back),
        "an ulp beyond r_max": lamp((0, 0, beyond), direction=back),
        "behind the eye, shining ahead": lamp((0.5, -0.5, -5), direction=ahead),
        "behind the eye, shining back": lamp((0.5, -0.5, -5), direction=back),
        "beyond every surface": lamp((3, -2, 500), direction=back, r_max_m=600.0),
        "179 degree cone": lamp(inner_deg=60, outer_deg=89.5),
        "needle cone": lamp(inner_deg=0.5, outer_deg=1.0),
        "the eye in its cone": lamp((0, 0, 12), direction=back, inner_deg=30, outer_deg=60),
        "along the axis": lamp((0, 0, 3), direction=ahead),
        "a million metres away": lamp((0, 0, -1e6), kind="point", intensity=(1e12, 1e12, 1e12), r_max_m=1e8),
    }
    cases = [
        Case(family="lights", name=name, steps=LIT, scenery=Scenery(lights=(light,))) for name, light in lamps.items()
    ]
    cases.append(Case(family="lights", name="none", steps=LIT, scenery=Scenery(lights=())))
    many = Scenery(lights=_many_lamps(), size=(17, 5))
    return [*cases, Case(family="lights", name="10,000", steps=("spot_lights", "fog"), scenery=many)]


def _fog() -> list[Case]:
    densities = [(sigma, g) for sigma in (0.0, 1e-8, 0.03, 10.0) for g in (0.0, 0.999, -0.999)]
    cases = [
        Case(family="fog", name=f"sigma_s {sigma:g} /m, g {g:g}", steps=("fog",),
             scenery=Scenery(params={"sigma_s": sigma, "g": g}))
        for sigma, g in densities
    ]  # fmt: skip
    blended = Scenery(params={"visibility_m": 1.0, "beta": 1.0})
    cases.append(Case(family="fog", name="dense, blended as a whole", steps=("fog",), scenery=blended))
    black = Scenery(
        params={"color": (0, 0, 0), "gamma": 0.0, "visibility_m": 1.0}, planes=_even(rgb=1e5, depth=25.0, sky=False)
    )
    cases.append(Case(family="fog", name="next to nothing left", steps=("fog",), scenery=black))
    far = Scenery(
        lights=(lamp((3.0, -2.0, 60.0), kind="point", r_max_m=150.0),), params={"sigma_s": 10.0, "gamma": 300.0}
    )
    cases.append(Case(family="fog", name="a lamp that nobody sees", steps=("fog",), scenery=far))
    near = {
        f"a ray {miss:g} m beside a lamp": lamp((0.3 + miss, -0.2, 8.0), kind="point") for miss in (0.0, 1e-4, 1e-3)
    }
    return cases + [
        Case(family="fog", name=name, steps=("fog",), scenery=Scenery(lights=(light,))) for name, light in near.items()
    ]


def _depth() -> list[Case]:
    planes = {f"{z:g} m everywhere": _even(depth=z) for z in (1e-3, 1.0, 60.0, 1e5)}
    planes |= {"in 8 bits": _stepped, "a spike of one pixel": _spike, "1 mm beside 100 km": _near_and_far}
    cases = [
        Case(family="depth", name=name, reads=("depth",), scenery=Scenery(planes=made)) for name, made in planes.items()
    ]
    up = Scenery(rotation=turned(0, 90, 0), planes=_near_and_far, params={"occlusion_radius_m": 100.0})
    down = Scenery(
        size=(17, 3),
        rotation=turned(0, -90, 10),
        planes=_shafts,
        params={"occlusion_radius_m": 100.0, "occlusion_slices": 1},
    )
    occluded = {"occluded from afar": up, "occluded all but wholly": down}
    return cases + [
        Case(family="depth", name=name, steps=("ambient",), scenery=scenery) for name, scenery in occluded.items()
    ]


def _shape() -> list[Case]:
    sizes = [(1, 1), (1, 9), (9, 1), (7, 13), (15, 3), (16, 3), (17, 3), (31, 2), (32, 2), (129, 5)]
    cases = [Case(family="shape", name=f"{w}x{h}", scenery=Scenery(size=(w, h), seed=w + h)) for w, h in sizes]
    level = Scenery(
        size=(200, 13), seed=3, rotation=turned(0, 5), planes=_level_mirrors, params={"steps": 28, "reach_m": 150.0}
    )
    cases.append(Case(family="shape", name="mirrored at a border", steps=("reflections",), scenery=level))
    for name, sine, size, seed in (
        ("a millionth of a column off", 1e-6, (33, 7), 5),
        ("a crack beside what hides", 1e-4, (17, 40), 7),
    ):
        leaning = Scenery(size=size, seed=seed, planes=_leaning(sine), preset="midnight")
        cases.append(Case(family="shape", name=name, steps=("reflections",), scenery=leaning))
    for name, value in (("all sky", True), ("no sky", False)):
        cases.append(Case(family="shape", name=name, reads=("sky",), scenery=Scenery(planes=_even(sky=value))))
    return cases


def _place() -> list[Case]:
    """Cell borders and one ulp of float32 to either side, in a world as large as UTM's."""
    origins = {"5e5 m": (5e5, 100.0, -5e5), "4e6 m": (5.2e5, 100.0, 4e6), "-4e6 m": (-4e6, -20.0, -5.2e5)}
    cases = [
        Case(family="place", name=f"origin {name}", steps=ANCHORED, scenery=Scenery(origin=origin))
        for name, origin in origins.items()
    ]
    for name, x in (("on", 0.0), ("an ulp below", -1e-5), ("an ulp above", 1e-5)):
        border = Scenery(place=(BLOCK_M + x, -BLOCK_M + x))
        cases.append(Case(family="place", name=f"{name} a block's border", steps=ANCHORED, scenery=border))
    turns = {"rolled": (0, 5, 37), "pitched up": (20, 90, 0), "pitched down": (0, -90, 10), "upside down": (0, 0, 180)}
    return cases + [
        Case(family="place", name=name, scenery=Scenery(rotation=turned(*angles))) for name, angles in turns.items()
    ]


def _snow() -> list[Case]:
    """Next to nothing left of it, and next to nothing that it leaves bare."""
    ahead, below = {"size": (17, 13), "rotation": turned(0, -60, 10)}, {"size": (5, 1), "rotation": turned(0, -90, 10)}
    settings: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
        "next to none in the ruts": ({"track_share": 1e-3, "track_middle": 1e-3}, ahead),
        "none on half of the road": ({"road_bare": 1.0}, ahead),
        "hides all": ({"cover_cm": 0.1}, below | {"seed": 1}),
    }
    return [
        Case(family="snow", name=name, steps=("snow_cover",), scenery=Scenery(params=params, **seen))
        for name, (params, seen) in settings.items()
    ]


def _time() -> list[Case]:
    steps = ("ripples", *FALLING)
    return [
        Case(family="time", name=f"{time:,} s", steps=steps, scenery=Scenery(time=time))
        for time in (0.0, 1e6, 1e6 + 0.1)
    ]


def _particles() -> list[Case]:
    heavy = {"rain_streaks": ("drops", 150.0), "snow_fall": ("flakes", 20.0)}
    cases = []
    for step, (amount, rate) in heavy.items():
        settings: dict[str, dict[str, Any]] = {
            f"{count} of them": {amount: count, "rate_mm_h": rate} for count in (0, 1, 3000)
        }
        settings |= {
            "at the lens": {"near_m": 0.01, "reach_m": 0.6, "rate_mm_h": rate},
            "far under a pixel": {"reach_m": 900.0, "near_m": 50.0, "rate_mm_h": rate},
            "standing still": {"exposure_s": 0.0},
            "a long exposure in a storm": {"exposure_s": 0.2, "wind_m_s": (40.0, 0.0, -30.0)},
            "out of focus": {"aperture_mm": 50.0, "focus_m": 0.5},
            "as printed": {"convention": "paper"},
        }
        cases += [
            Case(family="particles", name=name, steps=(step,), scenery=Scenery(params=params))
            for name, params in settings.items()
        ]
    return cases


def _exposure() -> list[Case]:
    planes = {"all black": _even(rgb=0.0), "all white": _even(rgb=1.0), "all 1e5": _even(rgb=1e5)}
    planes |= {"one pixel of 1e5": _one_bright, "next to black": _even(rgb=1e-30)}
    black = Scenery(size=(7, 13), params={"sky_factor": 0.0}, planes=_even(sky=True))
    dark = Case(family="exposure", name="nothing left of the sky", steps=("night_grade",), scenery=black)
    seen: dict[str, Any] = {"size": (17, 40), "rotation": turned(0, 5)}
    grazed = {"steps": 64, "thickness_m": 100.0}
    mirrored = {
        "black things mirrored": Scenery(seed=5, planes=_black_mirrored, **seen),
        "1e5 mirrored": Scenery(planes=_sparks_mirrored, params={"steps": 4}, **seen),
        "1e5 at a grazing angle": Scenery(seed=13, planes=_sparks_grazed, params=grazed, **seen),
    }
    cases = [dark] + [
        Case(family="exposure", name=name, steps=("reflections",), scenery=scenery)
        for name, scenery in mirrored.items()
    ]
    return cases + [
        Case(family="exposure", name=name, reads=("rgb",), scenery=Scenery(planes=made))
        for name, made in planes.items()
    ]


CASES: tuple[Case, ...] = (
    *_surface(), *_lights(), *_fog(), *_depth(), *_shape(), *_place(), *_snow(), *_time(), *_particles(), *_exposure()
)  # fmt: skip
