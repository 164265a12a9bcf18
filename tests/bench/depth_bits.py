"""What quantised depth does to fog and to a lit night: 8, 10, 12 and 16 bits against float, on the built-in street.

Run as `python -m tests.bench.depth_bits [PLOT.png]`. The paper ablates integer depth by eye ("Effect of 4D
reconstruction"); here is the curve. Depth is quantised evenly between the frame's nearest and farthest surface, as in
relative 8-bit maps. The night's normals are computed from the depth at hand, as extraction does.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aw4d import street
from aw4d.colour import encode_srgb8
from aw4d.extract.normals import normals_from_depth
from aw4d.gbuffer import GBuffer
from aw4d.lights.ego import headlights
from aw4d.lights.light import Light
from aw4d.lights.street_lamps import spots
from aw4d.params import FogParams, HeadlightParams, SpotLightsParams, StreetLampParams
from aw4d.passes import PASSES
from tests import fog_inputs, lit_inputs

BITS = (8, 10, 12, 16)
WHITE_CD_M2 = 12.0
FOG = FogParams(visibility_m=60, color=(0.35, 0.35, 0.35))
Depth = NDArray[np.float32]


def quantised(depth: Depth, bits: int) -> Depth:
    """Depth in 2^bits even steps from its nearest to its farthest value."""
    near, far, steps = float(depth.min()), float(depth.max()), 2**bits - 1
    return (np.round((depth - near) / (far - near) * steps) / steps * (far - near) + near).astype(np.float32)


def foggy(whole: GBuffer, depth: Depth) -> Mapping[str, NDArray[np.float64]]:
    """The frame in fog, with headlights."""
    planes = {name: whole[name] for name in PASSES["fog"].reads} | {"depth": depth}
    source = GBuffer(planes, camera=whole.camera, time=whole.time)
    return fog_inputs.reference(source, headlights(HeadlightParams(), white_cd_m2=WHITE_CD_M2), FOG)


def night(whole: GBuffer, depth: Depth) -> NDArray[np.float64]:
    """The frame under street lamps and headlights alone."""
    planes: dict[str, Any] = {name: whole[name] for name in PASSES["spot_lights"].reads} | {"depth": depth}
    planes["normal"] = normals_from_depth(depth, camera=whole.camera, sky=whole["sky"])
    source = GBuffer(planes, camera=whole.camera, time=whole.time)
    return lit_inputs.reference(source, _lamps(), SpotLightsParams())


def _lamps() -> list[Light]:
    hanging = spots(street.lamps(), StreetLampParams(), white_cd_m2=WHITE_CD_M2, name="street")
    return hanging + headlights(HeadlightParams(), white_cd_m2=WHITE_CD_M2)


def _codes(found: Any, truth: Any) -> NDArray[np.int64]:
    return np.abs(encode_srgb8(found).astype(np.int64) - encode_srgb8(truth))


def curves(whole: GBuffer) -> dict[int, dict[str, float]]:
    """Errors by bits: of the foggy and of the lit picture in 8-bit codes, of in-scatter over its peak."""
    fog, lit = foggy(whole, whole["depth"]), night(whole, whole["depth"])
    out = {}
    for bits in BITS:
        depth = quantised(whole["depth"], bits)
        coarse = foggy(whole, depth)
        fog_codes, lit_codes = _codes(coarse["rgb"], fog["rgb"]), _codes(night(whole, depth), lit)[~whole["sky"]]
        glow = np.abs(coarse["in_scatter"] - fog["in_scatter"]).max() / fog["in_scatter"].max()
        out[bits] = {
            "fog, mean": float(fog_codes.mean()),
            "fog, 99th percentile": float(np.percentile(fog_codes, 99)),
            "fog, most": float(fog_codes.max()),
            "in-scatter": float(glow),
            "night, mean": float(lit_codes.mean()),
            "night, 99th percentile": float(np.percentile(lit_codes, 99)),
            "night, most": float(lit_codes.max()),
        }
    return out


def plot(whole: GBuffer, found: dict[int, dict[str, float]], path: str) -> None:
    """Curves over the bits, and the lit street in float and in 8 bits."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 6.4), layout="constrained")
    axes = figure.subplot_mosaic([["curve", "float"], ["curve", "coarse"]], width_ratios=[1.1, 1])
    for name, style in (("fog", "o--"), ("night", "s-")):
        for measure in ("mean", "99th percentile"):
            values = [max(found[bits][f"{name}, {measure}"], 1e-3) for bits in BITS]
            axes["curve"].plot(BITS, values, style, alpha=1 if measure == "mean" else 0.5, label=f"{name}, {measure}")
    axes["curve"].set(yscale="log", xticks=BITS, xlabel="bits of depth", ylabel="error [8-bit codes]")
    axes["curve"].axhline(0.5, color="grey", lw=0.8)
    axes["curve"].legend()
    for name, depth in (("float", whole["depth"]), ("coarse", quantised(whole["depth"], BITS[0]))):
        axes[name].imshow(encode_srgb8(night(whole, depth)))
        axes[name].set_title("depth in float" if name == "float" else f"depth in {BITS[0]} bits")
        axes[name].axis("off")
    figure.savefig(path, dpi=100)


def main() -> None:
    """Print the table; draw it where a path is given."""
    whole = street.frame(28, width=640, height=352)
    depth = whole["depth"]
    found = curves(whole)
    print(f"depth {depth.min():.1f} to {depth.max():.1f} m; fog of {FOG.visibility_m:g} m; errors in 8-bit codes")
    for bits, row in found.items():
        step = (depth.max() - depth.min()) / (2**bits - 1) * 100
        print(f"{bits:3} bits, steps of {step:7.3f} cm: " + ", ".join(f"{k} {v:.3g}" for k, v in row.items()))
    if len(sys.argv) > 1:
        plot(whole, found, sys.argv[1])


if __name__ == "__main__":
    main()
