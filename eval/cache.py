"""Features and statistics that were computed before, found again by what they were computed from."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eval import features, hashes
from eval.errors import MetricError
from eval.folders import user_folder

FORMAT = 1  # raised when the same key would mean other arrays


@dataclass(frozen=True, kw_only=True)
class Cache:
    """A folder of .npz files, each named by the hash of all that its arrays depend on; deleting any loses only time."""

    folder: Path = field(default_factory=user_folder)

    def path(self, *, content: str, preprocessing: Mapping[str, Any], weights: str) -> Path:
        """The file of arrays that depend on these alone.

        Parameters
        ----------
        content
            Hash of what was looked at: `eval.hashes.of_file`, `of_files` or `of_frames`.
        preprocessing
            All settings between the two, with the versions of what decodes and computes: whatever JSON can hold.
        weights
            Hash of the file of weights.
        """
        of = {"format": FORMAT, "content": content, "preprocessing": dict(preprocessing), "weights": weights}
        return self.folder / f"{hashes.of_settings(of)}.npz"

    def arrays(self, path: Path, make: Callable[[], features.Arrays]) -> features.Arrays:
        """What the file holds; where there is none, or a damaged one, what `make` returns, kept for the next time."""
        try:
            return features.read(path)
        except MetricError:
            made = make()
        try:
            features.write(path, made)
        except OSError as error:
            warnings.warn(
                f"cache {self.folder}: it cannot be written, and the next run starts anew: {error}", stacklevel=2
            )
        return made
