"""`aw4d eval` as a whole: ideal values of what is identical, what is lacking is named, results are strict JSON."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d import cli
from aw4d.clip import Clip
from aw4d.colour import encode_srgb8
from aw4d.errors import InputError
from aw4d.evaluation.pairs import Selection
from aw4d.evaluation.report import check_outputs, labels_of, report, show_self_test
from aw4d.evaluation.request import Request
from aw4d.evaluation.result import to_json
from aw4d.evaluation.run import METRICS, Findings, evaluate
from aw4d.ingest import ingest_street
from aw4d.io.images import write_png
from aw4d.output import write_edit
from aw4d.pipeline import plan
from aw4d.render import open_backend
from eval.score import Score
from eval.self_test import CASES
from eval.values import Undefined, Value

WIDTH, HEIGHT, FRAMES = 400, 220, 12  # smaller, and the far of the street is too few pixels to tell 200 m from 180
NEEDS_FILES = {"clip", "identity", "fvd", "dover", "2afc", "seg"}


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    """Frames of the street."""
    out = tmp_path_factory.mktemp("street") / "street.clip"
    return ingest_street(out, frames=FRAMES, width=WIDTH, height=HEIGHT)


def pictures(folder: Path, frames: list[NDArray[np.uint8]]) -> Path:
    folder.mkdir(parents=True)
    for index, frame in enumerate(frames):
        write_png(folder / f"{index:06d}.png", frame)
    return folder


def recorded(clip: Clip, order: Any = range(FRAMES)) -> list[NDArray[np.uint8]]:
    return [encode_srgb8(clip.frame(index, ["rgb"])["rgb"]) for index in order]


@pytest.fixture(scope="module")
def copy(street: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clip's own pictures, as an edit that changes nothing."""
    return pictures(tmp_path_factory.mktemp("copy") / "same", recorded(street))


def only(found: Findings) -> Score:
    (result,) = found.results
    (score,) = result.scores.values()
    assert isinstance(score, Score)
    return score


def number(value: Value) -> float:
    assert not isinstance(value, Undefined), value
    return value


def test_what_is_identical_has_the_ideal_value(street: Clip, copy: Path, tmp_path: Path) -> None:
    labels = pictures(tmp_path / "labels", [np.where(street.frame(0)["road"], 0, 255).astype(np.uint8)])
    request = Request(ref=street.path, gen=copy, gen_depth=street.path, gen_boxes=street.path)
    request = dataclasses.replace(request, ref_labels=labels, gen_labels=labels)
    found = {result.metric: result.value for result in evaluate("all", request).results}
    assert found["psnr"] == math.inf
    ideal = {"ssim": 1.0, "edge-f1": 1.0, "si-rmse": 0.0, "iou": 1.0, "seg": 1.0, "shadow": 1.0}
    assert {name: number(found[name]) for name in ideal} == pytest.approx(ideal, abs=1e-9)
    score = only(evaluate("flicker", request))
    assert score.value == score.others["source"]
    # There is no fog: either none is seen, or none that takes a tenth of the contrast over the street.
    assert isinstance(found["visibility"], Undefined)


def test_all_names_what_each_skipped_metric_lacks(street: Clip, copy: Path) -> None:
    results, skipped, failed = evaluate("all", Request(ref=street.path, gen=copy))
    assert not failed
    assert {result.metric for result in results} | skipped.keys() == METRICS.keys()
    assert skipped.keys() == NEEDS_FILES | {"si-rmse", "iou"}
    assert "--gen-depth" in skipped["si-rmse"]
    assert "--gen-boxes" in skipped["iou"]
    assert "--clip-weights" in skipped["clip"]
    assert "--i3d-weights" in skipped["fvd"]
    assert all(text.startswith("needs --") for text in skipped.values())


def test_one_metric_that_lacks_an_input_is_an_error(copy: Path) -> None:
    with pytest.raises(InputError, match="flicker needs --clip"):
        evaluate("flicker", Request(ref=copy, gen=copy))
    with pytest.raises(InputError, match="psnr needs --gen"):
        evaluate("psnr", Request(ref=copy))


