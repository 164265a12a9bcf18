"""Mirrored rays and their way in the picture.

A mirrored ray lies in the plane of the line of sight and the normal, which the picture shows as a line; the rays of a
rough surface's lobe, long at a slant, all but do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from reference_numpy.brdf import MIN_NOV
from reference_numpy.ramps import smoothstep

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NEAR = 0.005  # [1] of the depth, beyond which things count
LOBE = 2.0  # [1] half the lobe's width in elevation, of alpha: that of GGX at half its height, some tail included
MIN_COSINE = 0.05  # looking straight down, there is no plane
MIN_AHEAD = 0.1  # least component ahead of a mirrored ray; below twice it reflections fade
MIN_RISE = 0.25  # [1] least rows a ray climbs in the picture, of one over a level mirror; below twice it they fade


class Height:
    """Height [m] over mirroring places, along directions (N, 3), of what the picture shows columns and rows off."""

    def __init__(self, along: Array, r: Array, Z0: Array, fx: float, fy: float) -> None:
        self.at, self.by_u, self.by_v = np.einsum("...c,...c->...", along, r), along[..., 0] / fx, along[..., 1] / fy
        self.own = self.at * Z0

    def __call__(self, on: Ints, z: Array, columns: Ints, rows: Ints) -> Array:
        """For the pixels `on`, of things at depth z, so many columns to the right and rows up."""
        return z * (self.at[on] + columns * self.by_u[on] - rows * self.by_v[on]) - self.own[on]


class Mirrored:
    """Mirrored rays of pixels, (N,) of them.

    Parameters
    ----------
    u, v
        (N,) their columns and rows [px].
    Z0, normal, roughness
        (N,) depth [m], (N, 3) camera frame, (N,).
    fx, fy, cx, cy
        Intrinsics [px].
    up
        (3,) unit, the world's up in the camera's frame.
    """

    def __init__(
        self, u: Ints, v: Ints, Z0: Array, normal: Array, roughness: Array, fx: float, fy: float, cx: float, cy: float,
        up: Array,
    ) -> None:  # fmt: skip
        self.u, self.v, self.Z0, self.near = u, v, Z0, NEAR * Z0
        n = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-18)
        r = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(len(u))], axis=-1)
        stretch = np.linalg.norm(r, axis=-1)
        S = np.einsum("...c,...c->...", n, r)
        sine = np.clip(-S / stretch, MIN_NOV, 1.0)  # of the angle between surface and ray, before and after
        cosine = np.maximum(np.sqrt(np.maximum(1 - (S / stretch) ** 2, 0.0)), MIN_COSINE)  # of a back as well
        # Square to the ray, upwards; what lies q above it, in its and n's plane, has p.X - p.P = q.
        p = (n * (stretch**2 - 2 * S**2)[:, None] + S[:, None] * r) / (stretch**2 * cosine)[:, None]
        self.above_ray = Height(p, r, Z0, fx, fy)
        self.above_place = Height(np.broadcast_to(up, r.shape), r, Z0, fx, fy)
        self.n, self.NoV, self.view = n, sine, -r / stretch[:, None]
        Lz = 1 / stretch + 2 * sine * n[:, 2]
        self.inv_Lz = 1 / np.maximum(Lz, MIN_AHEAD)
        # Nearly the same plane for all rays of a lobe, and one that runs up the picture: else no reflections.
        across, down = fx * n[:, 0] - (u - cx) * n[:, 2], fy * n[:, 1] - (v - cy) * n[:, 2]
        rise = -down / fy
        self.lean = across / np.minimum(down, -MIN_RISE * fy)  # [px] to the right, a row down
        climbs, upright, ahead = rise / MIN_RISE - 1, 2 - 2 * np.abs(self.lean), Lz / MIN_AHEAD - 1
        self.fit = smoothstep(0.0, 1.0, climbs) * smoothstep(0.0, 1.0, upright) * smoothstep(0.0, 1.0, ahead)
        self.lobe = LOBE * roughness**2  # [rad], half its width
        self.below = smoothstep(0.0, 1.0, 0.5 - 0.5 * sine / (cosine * np.maximum(self.lobe, 1e-6)))
