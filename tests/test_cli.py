"""The command line: one line for every mistake, nothing half-written, results on stdout and the rest on stderr."""

from __future__ import annotations

import ctypes
import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aw4d import __version__
from aw4d.cli import main
from aw4d.clip import Clip
from aw4d.ingest import ingest_street
from aw4d.io.images import read_exr, read_png
from aw4d.io.video import read_video
from aw4d.passes import PASSES
from aw4d.weathers import GROUPS, WEATHERS, find

ROOT = Path(__file__).resolve().parent.parent
FRAMES, WIDTH, HEIGHT = 3, 64, 36


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short and small clip of the built-in street."""
    path = tmp_path_factory.mktemp("street") / "street.aw4d"
    ingest_street(path, frames=FRAMES, width=WIDTH, height=HEIGHT, workers=1)
    return path


@dataclass(frozen=True)
class Done:
    """What a run of the command line left."""

    code: int
    out: str
    err: str


Run = Callable[..., Done]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs `aw4d` in this process; what it logs goes to pytest."""

    def call(*words: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["aw4d", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        captured = capsys.readouterr()
        return Done(int(end.value.code or 0), captured.out, captured.err)

    return call


def _edit(run: Run, clip: Path, out: Path, *words: object) -> Done:
    return run("--quiet", "edit", clip, "--weather", "fog", "--backend", "numpy", "-o", out, *words)


def _refused(done: Done, *named: str) -> None:
    """It ended with exit status 2 and one line that names what is wrong."""
    assert done.code == 2, done
    assert done.out == ""
    assert done.err.startswith("aw4d: ")
    assert done.err.count("\n") == 1
    for word in named:
        assert word in done.err


def _strict(text: str) -> Any:
    """JSON without the NaN and Infinity that Python adds to it."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


# ---- mistakes ----------------------------------------------------------------------------------------------------

MISTAKES = {
    "weather": (["--weather", "fgo"], ["'fgo'", "did you mean fog?"]),
    "key": (["--set", "fog.visibilty_m=60"], ["fog.visibilty_m", "did you mean fog.visibility_m?"]),
    "group": (["--set", "fgo.visibility_m=60"], ["did you mean fog.visibility_m?"]),
    "no value": (["--set", "fog.g"], ["group.field=value", "'fog.g'"]),
    "no number": (["--set", "fog.g=round"], ["fog.g", "a number", "'round'"]),
    "no integer": (["--set", "fog.nodes=2.5"], ["fog.nodes", "an integer", "'2.5'"]),
    "not a number": (["--set", "fog.g=nan"], ["g:", "nan"]),
    "out of range": (["--set", "fog.visibility_m=-1"], ["visibility_m", "-1"]),
    "no colour": (["--set", "fog.color=1,2"], ["fog.color", "R,G,B", "'1,2'"]),
    "no switch": (["--set", "headlights.on=maybe"], ["headlights.on", "on or off", "'maybe'"]),
    "no file of lights": (["--set", "lights.file=nowhere.json"], ["nowhere.json"]),
    "cone": (["--set", "headlights.outer_deg=5"], ["cone", "5"]),
    "no such frame": (["--frames", "5"], ["--frames", "5", "0:3"]),
    "no such frames": (["--frames", "7:9"], ["--frames", "7:9", "0:3"]),
    "frames backwards": (["--frames", "2:1"], ["--frames", "2:1"]),
    "frames in letters": (["--frames", "a:b"], ["--frames", "'a:b'"]),
    "quality": (["--quality", "best"], ["--quality", "exact, balanced, fast", "'best'"]),
    "backend": (["--backend", "cuda"], ["--backend", "'cuda'"]),
    "device of numpy": (["--device", "0"], ["--device", "numpy"]),
    "format": (["--format", "jpg"], ["--format", "png or exr", "'jpg'"]),
}


@pytest.mark.parametrize("case", MISTAKES)
@pytest.mark.parametrize("name", ["out.mp4", "out"])
def test_a_mistake_ends_in_one_line_and_leaves_nothing(
    run: Run, street: Path, tmp_path: Path, case: str, name: str
) -> None:
    words, named = MISTAKES[case]
    _refused(_edit(run, street, tmp_path / name, "--layers", tmp_path / "layers", *words), *named)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("clip", ["nowhere", "folder", "file"])
@pytest.mark.parametrize("command", ["edit", "info", "compare"])
def test_what_is_no_clip_is_refused(run: Run, tmp_path: Path, clip: str, command: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("not a clip")
    words = {"edit": ["-w", "fog", "-o", tmp_path / "out.mp4"], "info": [], "compare": ["-w", "fog"]}[command]
    _refused(run("--quiet", command, tmp_path / clip, *words), str(tmp_path / clip))
    assert {path.name for path in tmp_path.iterdir()} == {"folder", "file"}


@pytest.mark.parametrize("words", [["frobnicate"], ["edit"], ["doctor", "--loud"], ["ingest", "tape"]])
def test_bad_usage_is_refused(run: Run, words: list[str]) -> None:
    done = run(*words)
    assert done.code == 2
    assert done.out == ""
    assert done.err.startswith("Usage: ")


# ---- targets -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["out.mp4", "out"])
def test_a_target_inside_a_file_is_refused(run: Run, street: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "file").write_text("in the way")
    _refused(_edit(run, street, tmp_path / "file" / name), str(tmp_path / "file" / name), "cannot be written")
    assert (tmp_path / "file").read_text() == "in the way"


def test_a_video_in_a_folder_that_is_not_there_is_refused(run: Run, street: Path, tmp_path: Path) -> None:
    _refused(_edit(run, street, tmp_path / "none" / "out.mp4"), str(tmp_path / "none" / "out.mp4"))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_holds_something_is_left_alone(run: Run, street: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "precious.txt").write_text("mine")
    _refused(_edit(run, street, tmp_path / "out"), str(tmp_path / "out"), "exists")
    _refused(_edit(run, street, tmp_path / "new", "--layers", tmp_path / "out"), str(tmp_path / "out"), "exists")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["out", "precious.txt"]


def test_an_earlier_edit_is_replaced_only_when_asked(run: Run, street: Path, tmp_path: Path) -> None:
    for out in (tmp_path / "out.mp4", tmp_path / "frames"):
        assert _edit(run, street, out, "--frames", "0").code == 0
        _refused(_edit(run, street, out, "--frames", "1"), str(out), "exists", "--overwrite")
        assert _edit(run, street, out, "--frames", "1", "--overwrite").code == 0
    assert [path.name for path in (tmp_path / "frames").iterdir()] == ["000001.png"]


def test_images_do_not_go_into_a_video(run: Run, street: Path, tmp_path: Path) -> None:
    _refused(_edit(run, street, tmp_path / "out.mp4", "--format", "exr"), "--format exr", "out.mp4")


def test_another_kind_of_video_is_refused(run: Run, street: Path, tmp_path: Path) -> None:
    _refused(_edit(run, street, tmp_path / "out.avi"), "out.avi", ".mp4")
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_clip_is_named_and_leaves_nothing(run: Run, tmp_path: Path) -> None:
    ingest_street(tmp_path / "clip", frames=2, width=WIDTH, height=HEIGHT, workers=1)
    chunk = tmp_path / "clip" / "depth" / "c" / "1" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[:-9])
    _refused(_edit(run, tmp_path / "clip", tmp_path / "out.mp4"), "frame 1, depth")
    assert [path.name for path in tmp_path.iterdir()] == ["clip"]


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk without a free page: names fit, content does not."""
    libc = ctypes.CDLL(None, use_errno=True)
    disk = tmp_path / "disk"
    disk.mkdir()
    if libc.mount(b"tmpfs", str(disk).encode(), b"tmpfs", 0, b"size=4k") != 0:
        pytest.skip(f"cannot mount a small disk: {os.strerror(ctypes.get_errno())}")
    (disk / "filler").write_bytes(bytes(4096))
    yield disk
    libc.umount2(str(disk).encode(), 2)  # MNT_DETACH


@pytest.mark.parametrize("name", ["out.mp4", "out"])
def test_a_full_disk_leaves_nothing(run: Run, street: Path, full_disk: Path, name: str) -> None:
    _refused(_edit(run, street, full_disk / name), "No space left")
    assert list(full_disk.iterdir()) == [full_disk / "filler"]


def test_no_room_for_the_sidecar_leaves_no_output(run: Run, street: Path, full_disk: Path) -> None:
    (full_disk / "filler").unlink()  # a page: the small video has room, its sidecar has not
    _refused(_edit(run, street, full_disk / "out.mp4"), "No space left")
    assert list(full_disk.iterdir()) == []


def test_a_full_disk_for_layers_leaves_nothing(run: Run, street: Path, full_disk: Path, tmp_path: Path) -> None:
    _refused(_edit(run, street, tmp_path / "out.mp4", "--layers", full_disk / "layers"), "No space left")
    assert list(full_disk.iterdir()) == [full_disk / "filler"]
    assert list(tmp_path.iterdir()) == [full_disk]


# ---- what goes where ---------------------------------------------------------------------------------------------


def _process(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "aw4d.cli", *map(str, words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)


def test_results_go_to_stdout_and_the_rest_to_stderr(street: Path, tmp_path: Path) -> None:
    done = _process("edit", street, "-w", "fog", "-o", tmp_path / "out.mp4")
    assert done.stdout == f"{tmp_path / 'out.mp4'}\n"
    assert "running on" in done.stderr
    assert f"{FRAMES}/{FRAMES}" in done.stderr


def test_quiet_is_quiet(street: Path, tmp_path: Path) -> None:
    done = _process("--quiet", "edit", street, "-w", "fog", "-o", tmp_path / "out.mp4")
    assert done.stdout == f"{tmp_path / 'out.mp4'}\n"
    assert done.stderr == ""


@pytest.mark.parametrize("name", ["out.mp4", "out"])
def test_the_sidecar_holds_everything(run: Run, street: Path, tmp_path: Path, name: str) -> None:
    words = ["--set", "fog.visibility_m=60", "--set", "lights.off=ego,street", "--frames", "1:3"]
    assert _edit(run, street, tmp_path / name, *words).code == 0
    content = _strict((tmp_path / "out.json").read_text())
    for group, kind in GROUPS.items():
        assert set(content["settings"][group]) == {field.name for field in dataclasses.fields(kind)}
    assert content["settings"]["fog"]["visibility_m"] == pytest.approx(60)
    assert content["settings"]["fog"]["color"] is not None
    assert content["lights"] == []
    assert content["frames"] == [1, 2]
    assert content["passes"] == list(find("fog").passes)
    assert content["white_cd_m2"] == 25
    assert content["weather"] == "fog"
    assert content["aw4d"] == __version__
    assert content["size"] == [WIDTH, HEIGHT]
    assert content["backend"].startswith("numpy")


def test_a_pass_that_would_change_nothing_is_skipped(run: Run, street: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert _edit(run, street, out, "--set", "fog.sigma_s=0", "--frames", ":1").code == 0
    content = _strict((tmp_path / "out.json").read_text())
    assert content["passes"] == [name for name in find("fog").passes if name != "fog"]
    assert list(content["skipped"]) == ["fog"]
    clear = tmp_path / "clear"
    assert _edit(run, street, clear, "--set", "fog.visibility_m=1e9", "--frames", ":1").code == 0
    thin, none = (read_png(folder / "000000.png").astype(int) for folder in (clear, out))
    assert np.abs(thin - none).max() <= 1


def test_explaining_writes_only_what_is_asked_for(run: Run, street: Path, tmp_path: Path) -> None:
    words = ("edit", street, "--weather", "fog", "--backend", "numpy", "--frames", "1")
    alone = run("--quiet", *words, "--explain")
    assert alone.code == 0
    assert "approximations" in alone.out
    assert not list(tmp_path.iterdir())
    assert run("--quiet", *words, "--explain", "-o", tmp_path / "out").code == 0
    explained = _strict((tmp_path / "out.json").read_text())["explained"]
    assert explained["frames"] == [1]
    assert list(explained["ms"]) == [name for name in find("fog").passes if name not in explained["skipped"]]
    assert {"step", "what", "considered", "evaluated"} == set(explained["counts"][0])


@pytest.mark.parametrize("more", [[], ["--explain", "--layers", "layers"]], ids=["nothing", "layers"])
def test_an_output_is_needed_but_to_explain(run: Run, street: Path, more: list[str]) -> None:
    _refused(run("--quiet", "edit", street, "--weather", "fog", *more), "-o", "--explain")


# ---- pictures ----------------------------------------------------------------------------------------------------


def test_a_video_has_every_frame(run: Run, street: Path, tmp_path: Path) -> None:
    assert _edit(run, street, tmp_path / "out.mp4").code == 0
    pictures = list(read_video(tmp_path / "out.mp4"))
    assert [picture.shape for picture in pictures] == [(HEIGHT, WIDTH, 3)] * FRAMES


@pytest.mark.parametrize("backend", ["numpy", "auto"])
def test_a_frame_alone_is_bit_equal_to_the_whole_run(run: Run, street: Path, tmp_path: Path, backend: str) -> None:
    words = ["--backend", backend]
    assert _edit(run, street, tmp_path / "whole", *words).code == 0
    assert _edit(run, street, tmp_path / "one", *words, "--frames", "1:2").code == 0
    assert [path.name for path in (tmp_path / "one").iterdir()] == ["000001.png"]
    assert (tmp_path / "one" / "000001.png").read_bytes() == (tmp_path / "whole" / "000001.png").read_bytes()
    assert len(list((tmp_path / "whole").iterdir())) == FRAMES


def _exr(path: Path) -> Any:
    """Pixels of an EXR, (H, W, 3) or (H, W)."""
    channels = read_exr(path)
    return np.stack([channels[c] for c in "RGB"], axis=-1) if "R" in channels else next(iter(channels.values()))


@pytest.mark.parametrize("backend", ["numpy", "auto"])
def test_the_layers_add_up_to_the_picture(run: Run, street: Path, tmp_path: Path, backend: str) -> None:
    words = ["--backend", backend, "--format", "exr", "--layers", tmp_path / "layers", "--frames", "0:2"]
    assert _edit(run, street, tmp_path / "out", *words).code == 0
    names = {path.name for path in (tmp_path / "layers").iterdir()}
    assert {"ambient", "direct", "transmittance", "in_scatter", "airlight", "light-ego-left"} <= names
    for index in range(2):
        name = f"{index:06d}.exr"
        layer = {path.name: _exr(path / name) for path in (tmp_path / "layers").iterdir() if (path / name).exists()}
        relit = layer["ambient"] + layer["direct"]
        total = layer["transmittance"][..., None] * relit + layer["in_scatter"] + layer["airlight"]
        assert np.allclose(total, _exr(tmp_path / "out" / name), rtol=1e-5, atol=1e-7)


def test_labels_and_boxes_pass_through_unchanged(run: Run, street: Path, tmp_path: Path) -> None:
    words = ["--layers", tmp_path / "layers", "--frames", "1:2"]
    assert _edit(run, street, tmp_path / "out", *words).code == 0
    clip = Clip(street)
    source = clip.frame(1)
    for name in ("sky", "road", "vehicle"):
        codes = read_png(tmp_path / "layers" / name / "000001.png")
        assert np.array_equal(codes, source[name].astype(np.int64) * (255 if source[name].dtype == np.bool_ else 1))
    for name in ("depth", "edited_depth"):  # there is nothing in the air
        assert np.array_equal(_exr(tmp_path / "layers" / name / "000001.exr"), source["depth"])
    boxes = json.loads((tmp_path / "layers" / "boxes.json").read_text())
    assert boxes == {"1": [box.to_json() for box in clip.info.boxes[1]]}
    assert boxes["1"]


# ---- the other commands ------------------------------------------------------------------------------------------


def test_info_is_strict_json_and_names_what_is_there(run: Run, street: Path) -> None:
    done = run("info", street, "--json")
    assert done.code == 0
    content = _strict(done.out)
    assert content["frames"] == FRAMES
    assert run("info", street).code == 0


def test_compare_is_strict_json_and_within_the_bar(run: Run, street: Path, opencl_device: object) -> None:
    # So few pixels show a lamp as one: its light then stands on that very pixel's surface, where rounding decides all.
    words = ("--quiet", "compare", street, "-w", "fog", "--set", "lights.street=off", "--json")
    whole, faded = run(*words, "--set", "fog.faintest=0"), run(*words)
    assert whole.code == faded.code == 0
    rows = _strict(whole.out)["rows"]
    written = {plane for name in find("fog").passes for plane in (*PASSES[name].writes, *PASSES[name].layers)}
    assert {row["plane"] for row in rows} == written
    assert all(row["within"] for row in rows)
    # What fades to nothing has errors by its condition number, which the hard cases are held to: the layer of it alone.
    assert all(row["within"] for row in _strict(faded.out)["rows"] if row["plane"] != "in_scatter")


def test_the_demo_makes_videos_and_a_contact_sheet(run: Run, tmp_path: Path) -> None:
    words = ["--frames", 3, "--width", WIDTH, "--height", HEIGHT, "--backend", "numpy", "-o", tmp_path / "demo"]
    for _ in range(2):  # the second run takes the clip that the first one drew
        done = run("--quiet", "demo", *words)
        assert done.code == 0, done.err
        files = [Path(line) for line in done.out.splitlines()]
        assert [file.name for file in files] == [
            "source.mp4",
            *(f"{weather}.mp4" for weather in WEATHERS),
            "contact_sheet.png",
        ]
    assert all(len(list(read_video(file))) == 3 for file in files[:-1])
    sheet = read_png(files[-1])
    assert sheet.shape[1] % 3 == 0
    assert sheet.shape[0] % (1 + len(WEATHERS)) == 0


def test_a_folder_that_is_no_drive_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    _refused(run("--quiet", "ingest", "kitti", tmp_path / "folder", "-o", tmp_path / "clip"), str(tmp_path / "folder"))
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]
