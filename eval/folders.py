"""Where what is kept from run to run lies."""

from __future__ import annotations

import os
from pathlib import Path


def user_folder() -> Path:
    """Where caches of this user live: `autoweather4d` in $XDG_CACHE_HOME, or in ~/.cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "autoweather4d"
