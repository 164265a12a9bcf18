"""Features in .npz files, so that the arithmetic of FVD, CLIP score and identity runs without a model.

fvd
    `ref` (N, d) and `gen` (M, d), one row a video. In place of either its statistics: `ref_mean` (d,),
    `ref_covariance` (d, d) over N - 1, and `ref_count`.
clip
    `images` (T, E), one row a frame; `text` (E,); `tokens`, how many the text has with its start and end; `context`,
    how many of them the model reads.
identity
    `ref` and `gen` (B, d), one row a box, or (B, P, d) of its patches; `frame` (B,), the number of each box's frame.

Other keys may be there and are not read. NumPy's `savez` writes such files; so does `write`.
"""

from __future__ import annotations

import os
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.clip_score import clip_score
from eval.errors import MetricError
from eval.frechet import Statistics
from eval.fvd import fvd
from eval.identity import Identity, by_frame, similarities
from eval.score import Score

Arrays = dict[str, NDArray[Any]]
UNREADABLE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)


def read(path: Path) -> Arrays:
    """All arrays of an .npz file.

    Raises
    ------
    MetricError
        There is no such file, or it is damaged, or none.
    """
    try:
        with zipfile.ZipFile(path), np.load(path, allow_pickle=False) as file:  # NumPy reads other files too
            return {key: file[key] for key in file.files}
    except UNREADABLE as error:
        raise MetricError(f"features {path}: expected an .npz file of arrays: {error}") from error


def write(path: Path, arrays: Mapping[str, Any]) -> None:
    """Arrays to an .npz file, which is either whole or not there: others may read and write it meanwhile."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=".npz")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **arrays)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def of_statistics(side: str, of: Statistics) -> Arrays:
    """The keys under which `write` stores the statistics of a side, "ref" or "gen"."""
    return {f"{side}_mean": of.mean, f"{side}_covariance": of.covariance, f"{side}_count": np.array(of.count)}


def fvd_of(path: Path, *, seed: int = 0) -> Score:
    """FVD of a file's two sets; its keys are in this module's text.

    Raises
    ------
    MetricError
        The file is none, lacks a key, or holds what is no feature.
    """
    arrays = read(path)
    return fvd(_side(arrays, "ref", path), _side(arrays, "gen", path), seed=seed)


def clip_score_of(path: Path) -> Score:
    """CLIP score of a file's embeddings; its keys are in this module's text, what is raised in `fvd_of`'s."""
    arrays = read(path)
    counts = {key: _count(arrays, key, path) for key in ("tokens", "context")}
    return clip_score(_array(arrays, "images", path, (2,)), _array(arrays, "text", path, (1,)), **counts)


def identity_of(path: Path, metric: Identity) -> Score:
    """Identity of a file's boxes; its keys are in this module's text, what is raised in `fvd_of`'s."""
    arrays = read(path)
    ref, gen = (_array(arrays, key, path, (2, 3)) for key in ("ref", "gen"))
    frame = _array(arrays, "frame", path, (1,))
    if len(frame) != len(ref) or not np.issubdtype(frame.dtype, np.integer) or frame.min(initial=0) < 0:
        raise MetricError(f"features {path}: expected `frame` as ({len(ref)},) numbers of frames, got {frame}")
    return metric.pool(by_frame(similarities(ref, gen), frame))


def _side(arrays: Arrays, side: str, path: Path) -> NDArray[Any] | Statistics:
    if side in arrays or f"{side}_mean" not in arrays:
        return _array(arrays, side, path, (2,))
    mean, covariance = (
        _array(arrays, f"{side}_{part}", path, (ndim,)).astype(np.float64)
        for part, ndim in (("mean", 1), ("covariance", 2))
    )
    return Statistics(mean=mean, covariance=covariance, count=_count(arrays, f"{side}_count", path))


def _count(arrays: Arrays, key: str, path: Path) -> int:
    found = float(_array(arrays, key, path, (0,)))
    if not found.is_integer() or found < 0:
        raise MetricError(f"features {path}: expected `{key}` as a whole number, 0 or more, got {found:g}")
    return int(found)


def _array(arrays: Arrays, key: str, path: Path, dimensions: tuple[int, ...]) -> NDArray[Any]:
    if key not in arrays:
        raise MetricError(f"features {path}: expected an array `{key}`, got {', '.join(sorted(arrays)) or 'none'}")
    found = arrays[key]
    if found.ndim not in dimensions or found.dtype.kind not in "iuf":
        expected = " or ".join(str(n) for n in dimensions)
        got = f"{found.ndim} of {found.dtype}"
        raise MetricError(f"features {path}: expected `{key}` as numbers in {expected} dimensions, got {got}")
    return found
