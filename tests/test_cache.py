"""What is kept on disk: the same bits as what was made, made anew where a file is damaged, done without where none is
possible."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from aw4d import cache, kernels
from aw4d.backend_opencl import OpenCLBackend
from aw4d.clip import Clip
from aw4d.environment import environment
from aw4d.lights.street_lamps import PLANES, street_lamps
from aw4d.params import AmbientParams, FogParams, StreetLampParams
from tests.fog_inputs import all_kinds, frame, on

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "autoweather4d" / "edit"


class Maker:
    """Makes arrays, and counts how often."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self) -> cache.Arrays:
        self.calls += 1
        return {"a": np.arange(12.0).reshape(3, 4) / 7, "names": np.array([["x", "float"]]), "none": np.zeros((0, 3))}


def same(a: cache.Arrays, b: cache.Arrays) -> bool:
    return list(a) == list(b) and all(a[k].dtype == b[k].dtype and np.array_equal(a[k], b[k]) for k in a)


def only(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def test_what_is_kept_comes_back_bit_by_bit_and_is_made_once() -> None:
    make = Maker()
    assert same(cache.kept("k", ("key",), make), cache.kept("k", ("key",), make))
    assert make.calls == 1


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (("text",), ("texT",)),
        (("a", "b"), ("ab",)),
        ((np.zeros(4),), (np.zeros((2, 2)),)),
        ((np.zeros(4),), (np.zeros(4, np.int64),)),
        ((np.zeros(2),), (np.array([0.0, 1e-300]),)),
    ],
)
def test_another_key_is_another_file(folder: Path, one: tuple[object, ...], other: tuple[object, ...]) -> None:
    make = Maker()
    cache.kept("k", one, make)
    cache.kept("k", other, make)
    assert make.calls == 2
    assert len(list(folder.iterdir())) == 2


def _truncated(data: bytes) -> bytes:
    return data[: len(data) // 2]


def _flipped(data: bytes) -> bytes:
    at = len(data) // 3
    return data[:at] + bytes([data[at] ^ 16]) + data[at + 1 :]


@pytest.mark.parametrize("damage", [_truncated, _flipped, lambda _: b"", lambda _: b"PK\3\4" + bytes(999)])
def test_a_damaged_file_is_made_anew_and_replaced(folder: Path, damage: Callable[[bytes], bytes]) -> None:
    make = Maker()
    made = cache.kept("k", (), make)
    only(folder).write_bytes(damage(only(folder).read_bytes()))
    assert same(cache.kept("k", (), make), made)
    assert same(cache.kept("k", (), make), made)
    assert make.calls == 2


def test_any_flipped_byte_is_found(folder: Path) -> None:
    cache.kept("k", (), Maker())
    path = only(folder)
    whole = path.read_bytes()
    for at in range(0, len(whole), 5):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 255]) + whole[at + 1 :])
        found = cache.read("k", ())
        assert found is None


def test_a_folder_that_cannot_be_made_is_done_without(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))  # not even root makes a folder in a file
    make = Maker()
    assert same(cache.kept("k", (), make), make())
    assert cache.read("k", ()) is None


def test_a_full_disk_leaves_no_half_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    assert cache.kept("k", (), Maker())
    assert not list(folder.iterdir())


def test_a_file_that_cannot_be_touched_is_still_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make = Maker()
    cache.kept("k", (), make)

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "utime", refused)
    cache.kept("k", (), make)
    assert make.calls == 1


def test_many_processes_at_once_find_whole_files(folder: Path) -> None:
    code = (
        "import numpy as np\nfrom aw4d import cache\n"
        "for turn in range(40):\n"
        "    cache.write('k', (), {'a': np.full(20000, turn)})\n"
        "    found = cache.read('k', ())\n"
        "    assert found is not None and (found['a'] == found['a'][0]).all()"
    )
    running = [subprocess.Popen([sys.executable, "-c", code], cwd=ROOT) for _ in range(3)]
    assert [process.wait() for process in running] == [0, 0, 0]
    assert len(list(folder.iterdir())) == 1


def test_files_that_were_not_used_for_longest_go_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "MOST", 3)
    make = Maker()
    for key in range(3):
        cache.kept("k", (key,), make)
    for path in folder.iterdir():
        os.utime(path, (0, 0))
    cache.kept("k", (1,), make)  # used again
    for key in (3, 4):
        cache.kept("k", (key,), make)
    assert len(list(folder.iterdir())) == 3
    assert all(cache.read("k", (key,)) is not None for key in (1, 3, 4))


