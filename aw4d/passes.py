"""The passes: parameters, planes they read and write, and layers they can give, by the one name of each."""

from __future__ import annotations

from dataclasses import dataclass

from aw4d.params import FogParams, Params


@dataclass(frozen=True, kw_only=True)
class Pass:
    """What the pipeline and the backends must know of a pass; `layers` maps a layer to its number of channels."""

    params: type[Params]
    reads: tuple[str, ...]
    writes: tuple[str, ...]
    layers: dict[str, int]


PASSES: dict[str, Pass] = {
    "fog": Pass(
        params=FogParams,
        reads=("rgb", "depth", "sky"),
        writes=("rgb",),
        layers={"transmittance": 1, "in_scatter": 3, "airlight": 3},
    ),
}
