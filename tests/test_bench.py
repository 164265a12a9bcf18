"""The bench: what it counts, what it calls a front, and that a quick run measures every pass. Never how fast."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rich.console import Console

from aw4d.backend_numpy import NumpyBackend
from aw4d.bench.against import COMPILED, NUMBA, TORCH
from aw4d.bench.bars import bars
from aw4d.bench.counting import moved_bytes, operations
from aw4d.bench.curves import ALL, by_pixels
from aw4d.bench.found import Found, plain
from aw4d.bench.fronts import front
from aw4d.bench.hard_inputs import Scenery, trial
from aw4d.bench.limits import Limits
from aw4d.bench.passes import PassRow
from aw4d.bench.run import run_bench
from aw4d.bench.tables import tables, to_markdown
from aw4d.bench.timing import Timing
from aw4d.passes import PASSES

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend


def test_a_front_is_what_no_other_beats() -> None:
    points = [(1.0, 9.0), (2.0, 3.0), (2.0, 4.0), (3.0, 3.0), (5.0, 1.0), (6.0, 2.0)]
    assert front(points) == [True, True, False, False, True, False]


def test_equal_points_are_on_the_front_together() -> None:
    assert front([(1.0, 1.0), (1.0, 1.0)]) == [True, True]


def test_bytes_are_those_of_the_planes() -> None:
    read_and_written = 3 * 4 + 3 * 4 + 1  # rgb in and out, and the mask
    assert moved_bytes("overcast_sky", (7, 13), ["rgb", "sky"]) == 7 * 13 * read_and_written


def test_planes_that_nobody_made_move_nothing() -> None:
    whole, without = (moved_bytes("wet_ground", (2, 2), planes) for planes in (["road", "snow_bare"], ["road"]))
    assert whole - without == 4 * 4


def test_operations_grow_with_the_pixels_and_change_nothing() -> None:
    counted = []
    for size in ((16, 4), (32, 8)):
        held = trial("harmonize", Scenery(size=size))
        planes = NumpyBackend().upload(held.frame, held.scene)
        NumpyBackend().put(planes, "direct", held.working["direct"])
        before = {name: values.copy() for name, values in planes.arrays.items()}
        counted.append(operations("harmonize", planes, held.params))
        assert all(np.array_equal(values, before[name]) for name, values in planes.arrays.items())
        assert type(planes.arrays["rgb"]) is np.ndarray
    assert counted[0] > 16 * 4
    assert counted[1] == 4 * counted[0]


def test_the_limit_that_binds_is_the_slower() -> None:
    limits = Limits(device="it", width=16, fma_gflop_s=100.0, copy_gb_s=10.0, builtins_g_s={})
    assert limits.seconds(operations=1e9, nbytes=1e6) == (pytest.approx(0.01), "fma")
    assert limits.seconds(operations=1e6, nbytes=1e9) == (pytest.approx(0.1), "copy")


def test_what_all_passes_cost_by_pixels_is_the_sum_of_the_lines() -> None:
    lines = {"fog": (1.0, 3.0), "ambient": (0.5, 7.0)}
    rows = [
        PassRow(
            step=step,
            scene="street",
            width=1000 * scale,
            height=1000,
            device="it",
            time=Timing(median_ms=fixed + rate * scale, low_ms=0.0, high_ms=0.0, runs=1),
            bytes=0,
            operations=0.0,
            bound="fma",
        )
        for step, (fixed, rate) in lines.items()
        for scale in (1, 2, 5)
    ]
    for fit in by_pixels(rows):
        fixed, rate = lines.get(fit.step, (1.5, 10.0))
        assert (fit.fixed_ms, fit.ms_a_megapixel, fit.off) == pytest.approx((fixed, rate, 0.0), abs=1e-9)
    assert [fit.step for fit in by_pixels(rows)] == ["fog", "ambient", ALL]


def test_what_has_no_bounds_is_said_in_strict_json() -> None:
    assert json.dumps(plain({"a": float("inf"), "b": [1.5, None]}), allow_nan=False) == '{"a": "inf", "b": [1.5, null]}'


@pytest.fixture(scope="module")
def quick(opencl_backends: dict[str, OpenCLBackend], tmp_path_factory: pytest.TempPathFactory) -> tuple[Found, Path]:
    """One quick run without peers, and the folder with what it wrote."""
    folder = tmp_path_factory.mktemp("bench")
    absent = ("torch", "numba", "albumentations")
    found = run_bench(
        [],
        Console(file=(folder / "out.txt").open("w", encoding="utf-8")),
        json_file=folder / "bench.json",
        plots=folder,
        markdown=folder / "bench.md",
        quick=True,
        absent=absent,
    )
    return found, folder


def test_every_pass_is_measured_on_every_backend(quick: tuple[Found, Path]) -> None:
    devices = {limits.device for limits in quick[0].limits}
    for step in PASSES:
        assert {row.device for row in quick[0].passes if row.step == step} == devices | {"numpy"}


def test_errors_are_measured_beside_times(quick: tuple[Found, Path]) -> None:
    for row in quick[0].passes:
        assert row.time.median_ms > 0
        assert row.max_error is not None
        assert np.isfinite(row.max_error)
        assert row.p9999_error is not None
        assert 0 <= row.p9999_error <= row.max_error


def test_absent_peers_are_named(quick: tuple[Found, Path]) -> None:
    said = {one.what: one.why for one in quick[0].left_out}
    assert said[f"{TORCH}, {COMPILED}"] == "torch is not installed"
    assert said[NUMBA] == "numba is not installed"
    assert said["albumentations"] == "albumentations is not installed"


def _refuse(constant: str) -> Any:
    raise AssertionError(f"{constant} is no JSON")


def test_the_json_is_strict_and_has_every_row(quick: tuple[Found, Path]) -> None:
    found, folder = quick
    data = json.loads((folder / "bench.json").read_text(encoding="utf-8"), parse_constant=_refuse)
    for section in ("limits", "passes", "peers", "knobs", "qualities", "half_planes", "costs", "memory", "whole"):
        assert len(data[section]) == len(getattr(found, section)) > 0, section


def test_tables_and_plots_are_there(quick: tuple[Found, Path]) -> None:
    found, folder = quick
    text = (folder / "bench.md").read_text(encoding="utf-8")
    for table in tables(found):
        assert table.title in text
        assert all(len(row) == len(table.columns) for row in table.rows), table.title
    assert text == to_markdown(found, "aw4d bench --quick")
    for name in ("front", "cost", "passes", "whole"):
        assert (folder / f"bench_{name}.png").read_bytes().startswith(b"\x89PNG")


def test_bars_say_what_was_asked_and_what_came(quick: tuple[Found, Path]) -> None:
    said = [bar.what for bar in bars(quick[0])]
    assert len(said) == len(set(said))
    assert sum("share of the" in what for what in said) == len(PASSES)


@pytest.mark.parametrize("step", ["fog", "spot_lights", "harmonize", "overcast_sky", "wet_ground"])
def test_a_peer_computes_what_the_pass_does(step: str) -> None:
    pytest.importorskip("numba", reason="no Numba: pip install 'autoweather4d[bench]'")
    from aw4d.bench.against import _given, scenes
    from aw4d.bench.frames import street_frame
    from aw4d.bench.peers import numba_passes
    from aw4d.compare import error

    frame = street_frame(64, 36)
    held = _given(step, frame, scenes(frame)["street"])
    numpy, planes = held.reference()
    if step == "harmonize":
        numpy.put(planes, "direct", np.moveaxis(held.planes["direct"], 0, -1))
    numpy.run(step, planes, held.params)
    _, p9999 = error(np.moveaxis(numba_passes.prepared(held)(), 0, -1), planes.arrays[held.result])
    assert p9999 < 1e-3
