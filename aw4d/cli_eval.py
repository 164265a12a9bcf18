"""The command `aw4d eval`: its many inputs, and where its results go."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aw4d.console import out_console, watched

METRICS = (
    "psnr, ssim, edge-f1, si-rmse, seg, iou, flicker, shadow, visibility, clip, identity, fvd, dover, 2afc; or all."
)
_INPUTS, _MODELS, _TABLES, _OUT = "What some metrics need", "Models, never fetched", "Tables", "Results"


def _given(text: str | None = None, panel: str = _INPUTS) -> object:
    return typer.Option(help=text, rich_help_panel=panel)


def eval_(
    metric: Annotated[str | None, typer.Argument(help=METRICS)] = None,
    ref: Annotated[
        Path | None, typer.Option(help="Before: video, folder of pictures or clip, or a folder of such.")
    ] = None,
    gen: Annotated[Path | None, typer.Option(help="After the edit: the same.")] = None,
    preset: Annotated[str | None, typer.Option(help="Convention: paper, pai-bench, eigen, …")] = None,
    pairs: Annotated[Path | None, typer.Option(help="CSV with columns ref, gen, in place of stems.")] = None,
    frames: Annotated[str | None, typer.Option(help="A:B as in Python, of both sides.")] = None,
    stride: Annotated[str | None, typer.Option(help="N: every N-th frame; R:G: of ref and of gen.")] = None,
    resize: Annotated[str | None, typer.Option(help="WxH that both sides are brought to.")] = None,
    clip: Annotated[Path | None, _given("Clip of the scene, where ref is none.")] = None,
    camera: Annotated[Path | None, _given("JSON with K, width, height, for boxes without a clip.")] = None,
    calib: Annotated[Path | None, _given("KITTI's calibration file, for its labels.")] = None,
    first_frame: Annotated[int, _given("Number of the first frame in files of boxes.")] = 0,
    min_score: Annotated[float | None, _given("Leave out boxes that a detector is less sure of.")] = None,
    categories: Annotated[Path | None, _given("JSON with names of a detector's category numbers.")] = None,
    ref_depth: Annotated[Path | None, _given("Depth: folder, .npz or clip.")] = None,
    gen_depth: Annotated[Path | None, _given("The same of gen.")] = None,
    ref_disparity: Annotated[bool, _given("Its depth is disparity, as Depth Anything's.")] = False,
    gen_disparity: Annotated[bool, _given("The same of gen.")] = False,
    ref_boxes: Annotated[Path | None, _given("3D boxes: JSON, KITTI labels or clip.")] = None,
    gen_boxes: Annotated[Path | None, _given("The same of gen.")] = None,
    ref_labels: Annotated[Path | None, _given("Train ids: folder of PNG.")] = None,
    gen_labels: Annotated[Path | None, _given("The same of gen.")] = None,
    clip_weights: Annotated[Path | None, _given("CLIP's file of weights.", _MODELS)] = None,
    clip_model: Annotated[str | None, _given("open_clip's name of the model.", _MODELS)] = None,
    i3d_weights: Annotated[Path | None, _given("I3D as TorchScript.", _MODELS)] = None,
    features: Annotated[Path | None, _given(".npz of features, in place of a model.", _MODELS)] = None,
    base: Annotated[str | None, _given("Text: what the scene shows.", _MODELS)] = None,
    instruction: Annotated[str | None, _given("Text: what the edit shall do.", _MODELS)] = None,
    prompts: Annotated[Path | None, _given("CSV with columns gen, base, instruction.", _MODELS)] = None,
    prompt_mode: Annotated[str | None, _given("base, instruction or joined.", _MODELS)] = None,
    scores: Annotated[Path | None, _given("DOVER's scores, CSV or JSON.", _TABLES)] = None,
    responses: Annotated[Path | None, _given("Answers of people, CSV.", _TABLES)] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Everything.", rich_help_panel=_OUT)] = None,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="A row a frame.", rich_help_panel=_OUT)] = None,
    plot: Annotated[Path | None, _given("Curves and distributions: .png, .svg or .pdf.", _OUT)] = None,
    label: Annotated[list[str] | None, _given("KEY=VALUE for the JSON: method=Ours. Repeatable.", _OUT)] = None,
    overwrite: Annotated[bool, _given("Replace files of results.", _OUT)] = False,
    self_test: Annotated[bool, typer.Option("--self-test", help="Values that are known exactly, and exit.")] = False,
) -> None:
    """Measure edited videos: one metric, or all that the inputs allow."""
    from aw4d.errors import InputError
    from aw4d.evaluation.pairs import Selection
    from aw4d.evaluation.report import check_outputs, labels_of, report, show_self_test
    from aw4d.evaluation.request import Request
    from aw4d.evaluation.run import evaluate

    if self_test:
        if not show_self_test(out_console, i3d_weights):
            raise typer.Exit(1)
        return
    if metric is None:
        raise InputError(f"eval: expected a metric ({METRICS.rstrip('.')}), got none")
    labels = labels_of(label or [])
    request = Request(
        ref=ref,
        gen=gen,
        pairs=pairs,
        selection=Selection(frames=frames, stride=stride, resize=resize),
        clip=clip,
        camera=camera,
        calib=calib,
        first_frame=first_frame,
        min_score=min_score,
        categories=categories,
        ref_depth=ref_depth,
        gen_depth=gen_depth,
        ref_disparity=ref_disparity,
        gen_disparity=gen_disparity,
        ref_boxes=ref_boxes,
        gen_boxes=gen_boxes,
        ref_labels=ref_labels,
        gen_labels=gen_labels,
        clip_weights=clip_weights,
        clip_model=clip_model,
        i3d_weights=i3d_weights,
        features=features,
        base=base,
        instruction=instruction,
        prompts=prompts,
        prompt_mode=prompt_mode,
        scores=scores,
        responses=responses,
    )
    check_outputs(request, json_file, csv_file, plot, overwrite=overwrite)
    found = evaluate(metric, request, preset=preset, watch=watched)
    report(found, request, labels, out_console, json_file=json_file, csv_file=csv_file, plot=plot)
    if found.failed:
        raise typer.Exit(2)
