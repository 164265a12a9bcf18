"""The reference backend: runs `reference_numpy` in float64."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d.backend import Planes, Twin, check_names, frame_arguments, own_arguments
from aw4d.gbuffer import GBuffer
from aw4d.params import Params
from aw4d.passes import EMPTY, IMAGE, PASSES, held_as
from aw4d.scene import Scene
from reference_numpy.srgb8 import srgb8


def _widen(value: Any) -> Any:
    """float32 to float64, exactly; masks and ids as they are."""
    array = np.asarray(value)
    return array.astype(np.float64) if array.dtype.kind == "f" else array


@dataclass(kw_only=True)
class NumpyPlanes:
    """Planes in host memory, float64."""

    shape: tuple[int, int]
    arrays: dict[str, NDArray[Any]]
    arguments: dict[str, Any] = field(default_factory=dict)


class NumpyBackend:
    """Runs each pass's reference function, bound by argument name."""

    name = f"numpy {np.__version__}, float64"

    def prepare(self, names: Sequence[str], layers: Sequence[str] = ()) -> None:
        """Nothing has to be built."""

    def twin(self, names: Sequence[str], layers: Sequence[str], shape: tuple[int, int]) -> Twin | None:
        """Nothing has to be built."""
        return None

    def upload(self, frame: GBuffer, scene: Scene, layers: Sequence[str] = ()) -> NumpyPlanes:
        """Take a frame; every layer is kept in any case."""
        arguments = {name: _widen(value) for name, value in frame_arguments(frame, scene).items()}
        arrays = {name: _widen(frame[name]) for name in frame}
        return NumpyPlanes(shape=frame.camera.shape, arrays=arrays, arguments=arguments)

    def run(self, name: str, planes: Planes, p: Params) -> None:
        """Call `reference_numpy.<name>.<name>` and keep what it returns.

        Raises
        ------
        TypeError
            The function takes an argument that neither frame nor parameters have, or ignores a parameter.
        """
        assert isinstance(planes, NumpyPlanes)
        function = getattr(importlib.import_module(f"reference_numpy.{name}"), name)
        wanted = inspect.signature(function).parameters
        own = p.arguments()
        for plane in set(PASSES[name].optional) - planes.arrays.keys():
            channels, dtype = held_as(plane)
            shape = planes.shape if channels == 1 else (*planes.shape, channels)
            planes.arrays[plane] = _widen(np.full(shape, EMPTY.get(plane, 0), dtype))
        at_hand = planes.arrays | own_arguments(name, planes.arguments) | own
        check_names(name, set(wanted), set(at_hand), set(own))
        planes.arrays.update(function(**{key: at_hand[key] for key in wanted}))

    def put(self, planes: Planes, name: str, values: NDArray[Any]) -> None:
        """Replace a plane."""
        assert isinstance(planes, NumpyPlanes)
        planes.arrays[name] = _widen(values)

    def fetch(self, planes: Planes, names: Sequence[str]) -> Callable[[], dict[str, NDArray[Any]]]:
        """All is there already."""
        found = self.download(planes, names)
        return lambda: found

    def finish(self) -> None:
        """Nothing is ever left to do."""

    def scratch(self, name: str, planes: Planes, buffer: str) -> NDArray[np.uint32] | None:
        """Every pass is one function, which shares nothing."""
        return None

    def download(self, planes: Planes, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Planes by name, rounded to float32, and the image, 8-bit."""
        assert isinstance(planes, NumpyPlanes)
        shown = srgb8(rgb=planes.arrays["rgb"]) if IMAGE in names else {}
        return {name: shown[name] if name in shown else planes.arrays[name].astype(np.float32) for name in names}

    def download64(self, planes: NumpyPlanes, names: Sequence[str]) -> dict[str, NDArray[np.float64]]:
        """Planes by name as they were computed, to measure other backends against."""
        return {name: planes.arrays[name] for name in names}
