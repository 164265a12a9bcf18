"""The command line: results on stdout, progress and log on stderr, exit 0, 1 (job failed) or 2 (bad usage or input)."""

from __future__ import annotations

import json
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.logging import RichHandler

from aw4d.cli_bench import bench
from aw4d.cli_eval import eval_
from aw4d.console import bar, err_console, out_console, watched
from aw4d.errors import InputError, JobError
from aw4d.interrupts import Interrupted, raised
from aw4d.overlap import THREAD
from aw4d.quality import DEFAULT_QUALITY
from eval.errors import MetricError

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

    from aw4d.backend import Backend as AnyBackend
    from aw4d.clip import Clip
    from aw4d.io.source import Source
    from aw4d.pipeline import Plan

# Every command imports what it runs when it runs, so that none pays for another's libraries.
app = typer.Typer(
    help="Change the weather of recorded driving video.", no_args_is_help=True, pretty_exceptions_enable=False
)
ingest_app = typer.Typer(help="Turn a recording into a clip (a Zarr folder, a chunk a frame).", no_args_is_help=True)
app.add_typer(ingest_app, name="ingest")
reproduce_app = typer.Typer(help="The paper's results.", no_args_is_help=True)
app.add_typer(reproduce_app, name="reproduce")
app.command("eval")(eval_)
app.command("bench")(bench)

ClipPath = Annotated[Path, typer.Argument(help="A clip made by `aw4d ingest`.")]
OutClip = Annotated[Path, typer.Option("-o", "--out", help="The clip to write.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the clip if it exists.")]
Weather = Annotated[
    str, typer.Option("--weather", "-w", help="snow, rain, fog, overcast, dawn, dusk, night; or several: rain+night.")
]
Set = Annotated[list[str] | None, typer.Option("--set", help="A parameter: fog.visibility_m=60. Repeatable.")]
Quality = Annotated[str, typer.Option(help="exact, balanced or fast: error against time.")]
Frames = Annotated[str | None, typer.Option("--frames", help="A:B as in Python, or one frame.")]
Json = Annotated[bool, typer.Option("--json", help="JSON instead of a table.")]
Backend = Annotated[str, typer.Option("--backend", help="auto, opencl or numpy.")]
Device = Annotated[int | None, typer.Option("--device", help="Index of an OpenCL device, see `aw4d doctor`.")]


