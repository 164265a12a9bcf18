"""What people use today: pixels painted over by chance. For its time alone: it knows neither depth nor light."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import albumentations
import numpy as np
from numpy.typing import NDArray

NAMES = ("RandomFog", "RandomRain", "RandomSnow")


def prepared(name: str, picture: NDArray[np.uint8]) -> Callable[[], Any]:
    """A call of one of albumentations' weathers on a picture (H, W, 3) sRGB uint8."""
    transform = getattr(albumentations, name)(p=1.0)
    return lambda: transform(image=picture)
