"""What a backend is: takes a frame once, runs passes on it in place, gives planes back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from aw4d.gbuffer import GBuffer
from aw4d.params import Params
from aw4d.scene import Scene


class Planes(Protocol):
    """One frame's planes where the backend works on them; valid until the backend's next upload.

    What was asked for with `fetch` before it comes all the same.
    """

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width) [px]."""


class Twin(NamedTuple):
    """How another process opens the same backend."""

    device: int
    width: int


class Backend(Protocol):
    """Runs passes. Raises InputError at construction where it cannot work; never falls back to another one."""

    @property
    def name(self) -> str:
        """What runs, for people: backend, device, version."""

    def prepare(self, names: Sequence[str], layers: Sequence[str] = ()) -> None:
        """Start on what the passes need before they first run, where that takes time."""

    def twin(self, names: Sequence[str], layers: Sequence[str], shape: tuple[int, int]) -> Twin | None:
        """What a second process opens to help with the first run of passes on frames of a size; None: nothing helps."""

    def upload(self, frame: GBuffer, scene: Scene, layers: Sequence[str] = ()) -> Planes:
        """Take a frame, what lights it, and the names of the layers that will be asked for."""

    def run(self, name: str, planes: Planes, p: Params) -> None:
        """Run one pass in place."""

    def put(self, planes: Planes, name: str, values: NDArray[Any]) -> None:
        """Replace a plane by values, (H, W) or (H, W, 3)."""

    def fetch(self, planes: Planes, names: Sequence[str]) -> Callable[[], dict[str, NDArray[Any]]]:
        """Ask for planes, layers and `IMAGE` as they are after the passes so far; what is returned waits for them.

        Between the two the backend takes the next frame.
        """

    def finish(self) -> None:
        """Wait until all that was asked for is done."""

    def scratch(self, name: str, planes: Planes, buffer: str) -> NDArray[np.uint32] | None:
        """What a pass that has just run left in one of its scratch buffers; None where it has no such buffers."""

    def download(self, planes: Planes, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Planes and layers by name, (H, W) or (H, W, 3) float32, and `IMAGE`, 8-bit sRGB of `rgb`, (H, W, 3) uint8."""


def frame_arguments(frame: GBuffer, scene: Scene) -> dict[str, Any]:
    """Camera and lights by the names that passes take, rounded to float32 once for every backend alike."""
    K = frame.camera.K.astype(np.float32)
    camera = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    return camera | scene.arguments()


def unwritable(values: NDArray[Any]) -> NDArray[Any]:
    """The array, closed for writing: as long as frames share it, a backend needs to take it only once."""
    values.flags.writeable = False
    return values


def own_arguments(name: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """What a pass takes: `PASS.ARGUMENT` is that argument of that pass alone, all others are for every pass."""
    own = {key.removeprefix(f"{name}."): value for key, value in arguments.items() if key.startswith(f"{name}.")}
    return {key: value for key, value in arguments.items() if "." not in key} | own


def check_names(name: str, wanted: set[str], at_hand: set[str], own: set[str]) -> None:
    """Arguments bind by name: each wanted one must be at hand, each of the parameters' own must be wanted.

    Raises
    ------
    TypeError
        Either does not hold.
    """
    if missing := sorted(wanted - at_hand):
        raise TypeError(f"{name}: takes {', '.join(missing)}, which neither frame nor parameters have")
    if ignored := sorted(own - wanted):
        raise TypeError(f"{name}: does not take the parameters {', '.join(ignored)}")