@app.callback()
def _common(quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No progress and no log.")] = False) -> None:
    err_console.quiet = quiet
    handler = RichHandler(console=err_console, show_time=False, show_path=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    logging.getLogger("aw4d").setLevel(logging.ERROR if quiet else logging.INFO)


def _show(bar: Progress, task: TaskID, done: int, total: int) -> None:
    bar.update(task, completed=done, total=total)


@app.command()
def doctor() -> None:
    """Build and run a kernel on every OpenCL device; say which one is used and why the others are not."""
    from aw4d.doctor import report

    if not report(out_console):
        raise typer.Exit(1)


@app.command()
def demo(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for videos and contact sheet.")] = Path("out/demo"),
    frames: Annotated[int, typer.Option(min=1, help="Length of the built-in clip.")] = 57,
    width: Annotated[int, typer.Option(min=16, help="[px]")] = 1280,
    height: Annotated[int, typer.Option(min=16, help="[px]")] = 704,
    backend: Backend = "auto",
    device: Device = None,
) -> None:
    """Render the built-in street in every weather: one video each and a contact sheet."""
    from aw4d.clip import Clip
    from aw4d.demo import run
    from aw4d.render import open_backend

    chosen = open_backend(backend, device)
    path = out / f"street_{width}x{height}_{frames}.aw4d"
    if not path.exists():
        _ingest_street(path, frames, width, height)
    for file in run(Clip(path), out, chosen, lambda items, name: watched(items, name, frames)):
        print(file)


@contextmanager
def _drawn(what: str, total: int) -> Iterator[Callable[[int, int], None]]:
    """A bar for an ingest, to be told how far it is; where it is stopped, the bar ends and a line says what then."""
    try:
        with bar() as progress:
            task = progress.add_task(what, total=total)
            yield partial(_show, progress, task)
    except Interrupted:
        err_console.print("the same command goes on where this one is stopped")
        raise


def _ingest_street(path: Path, frames: int, width: int, height: int) -> None:
    from aw4d.ingest import ingest_street

    with _drawn("drawing the street", frames) as show:
        ingest_street(path, frames=frames, width=width, height=height, progress=show)


def _ingest(source: Source, out: Path, overwrite: bool) -> None:
    from aw4d.ingest import ingest

    with _drawn("ingesting", len(source.info)) as show:
        clip = ingest(source, out, overwrite=overwrite, progress=show)
    for sentence in clip.info.approximations:
        err_console.print(f"- {sentence}", markup=False, soft_wrap=True)
    print(out)


@ingest_app.command()
def kitti(
    src: Annotated[Path, typer.Argument(help="A raw drive: …_drive_0013_sync, calibration in its parent folder.")],
    out: OutClip,
    labels: Annotated[Path | None, typer.Option(help="Tracking labels (default: label_02*.txt in the drive).")] = None,
    skip_missing: Annotated[bool, typer.Option("--skip-missing", help="Leave out frames without a scan.")] = False,
    overwrite: Overwrite = False,
) -> None:
    """A KITTI raw drive: image_02, velodyne_points, calibration; oxts and tracking labels where there are any."""
    from aw4d.io.kitti import open_kitti

    _ingest(open_kitti(src, labels=labels, skip_missing=skip_missing), out, overwrite)


@ingest_app.command()
def nuscenes(
    src: Annotated[Path, typer.Argument(help="Folder with info .pkl, camera pictures and LiDAR scans.")],
    out: OutClip,
    overwrite: Overwrite = False,
) -> None:
    """NuScenes keyframes of the front camera."""
    from aw4d.io.nuscenes import open_nuscenes

    _ingest(open_nuscenes(src), out, overwrite)


@ingest_app.command("frames")
def frames_(
    src: Annotated[Path, typer.Argument(help="Folder with rgb/, depth/ and any other planes' folders.")],
    out: OutClip,
    focal_px: Annotated[float | None, typer.Option(help="Focal length [px], without intrinsics.json.")] = None,
    fov_deg: Annotated[
        float | None, typer.Option(help="Horizontal field of view, instead of the focal length.")
    ] = None,
    fps: Annotated[float, typer.Option(help="Frames a second, without times.txt.")] = 10.0,
    depth_scale: Annotated[float | None, typer.Option(help="Metres in one unit (default: PNG 1/256, else 1).")] = None,
    relative_depth: Annotated[bool, typer.Option(help="Depth is known up to scale and bias; it is aligned.")] = False,
    camera_height_m: Annotated[float | None, typer.Option(help="Camera above the road [m].")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Folders of pictures and planes, paired by file name: rgb/ and depth/, optionally normal/, albedo/, sky/, …"""
    from aw4d.io.frames import open_frames

    source = open_frames(
        src,
        focal_px=focal_px,
        fov_deg=fov_deg,
        fps=fps,
        depth_scale=depth_scale,
        relative_depth=relative_depth,
        camera_height_m=camera_height_m,
    )
    _ingest(source, out, overwrite)


@ingest_app.command()
def video(
    src: Annotated[Path, typer.Argument(help="A video of one camera that looks ahead over a road.")],
    out: OutClip,
    camera_height_m: Annotated[float, typer.Option(help="Camera above the road [m].")] = 1.5,
    fov_deg: Annotated[float, typer.Option(help="Horizontal field of view.")] = 60.0,
    overwrite: Overwrite = False,
) -> None:
    """A video and nothing else: depth from the ground plane, which is crude; says what is approximate."""
    from aw4d.io.video import open_video

    _ingest(open_video(src, camera_height_m=camera_height_m, fov_deg=fov_deg), out, overwrite)


@app.command()
def info(clip: ClipPath, as_json: Json = False) -> None:
    """Say what a clip holds, its ranges and calibration, and what is missing."""
    from aw4d.clip import Clip
    from aw4d.info import describe, show

    opened = Clip(clip)
    if as_json:
        print(json.dumps(describe(opened), indent=2))
    else:
        show(opened, out_console)


@app.command()
def edit(
    clip: ClipPath,
    weather: Weather,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="A video (.mp4) or a folder of images; optional with --explain.")
    ] = None,
    set_: Set = None,
    quality: Quality = DEFAULT_QUALITY,
    frames: Frames = None,
    backend: Backend = "auto",
    device: Device = None,
    kind: Annotated[str, typer.Option("--format", help="Images of a folder: png or exr (scene-linear).")] = "png",
    layers: Annotated[Path | None, typer.Option(help="Folder for the weather's layers, EXR.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what an earlier edit wrote.")] = False,
    explain: Annotated[
        bool, typer.Option("--explain", help="Say what runs, what is left out and why, times, and errors.")
    ] = False,
) -> None:
    """Change the weather of a clip. A .json beside the output records what made it."""
    if out is None and (not explain or layers is not None):
        raise InputError("-o: expected a video (.mp4) or a folder of images to write; only --explain alone needs none")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # no product here is large, and its threads begin by spinning
    with ThreadPoolExecutor(1) as beside:  # drivers start while modules are imported and lamps are sought
        beside.submit(_start_drivers, backend, device)
        from aw4d.age import process_age
        from aw4d.clip import Clip, indices
        from aw4d.output import check_target, write_edit
        from aw4d.pipeline import plan
        from aw4d.render import open_backend

        opened = Clip(clip)
        opening = beside.submit(open_backend, backend, device)
        made = plan(opened, weather, set_ or (), quality)
    chosen = indices(frames, len(opened))
    if out is not None:
        check_target(out, kind=kind, layer_folder=layers, overwrite=overwrite)
    for name, reason in made.skipped.items():
        logging.getLogger("aw4d").info("%s is not run: %s", name, reason)
    runs_on = opening.result()
    explained = _explained(opened, made, runs_on, chosen) if explain else None
    if out is None:
        return
    write_edit(
        opened,
        made,
        runs_on,
        chosen,
        out,
        kind=kind,
        layer_folder=layers,
        explained=explained,
        watch=lambda items: watched(items, weather, len(chosen)),
        started=time.perf_counter() - process_age(),
    )
    print(out)


def _start_drivers(backend: str, device: int | None) -> None:
    """Try devices as `open_backend` does, which finds them tried and says what is wrong with them."""
    if backend != "numpy":
        from aw4d import opencl

        opencl.choose(device)


def _explained(clip: Clip, made: Plan, backend: AnyBackend, chosen: Sequence[int]) -> dict[str, Any]:
    from aw4d.explain import explain, show

    found = explain(clip, made, backend, chosen)
    show(made, found, out_console)
    return found.to_json()


@app.command()
def compare(
    clip: ClipPath,
    weather: Weather,
    set_: Set = None,
    quality: Quality = DEFAULT_QUALITY,
    frames: Frames = "0:1",
    as_json: Json = False,
) -> None:
    """Run the same frames on every device and print how far each pass lies from the NumPy reference."""
    from rich.table import Table

    from aw4d.clip import Clip, indices
    from aw4d.compare import BAR_MAX, BAR_P9999, to_json
    from aw4d.compare import compare as measure
    from aw4d.pipeline import plan

    opened = Clip(clip)
    chosen = indices(frames, len(opened))
    rows = measure(opened, plan(opened, weather, set_ or (), quality), chosen)
    if as_json:
        print(json.dumps(to_json(rows, chosen), indent=2))
        return
    table = Table(title=f"error against float64; bar: 99.99th percentile {BAR_P9999:g}, maximum {BAR_MAX:g}")
    for column in ("pass", "plane", "device", "maximum", "99.99th percentile", "within"):
        table.add_column(column, overflow="fold")
    for r in rows:
        verdict = "yes" if r.within else "[red]no[/]"
        table.add_row(r.step, r.plane, r.device, f"{r.max_error:.1e}", f"{r.p9999_error:.1e}", verdict)
    out_console.print(table)


@reproduce_app.callback()
def _reproduce() -> None: ...  # keeps `tables` a subcommand while it is the only one


@reproduce_app.command()
def tables(
    results: Annotated[list[Path] | None, typer.Option(help="JSON of `aw4d eval --json`. Repeatable.")] = None,
    as_json: Json = False,
) -> None:
    """Every table of the paper beside this run's results, and the paper's own arithmetic."""
    from aw4d.reproduce import reproduce_tables

    reproduce_tables(results or [], out_console, as_json=as_json)


def _say(error: BaseException) -> None:
    message = " ".join(str(error).split())
    print(f"aw4d: {message}", file=sys.stderr)


def main() -> None:
    """Run the command line; errors end in one line on stderr, with exit status 2 for bad input and 1 for the rest."""
    try:
        with raised():
            app(prog_name="aw4d")
    except (InputError, MetricError) as error:
        _say(error)
        sys.exit(2)
    except JobError as error:
        _say(error)
        sys.exit(1)
    except Interrupted as signal:
        print(f"aw4d: stopped by {signal}; nothing half-written is left behind", file=sys.stderr, flush=True)
        if any(thread.name == THREAD for thread in threading.enumerate()):
            os._exit(1)  # in the middle of a frame: an orderly end would pull the device from under it
        sys.exit(1)


if __name__ == "__main__":
    main()
