"""What quantised depth does to fog: 8, 10, 12 and 16 bits against float, on the built-in street.

Run as `python -m tests.bench.depth_bits`. The paper ablates integer depth by eye ("Effect of 4D reconstruction"); here
is the curve. Depth is quantised evenly between the frame's nearest and farthest surface, as in relative 8-bit maps.
"""

from __future__ import annotations

import numpy as np

from aw4d import street
from aw4d.colour import encode_srgb8
from aw4d.gbuffer import GBuffer
from aw4d.lights.ego import headlights
from aw4d.params import FogParams, HeadlightParams
from aw4d.passes import PASSES
from tests.fog_inputs import reference

BITS = (8, 10, 12, 16)


def main() -> None:
    """Print the error of the picture in 8-bit sRGB codes, and of the in-scatter relative to its largest value."""
    whole = street.frame(28, width=640, height=352)
    planes = {name: whole[name] for name in PASSES["fog"].reads}
    exact = GBuffer(planes, camera=whole.camera, time=whole.time)
    near, far = float(planes["depth"].min()), float(planes["depth"].max())
    lights = headlights(HeadlightParams(), white_cd_m2=12)
    p = FogParams(visibility_m=60, color=(0.35, 0.35, 0.35))
    truth = reference(exact, lights, p)
    print(f"depth {near:.1f} to {far:.1f} m, fog of {p.visibility_m:g} m")
    for bits in BITS:
        steps = 2**bits - 1
        rounded = np.round((planes["depth"] - near) / (far - near) * steps) / steps * (far - near) + near
        coarse = GBuffer(planes | {"depth": rounded.astype(np.float32)}, camera=whole.camera, time=whole.time)
        found = reference(coarse, lights, p)
        codes = np.abs(encode_srgb8(found["rgb"]).astype(int) - encode_srgb8(truth["rgb"]).astype(int))
        glow = np.abs(found["in_scatter"] - truth["in_scatter"]).max() / truth["in_scatter"].max()
        print(
            f"{bits:3} bits, steps of {(far - near) / steps * 100:7.3f} cm: picture {codes.max():3} codes at most,",
            end="",
        )
        print(f" {codes.mean():.3f} on average; in-scatter {glow:.1e} of its peak")


if __name__ == "__main__":
    main()
