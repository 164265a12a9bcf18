"""Metrics of models' features: CLIP score, identity, FVD; from a model, or from features that another program made."""

from __future__ import annotations

import csv
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.evaluation.pairs import Pair
from aw4d.evaluation.request import Found, Request, Watch
from aw4d.evaluation.result import versions
from aw4d.evaluation.videos import Video, is_video, open_video
from aw4d.io.files import read_text
from eval import features, hashes
from eval.box_iou import Rectangle, visible
from eval.box_readers import boxes_of_layers
from eval.boxes import Camera
from eval.cache import Cache
from eval.clip_score import ClipScore, clip_score, cut
from eval.fvd import Fvd, fvd
from eval.identity import Identity
from eval.score import Score
from eval.values import Undefined

if TYPE_CHECKING:
    from eval.models.clip import Clip as ClipModel
    from eval.models.i3d import I3D

log = logging.getLogger("aw4d")
Picture = NDArray[np.uint8]


def clip(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """CLIP score of every generated video against its text."""
    if request.features is not None:
        return {"clip": Found(scores={request.features.stem: features.clip_score_of(request.features)})}
    convention: ClipScore = conventions["clip"]
    model = _clip_model(request)
    texts = _texts(request)
    scores: dict[str, Score] = {}
    for pair in request.videos():
        text = convention.text(**(texts.get(pair.name) or {"base": request.base, "instruction": request.instruction}))
        tokens = model.tokens(text)
        if told := cut(tokens, model.context):
            log.warning("%s: %s", pair.name, told)
        images = _images(model, convention, pair, watch)
        scores[pair.name] = clip_score(images, model.text(text), tokens=tokens, context=model.context)
    return {"clip": Found(scores=scores, weights=_weights(model))}


def _images(model: ClipModel, convention: ClipScore, pair: Pair, watch: Watch) -> NDArray[Any]:
    settings = {"model": model.model, "resize": convention.resize, "size": pair.size, "frames": str(pair.gen_frames)}

    def made() -> NDArray[Any]:
        pictures = (gen for _, gen in watch(pair, f"clip: {pair.name}", len(pair)))
        return model.images(pictures, resize=convention.resize)

    return _kept(pair.gen.path, settings, model.sha256, made)


def identity(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Similarity of every vehicle of the scene before and after the edit."""
    convention: Identity = conventions["identity"]
    if request.features is not None:
        found = features.identity_of(request.features, convention)
        return {"identity": Found(scores={request.features.stem: found})}
    model = _clip_model(request)
    boxes = _vehicles(request.scene())
    encode: Callable[[Sequence[Picture]], NDArray[Any]] = (
        model.patches if convention.features == "patch" else lambda crops: model.images(crops, resize="squash")
    )
    scores: dict[str, Score] = {}
    for pair in request.videos():
        frames = zip(pair.ref_frames, watch(pair, f"identity: {pair.name}", len(pair)), strict=True)
        records = [convention.frame(ref, gen, boxes[index], encode) for index, (ref, gen) in frames]
        scores[pair.name] = convention.pool(records)
    return {"identity": Found(scores=scores, weights=_weights(model))}


def fvd_of_sets(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """FVD of two sets of videos, which need not be of one number."""
    if request.features is not None:
        return {"fvd": Found(scores={request.features.stem: features.fvd_of(request.features)})}
    from eval.models import i3d

    convention: Fvd = conventions["fvd"]
    model = i3d.I3D(request.need("i3d_weights", "--i3d-weights, or --features", i3d.WHENCE))
    sides = []
    for side in ("ref", "gen"):
        videos = _set(request.need(side, f"--{side}", "a folder of videos"))
        rows = [_features(model, convention, video) for video in watch(videos, f"fvd: {side}", len(videos))]
        sides.append(np.concatenate(rows))
    return {"fvd": Found(scores={"all": fvd(*sides)}, weights=_weights(model))}


def _features(model: I3D, convention: Fvd, video: Video) -> NDArray[Any]:
    def made() -> NDArray[Any]:
        return model.features([convention.clip(video.frames(range(video.count)), video.name)])

    return _kept(video.path, vars(convention), model.sha256, made)


def _clip_model(request: Request) -> ClipModel:
    from eval.models import clip

    return clip.Clip(request.need("clip_weights", "--clip-weights, or --features", clip.WHENCE), request.clip_model)


def _weights(model: Any) -> dict[str, str]:
    return {"file": model.path.name, "sha256": model.sha256}


def _set(path: Path) -> list[Video]:
    paths = [path] if is_video(path) else sorted(child for child in path.iterdir() if is_video(child))
    if not paths:
        raise InputError(f"{path}: expected a folder of videos, got one without any")
    return [open_video(child) for child in paths]


def _kept(path: Path, settings: Mapping[str, Any], weights: str, make: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    """Features out of the cache, or made and kept there."""
    cache = Cache()
    files = sorted(child for child in path.rglob("*") if child.is_file()) if path.is_dir() else [path]
    preprocessing = {**settings, "versions": versions()}
    name = cache.path(content=hashes.of_files(files), preprocessing=preprocessing, weights=weights)
    return cache.arrays(name, lambda: {"features": make()})["features"]


def _texts(request: Request) -> dict[str, dict[str, str | None]]:
    """Base and instruction of each generated video, by its name."""
    if request.prompts is None:
        return {}
    rows = csv.DictReader(read_text(request.prompts).splitlines())
    if not {"gen", "base", "instruction"} <= set(rows.fieldnames or ()):
        got = ", ".join(rows.fieldnames or ["none"])
        raise InputError(f"{request.prompts}: expected columns gen, base and instruction, got {got}")
    return {Path(row["gen"]).stem: {"base": row["base"], "instruction": row["instruction"]} for row in rows}


def _vehicles(scene: Clip) -> list[list[Rectangle]]:
    """Rectangles of the boxes that a clip has, frame by frame, as far as they are in the picture [px]."""
    info = scene.info
    found = []
    for index, boxes in enumerate(info.boxes or [[]] * len(info)):
        camera = Camera(K=info.K[index], width=info.width, height=info.height)
        pose = {str(index): info.camera_to_world[index]}
        seen = boxes_of_layers({str(index): [box.to_json() for box in boxes]}, pose, scene.path)
        rectangles = [visible(box.corners, camera) for box in seen.get(str(index), ())]
        found.append([r for r in rectangles if not isinstance(r, Undefined)])
    return found
