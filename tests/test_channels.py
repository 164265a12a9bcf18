"""Orders of channels: what is written plane by plane reads back pixel by pixel, padded rows and all."""

from __future__ import annotations

import numpy as np
import pytest

from aw4d.channels import by_pixels, write_planar


@pytest.mark.parametrize("shape", [(1, 1), (7, 13), (1, 1, 3), (7, 13, 3), (3, 16, 3)])
@pytest.mark.parametrize("padding", [0, 5])
def test_there_and_back(shape: tuple[int, ...], padding: int) -> None:
    values = np.random.default_rng(1).random(shape, dtype=np.float32)
    height, width, *channels = shape
    held = np.full((*(channels or (1,)), height, width + padding), -1, dtype=np.float32)
    write_planar(values, held[..., :width])
    assert (held[..., width:] == -1).all()
    assert np.array_equal(held[..., :width], values[None] if values.ndim == 2 else np.moveaxis(values, -1, 0))
    back = by_pixels(held[..., :width])
    assert np.array_equal(back, values)
    assert back.flags.c_contiguous
