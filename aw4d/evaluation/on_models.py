"""Metrics of models' features: CLIP score, identity, FVD; from a model, or from features that another program made."""

from __future__ import annotations

import csv
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from aw4d.clip import Clip
from aw4d.errors import InputError
from aw4d.evaluation.on_scenes import scene_of
from aw4d.evaluation.pairs import Pair, Taken
from aw4d.evaluation.request import Found, MissingInputError, Request, Watch
from aw4d.evaluation.result import versions
from aw4d.evaluation.videos import stem
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
from eval.values import interval

if TYPE_CHECKING:
    from eval.models.clip import Clip as ClipModel
    from eval.models.i3d import I3D

log = logging.getLogger("aw4d")
Picture = NDArray[np.uint8]
GIVEN = "features as given"


def clip(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """CLIP score of every generated video against its text."""
    if (file := _features_of("clip", request)) is not None:
        return {"clip": Found(scores={file.stem: _with_interval(features.clip_score_of(file))}, convention=GIVEN)}
    convention: ClipScore = conventions["clip"]
    if request.prompt_mode is not None:
        convention = _in_mode(convention, request.prompt_mode)
    model = _clip_model(request)
    texts = _texts(request)
    scores: dict[str, Score] = {}
    videos = request.side("gen")
    for taken in videos:
        text = _text(convention, request, texts, taken.name)
        tokens = model.tokens(text)
        if told := cut(tokens, model.context):
            log.warning("%s: %s", taken.name, told)
        images = _images(model, convention, taken, watch)
        score = clip_score(images, model.text(text), tokens=tokens, context=model.context)
        scores[taken.name] = _with_interval(score)
    numbers = {taken.name: taken.chosen for taken in videos}
    return {"clip": Found(scores=scores, numbers=numbers, weights=model.description)}


def identity(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """Similarity of every vehicle of the scene before and after the edit."""
    convention: Identity = conventions["identity"]
    if (file := _features_of("identity", request)) is not None:
        score = features.identity_of(file, convention)
        return {"identity": Found(scores={file.stem: _with_interval(score)}, convention=GIVEN)}
    model = _clip_model(request)
    encode: Callable[[Sequence[Picture]], NDArray[Any]] = (
        model.patches if convention.features == "patch" else lambda crops: model.images(crops, resize="squash")
    )
    scores: dict[str, Score] = {}
    for pair in request.videos():
        boxes = _vehicles(scene_of(request, pair), pair)
        frames = zip(boxes, watch(pair, f"identity: {pair.name}", len(pair)), strict=True)
        records = [convention.frame(ref, gen, here, encode) for here, (ref, gen) in frames]
        scores[pair.name] = _with_interval(convention.pool(records))
    return {"identity": Found(scores=scores, weights=model.description)}


def fvd_of_sets(request: Request, conventions: Mapping[str, Any], watch: Watch) -> dict[str, Found]:
    """FVD of two sets of videos, which need not be of one number."""
    if (file := _features_of("fvd", request)) is not None:
        return {"fvd": Found(scores={file.stem: features.fvd_of(file)}, convention=GIVEN)}
    from eval.models import i3d

    convention: Fvd = conventions["fvd"]
    weights = request.need("i3d_weights", "--i3d-weights, or --features of fvd", WHERE)
    sets = {side: request.side(side) for side in ("ref", "gen")}
    model = i3d.I3D(weights)
    sides = [
        np.concatenate([_features(model, convention, taken) for taken in watch(found, f"fvd: {side}", len(found))])
        for side, found in sets.items()
    ]
    return {"fvd": Found(scores={"all": fvd(*sides)}, weights={"file": weights.name, "sha256": model.sha256})}


WHERE = "docs/evaluation.md says where they come from; nothing is downloaded"
MODES: tuple[Literal["base", "instruction", "joined"], ...] = ("base", "instruction", "joined")
KEYS = {"text": "clip", "frame": "identity"}  # keys by which files of features differ; others are of FVD


def _features_of(metric: str, request: Request) -> Path | None:
    """The file of features, if it is one of this metric."""
    if request.features is None:
        return None
    keys = features.read(request.features).keys()
    kind = next((kind for key, kind in KEYS.items() if key in keys), "fvd")
    return request.features if kind == metric else None


def _with_interval(score: Score) -> Score:
    """The score, a mean of its parts, with the interval of that mean."""
    return replace(score, interval=interval(score.frames))


def _in_mode(convention: ClipScore, mode: str) -> ClipScore:
    for known in MODES:
        if mode == known:
            return replace(convention, prompt=known)
    raise InputError(f"--prompt-mode: expected {', '.join(MODES)}, got {mode!r}")


def _text(convention: ClipScore, request: Request, texts: Mapping[str, dict[str, str]], name: str) -> str:
    given = {"base": request.base, "instruction": request.instruction, **texts.get(name, {})}
    needed = ("base", "instruction") if convention.prompt == "joined" else (convention.prompt,)
    if missing := [part for part in needed if not given[part]]:
        options = " and ".join(f"--{part}" for part in missing)
        raise MissingInputError(f"{options} (or --prompts): a text for {name}")
    return convention.text(**given)


def _texts(request: Request) -> dict[str, dict[str, str]]:
    """Base and instruction of each generated video, by its name."""
    if request.prompts is None:
        return {}
    rows = csv.DictReader(read_text(request.prompts).splitlines())
    if not {"gen", "base", "instruction"} <= set(rows.fieldnames or ()):
        got = ", ".join(rows.fieldnames or ["none"])
        raise InputError(f"{request.prompts}: expected columns gen, base and instruction, got {got}")
    found: dict[str, dict[str, str]] = {}
    for row in rows:
        if not row["gen"]:
            raise InputError(f"{request.prompts}: line {rows.line_num}: expected a gen, got nothing")
        found[stem(Path(row["gen"]))] = {part: row[part] or "" for part in ("base", "instruction")}
    return found


def _clip_model(request: Request) -> ClipModel:
    weights = request.need("clip_weights", "--clip-weights, or --features of the metric", WHERE)
    from eval.models.clip import Clip as Model

    return Model(weights, request.clip_model)


def _images(model: ClipModel, convention: ClipScore, taken: Taken, watch: Watch) -> NDArray[Any]:
    settings = {"resize": convention.resize, "size": taken.size, "frames": str(taken.chosen)}

    def made() -> NDArray[Any]:
        return model.images(watch(taken, f"clip: {taken.name}", len(taken)), resize=convention.resize)

    return _kept(taken, settings, model.identity, made)


def _features(model: I3D, convention: Fvd, taken: Taken) -> NDArray[Any]:
    settings = {**vars(convention), "size": taken.size, "chosen": str(taken.chosen)}
    return _kept(taken, settings, model.sha256, lambda: model.features([convention.clip(taken, taken.name)]))


def _kept(taken: Taken, settings: Mapping[str, Any], weights: str, make: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    """Features out of the cache, or made and kept there."""
    cache, path = Cache(), taken.video.path
    files = sorted(child for child in path.rglob("*") if child.is_file()) if path.is_dir() else [path]
    preprocessing = {**settings, "versions": versions()}
    name = cache.path(content=hashes.of_files(files), preprocessing=preprocessing, weights=weights)
    return cache.arrays(name, lambda: {"features": make()})["features"]


def _vehicles(scene: Clip, pair: Pair) -> list[list[tuple[float, ...]]]:
    """Rectangles of a clip's boxes in the frames of a pair, in the size that its frames are brought to [px]."""
    info = scene.info
    scale = np.array([pair.size[1] / info.width, pair.size[0] / info.height] * 2)
    found = []
    for index in pair.ref_frames:
        boxes = info.boxes[index] if info.boxes else []
        camera, name = Camera(K=info.K[index], width=info.width, height=info.height), str(index)
        seen = boxes_of_layers(
            {name: [box.to_json() for box in boxes]}, {name: info.camera_to_world[index]}, scene.path
        )
        rectangles = [visible(box.corners, camera) for box in seen.get(name, ())]
        found.append([tuple(scale * r) for r in rectangles if isinstance(r, Rectangle)])
    return found