def test_unknown_names_are_refused(copy: Path) -> None:
    request = Request(ref=copy, gen=copy)
    with pytest.raises(InputError, match="metric: expected psnr, ssim"):
        evaluate("psrn", request)
    with pytest.raises(InputError, match="--preset: expected paper, pai-bench, got 'eigen'"):
        evaluate("edge-f1", request, preset="eigen")
    with pytest.raises(InputError, match=r"--preset: expected .*pai-bench"):
        evaluate("all", request, preset="nobody's")


def test_all_takes_a_preset_where_a_metric_has_it(copy: Path) -> None:
    found = evaluate("all", Request(ref=copy, gen=copy), preset="pai-bench")
    conventions = {result.metric: result.convention for result in found.results}
    assert conventions["edge-f1"] == "pai-bench"
    assert conventions["psnr"] == "scikit-image"


def test_shuffled_frames_flicker_more(street: Clip, copy: Path, tmp_path: Path) -> None:
    order = np.random.default_rng(1).permutation(FRAMES).tolist()
    shuffled = pictures(tmp_path / "shuffled", recorded(street, order))
    values = [number(only(evaluate("flicker", Request(ref=street.path, gen=gen))).value) for gen in (copy, shuffled)]
    assert values[1] > 2 * values[0]


@pytest.fixture(scope="module")
def fogs(street: Clip, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The street in fog of several visibilities [m], all lamps off, by visibility."""
    out = {}
    for visibility in (200, 100, 50):
        sets = [f"fog.visibility_m={visibility}", "headlights.on=off", "lights.street=off", "lights.vehicles=off"]
        out[visibility] = tmp_path_factory.mktemp("fog") / f"fog_{visibility}.mp4"
        write_edit(street, plan(street, "fog", sets), open_backend("auto"), range(FRAMES), out[visibility])
    return out


def test_denser_fog_is_worse_and_is_measured(street: Clip, fogs: dict[int, Path]) -> None:
    found = []
    for path in fogs.values():
        results = evaluate("all", Request(ref=street.path, gen=path)).results
        found.append({result.metric: number(result.value) for result in results})
    for name in ("edge-f1", "psnr", "visibility"):
        values = [values[name] for values in found]
        assert values == sorted(values, reverse=True), name
    assert [values["visibility"] for values in found] == pytest.approx(list(fogs), rel=0.1)


def test_the_parameter_stands_beside_the_visibility(street: Clip, fogs: dict[int, Path]) -> None:
    score = only(evaluate("visibility", Request(ref=street.path, gen=fogs[100])))
    assert number(score.others["parameter"]) == pytest.approx(100, rel=1e-4)  # 3.912 for -ln 0.02


def test_json_is_strict_and_csv_has_a_row_a_frame(street: Clip, copy: Path, tmp_path: Path) -> None:
    request = Request(ref=street.path, gen=copy)
    found = evaluate("all", request)
    files = {name: tmp_path / f"out.{name}" for name in ("json", "csv", "png")}
    labels = {"method": "Ours"}
    named = {"json_file": files["json"], "csv_file": files["csv"], "plot": files["png"]}
    check_outputs(request, *named.values(), overwrite=False)
    report(found, request, labels, cli.out_console, **named)

    def refuse(text: str) -> None:
        raise AssertionError(text)

    content = json.loads(files["json"].read_text(encoding="utf-8"), parse_constant=refuse)
    assert content == json.loads(json.dumps(to_json(*found, request.given(), labels), allow_nan=False))
    assert content["inputs"] == {"ref": str(street.path), "gen": str(copy)}
    assert content["method"] == "Ours"
    psnr = next(result for result in content["results"] if result["metric"] == "psnr")
    assert psnr["value"] is None
    assert psnr["reason"] == "infinite: the two are equal"
    assert psnr["frames_n"] == FRAMES
    assert {"numpy", "scipy", "aw4d"} <= content["versions"].keys()
    with files["csv"].open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["metric"] == "ssim"]
    assert [row["frame"] for row in rows] == [*map(str, range(FRAMES)), "", ""]
    assert files["png"].stat().st_size > 10_000


def test_several_videos_are_paired_and_averaged(street: Clip, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for name, noise in (("a", 5), ("b", 20)):
        source = recorded(street, range(3))
        noisy = [np.clip(f + rng.normal(0, noise, f.shape), 0, 255).astype(np.uint8) for f in source]
        pictures(tmp_path / "ref" / name, source)
        pictures(tmp_path / "gen" / name, noisy)
    (result,) = evaluate("psnr", Request(ref=tmp_path / "ref", gen=tmp_path / "gen")).results
    assert list(result.scores) == ["a", "b"]
    each = [number(score.value) for score in result.scores.values()]
    assert each[0] > each[1] + 6
    assert number(result.value) == pytest.approx(np.mean(each))
    assert result.interval is not None
    assert result.interval[0] == pytest.approx(each[1])
    assert result.interval[1] == pytest.approx(each[0])


def test_the_interval_of_one_video_holds_its_pooled_value(street: Clip, fogs: dict[int, Path]) -> None:
    (result,) = evaluate("edge-f1", Request(ref=street.path, gen=fogs[200])).results
    low, high = result.interval
    assert low < number(result.value) < high
    (again,) = evaluate("edge-f1", Request(ref=street.path, gen=fogs[200])).results
    assert again.interval == (low, high)


def test_a_part_of_the_frames(street: Clip, fogs: dict[int, Path]) -> None:
    request = Request(ref=street.path, gen=fogs[200], selection=Selection(frames="2:6"))
    whole, part = (
        evaluate("flicker", r).results[0] for r in (dataclasses.replace(request, selection=Selection()), request)
    )
    (all_frames,), (chosen,) = whole.scores.values(), part.scores.values()
    assert chosen.frames == all_frames.frames[2:5]


def test_boxes_of_a_layer_and_of_a_detector(street: Clip, tmp_path: Path) -> None:
    """Boxes as `--layers` writes them, and as a detector would find them, are the clip's own."""
    info = street.info
    layer = {str(i): [box.to_json() for box in boxes] for i, boxes in enumerate(info.boxes)}
    detector = [
        {
            "image_id": i,
            "category_id": 0,
            "score": 1.0,
            "bbox3D": street.info.camera(i).to_camera(box.corners()).tolist(),
        }
        for i, boxes in enumerate(street.info.boxes)
        for box in boxes
    ]
    names = {"categories": [{"id": 0, "name": "car"}]}
    files = {}
    for name, content in (("layer", layer), ("detector", detector), ("names", names)):
        files[name] = tmp_path / f"{name}.json"
        files[name].write_text(json.dumps(content), encoding="utf-8")
    for gen in ("layer", "detector"):
        request = Request(ref=street.path, gen=files[gen], categories=files["names"])
        score = only(evaluate("iou", request))
        assert number(score.value) == pytest.approx(1, abs=1e-9), gen
        assert number(score.others["pairs"]) > 0


def test_models_from_files(street: Clip, copy: Path, tmp_path: Path, open_clip: Any, monkeypatch: Any) -> None:
    from tests.tiny_models import save_clip, save_i3d

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    request = Request(ref=street.path, gen=copy, clip_weights=save_clip(tmp_path / "clip"), instruction="Dense fog.")
    score = only(evaluate("clip", request))
    assert len(score.frames) == FRAMES
    assert -1 <= number(score.value) <= 1
    assert only(evaluate("clip", request)) == score  # out of the cache
    assert number(only(evaluate("identity", request)).value) == pytest.approx(1, abs=1e-6)
    for side in ("ref", "gen"):
        for name in ("a", "b", "c"):
            pictures(tmp_path / side / name, recorded(street)[:: 1 if name == "a" else -1][:11])
    sets = Request(ref=tmp_path / "ref", gen=tmp_path / "gen", i3d_weights=save_i3d(tmp_path / "i3d.pt"))
    (result,) = evaluate("fvd", sets).results
    assert number(result.value) == 0
    assert len(result.weights["sha256"]) == 64


def test_weights_that_are_not_there_say_where_to_get_them(copy: Path, open_clip: Any, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"there is none\. CLIP's weights are for you to fetch"):
        evaluate("clip", Request(ref=copy, gen=copy, instruction="Fog.", clip_weights=tmp_path / "none.pt"))


def test_tables_of_others(tmp_path: Path) -> None:
    scores, responses = tmp_path / "scores.csv", tmp_path / "responses.csv"
    scores.write_text("video,technical,aesthetic\na,0.5,0.25\nb,0.5,0.25\n")
    responses.write_text("left,right,choice\na,b,a\nb,a,a\na,b,b\n")
    found = evaluate("all", Request(scores=scores, responses=responses))
    values = {result.metric: result for result in found.results}
    assert number(values["dover"].value) == pytest.approx(0.572 * 0.5 + 0.428 * 0.25)
    assert number(values["2afc"].scores["a"].value) == pytest.approx(2 / 3)
    assert isinstance(values["2afc"].value, Undefined)  # of methods there is no mean


def test_the_self_test_passes_and_would_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    assert show_self_test(cli.out_console)
    assert {case.metric for case in CASES} >= METRICS.keys() - {"flicker", "shadow", "visibility"}
    wrong = dataclasses.replace(CASES[0], expected=0.5)
    monkeypatch.setattr("aw4d.evaluation.report.CASES", (wrong,))
    assert not show_self_test(cli.out_console)


def test_labels() -> None:
    assert labels_of(["method=Ours", "set=a=b"]) == {"method": "Ours", "set": "a=b"}
    with pytest.raises(InputError, match="--label: expected KEY=VALUE"):
        labels_of(["Ours"])
    with pytest.raises(InputError, match="--label: expected KEY=VALUE"):
        labels_of(["results=1"])


def test_results_never_replace_what_was_read(fogs: dict[int, Path], street: Clip, tmp_path: Path) -> None:
    request = Request(ref=street.path, gen=fogs[50])
    sidecar, inside, there = fogs[50].with_suffix(".json"), street.path / "x.json", tmp_path / "there.json"
    there.write_text("{}")
    for path in (sidecar, inside):
        with pytest.raises(InputError, match="expected another file than what is read"):
            check_outputs(request, path, None, None, overwrite=True)
    with pytest.raises(InputError, match="exists already"):
        check_outputs(request, there, None, None, overwrite=False)
    check_outputs(request, there, None, None, overwrite=True)
    with pytest.raises(InputError, match="got one for two"):
        check_outputs(request, there, there, None, overwrite=True)
    with pytest.raises(InputError, match="no such folder"):
        check_outputs(request, tmp_path / "none" / "x.json", None, None, overwrite=True)
    with pytest.raises(InputError, match="--plot: expected a file ending in"):
        check_outputs(request, None, None, tmp_path / "x.jpg", overwrite=True)


def test_a_metric_that_fails_leaves_the_others(street: Clip, copy: Path, tmp_path: Path) -> None:
    scores = tmp_path / "scores.csv"
    scores.write_text("a,b\n1,2\n")
    found = evaluate("all", Request(ref=street.path, gen=copy, scores=scores))
    assert list(found.failed) == ["dover"]
    assert "technical" in found.failed["dover"]
    assert {"psnr", "flicker"} <= {result.metric for result in found.results}
    with pytest.raises(InputError, match="nothing to measure"):
        evaluate("all", Request())


def test_one_clip_against_a_folder_of_its_edits(street: Clip, fogs: dict[int, Path], tmp_path: Path) -> None:
    folder = tmp_path / "edits"
    folder.mkdir()
    for visibility, path in fogs.items():
        for file in (path, path.with_suffix(".json")):
            (folder / f"fog_{visibility}{file.suffix}").write_bytes(file.read_bytes())
    (result,) = evaluate("visibility", Request(ref=street.path, gen=folder)).results
    found = {name: number(score.value) for name, score in result.scores.items()}
    assert found == pytest.approx({f"fog_{visibility}": visibility for visibility in fogs}, rel=0.1)


def test_edits_of_one_name_are_told_apart(tmp_path: Path) -> None:
    for method in ("ours", "theirs"):
        pictures(tmp_path / method / "rain", [np.full((20, 30, 3), 9, np.uint8)])
    pictures(tmp_path / "source", [np.zeros((20, 30, 3), np.uint8)])
    table = tmp_path / "pairs.csv"
    table.write_text("\ufeffref,gen\nsource,ours/rain\nsource,theirs/rain\n", encoding="utf-8")
    (result,) = evaluate("psnr", Request(ref=tmp_path, gen=tmp_path, pairs=table)).results
    assert [Path(name).parent.name for name in result.scores] == ["ours", "theirs"]


def test_frames_of_other_numbers_are_not_paired(tmp_path: Path) -> None:
    frames = [np.zeros((20, 30, 3), np.uint8)] * 3
    first, second = pictures(tmp_path / "a", frames), pictures(tmp_path / "b", frames)
    for index in (2, 1, 0):
        (second / f"{index:06d}.png").rename(second / f"{index + 1:06d}.png")
    with pytest.raises(InputError, match=r"got 000000 in .* and 000001"):
        evaluate("psnr", Request(ref=first, gen=second))
    assert only(evaluate("psnr", Request(ref=first, gen=second, selection=Selection(stride="1")))).value == math.inf


def test_boxes_of_some_frames_and_of_other_numbers(street: Clip, tmp_path: Path) -> None:
    info, first = street.info, 40
    detections = [
        {
            "image_id": i + first,
            "category_id": 0,
            "score": 0.5,
            "bbox3D": info.camera(i).to_camera(box.corners()).tolist(),
        }
        for i, boxes in enumerate(info.boxes[:5])
        for box in boxes
    ]
    file, names = tmp_path / "boxes.json", tmp_path / "names.json"
    file.write_text(json.dumps(detections))
    names.write_text(json.dumps({"categories": [{"id": 0, "name": "car"}]}))
    request = Request(ref=street.path, gen=file, categories=names, first_frame=first)
    part = dataclasses.replace(request, selection=Selection(frames="0:5"))
    assert number(only(evaluate("iou", part)).value) == pytest.approx(1, abs=1e-9)
    assert number(only(evaluate("iou", request)).value) < 0.9  # later frames have no detections
    unsure = only(evaluate("iou", dataclasses.replace(part, min_score=0.6)))
    assert number(unsure.value) == 0


def test_depth_that_is_disparity(street: Clip, tmp_path: Path) -> None:
    (tmp_path / "disparity").mkdir()
    for index in range(FRAMES):
        np.save(tmp_path / "disparity" / f"{index:03d}.npy", (30 / street.frame(index)["depth"]).astype(np.float32))
    request = Request(ref=street.path, gen=tmp_path / "disparity")
    assert number(only(evaluate("si-rmse", request)).value) > 0.5
    right = dataclasses.replace(request, gen_disparity=True)
    assert number(only(evaluate("si-rmse", right)).value) == pytest.approx(0, abs=1e-6)


def test_labels_of_several_videos_are_one_confusion(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for side in ("ref", "gen"):
        for name, classes in (("a", 2), ("b", 3)):
            pictures(tmp_path / side / name, [rng.integers(0, classes, (20, 30), dtype=np.uint8) for _ in range(2)])
    (result,) = evaluate("seg", Request(ref=tmp_path / "ref", gen=tmp_path / "gen")).results
    assert result.whole is not None
    assert len(result.whole.frames) == 4
    assert result.value == result.whole.value
    assert number(result.value) != np.mean([number(score.value) for score in result.scores.values()])