def test_what_a_killed_run_left_goes_after_a_while(folder: Path) -> None:
    folder.mkdir(parents=True)
    old, new = folder / ".k-old.tmp", folder / ".k-new.tmp"
    old.touch()
    new.touch()
    os.utime(old, (time.time() - 2 * cache.LITTER_S,) * 2)
    cache.write("k", (), Maker()())
    assert not old.exists()
    assert new.exists()


# ---- what is kept ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    """Four frames of the built-in street."""
    from aw4d.ingest import ingest_street

    return ingest_street(tmp_path_factory.mktemp("street") / "street.clip", frames=4, width=96, height=54)


def fogged(backend: OpenCLBackend) -> NDArray[np.float32]:
    return on(backend, frame(40, 7), all_kinds(), FogParams(color=(1.0, 1.0, 1.0)))["rgb"]


def of_kernels(folder: Path) -> list[Path]:
    return sorted(folder.glob(f"{kernels.KIND}-*")) if folder.exists() else []


def test_a_kernel_from_the_cache_gives_the_same_bits(folder: Path, opencl_device: OpenCLBackend) -> None:
    index = opencl_device.report.index
    built, kept = (fogged(OpenCLBackend(index)) for _ in range(2))
    assert np.array_equal(built, kept)
    assert len(of_kernels(folder)) <= 1  # none where the driver keeps its own


def test_a_binary_that_the_driver_refuses_is_built_anew(
    opencl_device: OpenCLBackend, monkeypatch: pytest.MonkeyPatch
) -> None:
    index = opencl_device.report.index
    built = fogged(OpenCLBackend(index))
    read = cache.read

    def foreign(kind: str, key: Sequence[object]) -> cache.Arrays | None:
        held = read(kind, key)
        return held and held | {kernels._BINARY: np.zeros(1000, np.uint8)}

    monkeypatch.setattr(cache, "read", foreign)
    assert np.array_equal(fogged(OpenCLBackend(index)), built)


def test_another_driver_version_builds_its_own(folder: Path, opencl_device: OpenCLBackend) -> None:
    index = opencl_device.report.index
    fogged(OpenCLBackend(index))
    before = len(of_kernels(folder))
    newer = OpenCLBackend(index)
    newer.report = dataclasses.replace(newer.report, version="9999")
    fogged(newer)
    assert len(of_kernels(folder)) == 2 * before


def test_a_skys_tables_are_the_same_from_the_cache(folder: Path) -> None:
    of = environment(AmbientParams())
    made, kept = (dataclasses.replace(of).tables for _ in range(2))
    assert same(made, of._make_tables())
    assert same(made, kept)
    assert len(list(folder.glob("sky-*"))) == 1


def test_a_changed_clip_is_searched_for_lamps_anew(street: Clip, folder: Path) -> None:
    first = street_lamps(street, StreetLampParams(), white_cd_m2=1.0)
    assert street_lamps(street, StreetLampParams(), white_cd_m2=1.0) == first
    before = street.stamp(PLANES)
    chunk = street.path / "depth" / "c" / "0" / "0" / "0"
    os.utime(chunk, (1, 1))
    assert street.stamp(PLANES) != before
    street_lamps(street, StreetLampParams(), white_cd_m2=1.0)
    assert len(list(folder.glob("lamps-*"))) == 2


def test_an_edit_whose_tables_and_lamps_are_kept_needs_no_scipy(
    street: Clip, tmp_path: Path, opencl_device: OpenCLBackend
) -> None:
    out = tmp_path / "out.mp4"
    words = ["aw4d", "-q", "edit", str(street.path), "-w", "night", "--overwrite", "-o", str(out)]
    words += ["--device", str(opencl_device.report.index)]
    code = f"import sys\nsys.argv = {words!r}\nfrom aw4d.cli import main\ntry:\n    main()\n"
    code += "except SystemExit as end:\n    assert not end.code\nprint(*sys.modules)"
    runs = [subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True) for _ in range(2)]
    assert [run.returncode for run in runs] == [0, 0], runs[0].stderr
    assert "zarr" in runs[1].stdout.split()
    assert not {"scipy", "skimage", "matplotlib", "torch"} & set(runs[1].stdout.split())
    seen = json.loads(out.with_suffix(".json").read_text(encoding="utf-8"))
    assert 0 < seen["first_frame_seconds"] <= seen["seconds"]
