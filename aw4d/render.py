"""Editing a clip: frames through a plan, decode and compute overlapping, on the backend that was asked for."""

from __future__ import annotations

import dataclasses
import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend import Backend
from aw4d.backend_numpy import NumpyBackend
from aw4d.clip import Clip
from aw4d.colour import LUMINANCE
from aw4d.errors import InputError
from aw4d.gbuffer import GBuffer
from aw4d.overlap import mapped_ahead
from aw4d.passes import IMAGE, SHOW
from aw4d.pipeline import Plan, before_grading, begin, check_layers, each_light, inputs, plan, render
from aw4d.quality import DEFAULT_QUALITY
from aw4d.scene import Scene
from aw4d.weathers import nearest

log = logging.getLogger("aw4d")
BACKENDS = ("auto", "opencl", "numpy")
EACH_LIGHT = "lights"  # the layer that stands for one layer a light
LABELS = "labels"  # the layer that stands for the clip's own depth and masks, unchanged, and the edited depth
LABEL_PLANES = ("depth", "sky", "road", "vehicle", "street_light")
EDITED_DEPTH = "edited_depth"  # [m] of the nearest thing in every pixel, be it a drop or a flake
PARTICLE_DEPTHS = ("streak_depth", "flake_depth")
EXPOSURE_FRAMES = 5  # from which a steady exposure is measured


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One edited frame: `image` (H, W, 3) 8-bit sRGB, and layers by name: float32, masks bool, ids int32."""

    index: int
    time: float
    image: NDArray[np.uint8]
    layers: dict[str, NDArray[Any]]
    linear: NDArray[np.float32] | None = None

    @property
    def rgb(self) -> NDArray[np.float32]:
        """The frame scene-linear, (H, W, 3), 1 = display white; `edit` always gives it.

        Raises
        ------
        ValueError
            Only the image was asked for.
        """
        if self.linear is None:
            raise ValueError("rgb: expected a frame that was asked for with linear=True, got its image alone")
        return self.linear


def open_backend(name: str = "auto", device: int | None = None) -> Backend:
    """A backend by name; `auto` takes OpenCL where a device works, else NumPy, and logs which.

    Raises
    ------
    InputError
        The name is unknown, or the device that was asked for does not work. Only `auto` without a device chooses.
    """
    if name not in BACKENDS:
        raise InputError(f"--backend: expected a known backend, got {name!r}{nearest(name, BACKENDS)}")
    if name == "numpy":
        if device is not None:
            raise InputError(f"--device: expected none with --backend numpy, got {device}")
        return NumpyBackend()
    from aw4d.backend_opencl import OpenCLBackend  # a run on NumPy must not need an OpenCL loader

    if name == "opencl" or device is not None:
        return OpenCLBackend(device)
    try:
        chosen: Backend = OpenCLBackend()
    except InputError as error:
        log.warning("no usable OpenCL device, running on NumPy, some 100 times slower (%s)", error)
        return NumpyBackend()
    log.info("running on %s", chosen.name)
    return chosen


def frames_of(
    clip: Clip, made: Plan, backend: Backend, chosen: Sequence[int], layers: Sequence[str] = (), *, linear: bool = True
) -> Iterator[Frame]:
    """Edited frames in the order asked for; the next ones are decoded while one is computed.

    `layers` may name `EACH_LIGHT` too, the radiance of every local light alone, and `LABELS`. With `linear` frames have
    `rgb` beside their image: four times as many bytes.
    """
    own = [layer for layer in layers if layer not in (EACH_LIGHT, LABELS)]
    check_layers(made, own)
    labels = [name for name in LABEL_PLANES if LABELS in layers and name in clip.planes]
    depths = [name for name in ("depth", *PARTICLE_DEPTHS) if LABELS in layers and name in {"depth", *made.layers}]
    read = tuple(dict.fromkeys((*made.planes, *labels)))
    wanted = list(dict.fromkeys((*own, *depths)))
    _make_ready(backend, clip, made, wanted)
    made = with_clip_exposure(clip, made, backend)
    pictures = ["rgb"] * linear + [IMAGE]
    kept = read if EACH_LIGHT in layers else labels
    for index, source, out in _rendered(clip, made, backend, chosen, read, kept, wanted, pictures):
        image, rgb = out.pop(IMAGE), out.pop("rgb", None)
        if EACH_LIGHT in layers:
            out |= each_light(backend, source, made, index)
        if LABELS in layers:
            edited = np.minimum.reduce([out[name] for name in depths])
            out = {name: plane for name, plane in out.items() if name in own or name not in depths}
            out |= {name: source[name] for name in labels} | {EDITED_DEPTH: edited}
        yield Frame(index=index, time=source.time, image=image, layers=out, linear=rgb)


def _make_ready(backend: Backend, clip: Clip, made: Plan, layers: Sequence[str]) -> None:
    """Begin with what takes time before passes first run."""
    passes = {step.name: step.params for step in made.steps}
    backend.prepare([*passes, SHOW], layers)
    camera = clip.info.camera(0)
    if twin := backend.twin(list(passes), layers, camera.shape):
        from aw4d.beside import begin as begin_beside  # a run on NumPy must not need an OpenCL loader

        begin_beside(twin, passes, made.planes, layers, camera, lambda: made.scene(0))


def _rendered(
    clip: Clip,
    made: Plan,
    backend: Backend,
    chosen: Sequence[int],
    read: Sequence[str],
    kept: Sequence[str],
    wanted: Sequence[str],
    pictures: Sequence[str],
) -> Iterator[tuple[int, GBuffer, dict[str, NDArray[Any]]]]:
    """Number, the planes to be kept, and results of every frame. A frame is begun before the last one is waited for."""
    begun: deque[tuple[int, GBuffer, Callable[[], dict[str, NDArray[Any]]]]] = deque()
    read_ahead = mapped_ahead(partial(_read, clip, made, read, kept), chosen)
    for index, (source, frame, scene) in zip(chosen, read_ahead, strict=True):
        begun.append((index, source, begin(backend, frame, scene, made, wanted, pictures)))
        if len(begun) > 1:
            first, source, wait = begun.popleft()
            yield first, source, wait()
    for index, source, wait in begun:
        yield index, source, wait()


def _read(
    clip: Clip, made: Plan, planes: Sequence[str], kept: Sequence[str], index: int
) -> tuple[GBuffer, GBuffer, Scene]:
    """A frame of the clip with the planes to be kept, and what a backend takes of it."""
    source = clip.frame(index, planes)
    return source.only(kept), *inputs(source, made, index)


def with_clip_exposure(clip: Clip, made: Plan, backend: Backend) -> Plan:
    """The plan with one exposure for the whole clip where its night grading asks for that.

    The median of what some frames spread over the clip measure: a function of the clip, whichever frames are rendered.
    """
    graded = made.settings.night_grade
    if not graded.steady or graded.luminance is not None or all(step.name != "night_grade" for step in made.steps):
        return made
    ungraded = before_grading(made)
    seen = []
    for index in sorted(set(np.linspace(0, len(clip) - 1, EXPOSURE_FRAMES).round().astype(int).tolist())):
        rgb = render(backend, clip.frame(index, made.planes), ungraded, index)["rgb"]
        seen.append(np.percentile(rgb @ LUMINANCE, graded.percentile, method="inverted_cdf"))
    fixed = dataclasses.replace(graded, luminance=float(np.median(seen)))
    steps = tuple(dataclasses.replace(s, params=fixed) if s.name == "night_grade" else s for s in made.steps)
    return dataclasses.replace(made, steps=steps, settings=dataclasses.replace(made.settings, night_grade=fixed))


def edit(
    clip: Clip,
    weather: str,
    *,
    backend: str = "auto",
    device: int | None = None,
    frames: Sequence[int] | None = None,
    assignments: Sequence[str] = (),
    quality: str = DEFAULT_QUALITY,
    layers: Sequence[str] = (),
) -> Iterator[Frame]:
    """Edit a clip.

    Parameters
    ----------
    clip
        An open clip.
    weather
        "snow", "rain", "fog", "overcast", "dawn", "dusk" or "night", or several of them: "rain+night".
    backend, device
        "auto", "opencl" or "numpy", and the device's index (see `aw4d doctor`).
    frames
        Indices; all by default. Any subset comes out bit-equal to the same frames of a whole run.
    assignments
        Parameters as `group.field=value`, for example "fog.visibility_m=60".
    quality
        "exact", "balanced" or "fast": error against time; see docs/quality.md.
    layers
        Names of the layers wanted beside the picture.

    Yields
    ------
    Frame
        The picture, scene-linear and 8-bit, and layers.

    Raises
    ------
    InputError
        Anything asked for does not exist or cannot work; says what.
    """
    made = plan(clip, weather, assignments, quality)
    chosen = range(len(clip)) if frames is None else frames
    yield from frames_of(clip, made, open_backend(backend, device), chosen, layers)
