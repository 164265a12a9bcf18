"""The shape of the project: one pass has one name everywhere, and what is not needed is not imported."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import inspect
import re
import subprocess
import sys
import typing
from pathlib import Path
from typing import Literal

import pytest

from aw4d.backend_opencl import source
from aw4d.params import Params
from aw4d.passes import PASSES, SHOW, stages
from aw4d.weathers import GROUPS, ORDER, WEATHERS, find

ROOT = Path(__file__).resolve().parent.parent
# Pieces that kernels share; each mirrors the reference of the same stem, but for those that stand in for what
# NumPy has built in.
HEADERS_OF_THE_LANGUAGE = {"vec", "trig", "exp", "gather", "sharp", "sort", "tiles", "bundle", "columns"}


@pytest.fixture(params=PASSES)
def name(request: pytest.FixtureRequest) -> str:
    """Name of a pass."""
    found: str = request.param
    return found


def test_a_pass_has_one_name_everywhere(name: str) -> None:
    assert callable(getattr(importlib.import_module(f"reference_numpy.{name}"), name))
    assert re.findall(r"__kernel\s+void\s+(\w+)", source(name)) == [stage.kernel for stage in stages(name)]
    assert stages(name)[-1].kernel == name
    assert PASSES[name].params.__name__ == "".join(part.capitalize() for part in name.split("_")) + "Params"
    assert GROUPS[name] is PASSES[name].params
    assert (ROOT / "tests" / f"test_{name}.py").is_file()


def test_every_kernel_is_a_pass_or_shows_the_picture() -> None:
    assert {path.stem for path in (ROOT / "cl").glob("*.cl")} == {*PASSES, SHOW}


def test_weathers_are_made_of_passes_in_order() -> None:
    assert set(ORDER) == set(PASSES)
    for weather in WEATHERS:
        passes = find(weather).passes
        assert passes == tuple(name for name in ORDER if name in passes)
        assert {*WEATHERS[weather].passes, *WEATHERS[weather].light} == set(passes)


def test_a_reference_takes_keywords_without_defaults(name: str) -> None:
    function = getattr(importlib.import_module(f"reference_numpy.{name}"), name)
    for parameter in inspect.signature(function).parameters.values():
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY, parameter
        assert parameter.default is inspect.Parameter.empty, parameter


def test_a_reference_takes_its_planes_and_parameters(name: str) -> None:
    function = getattr(importlib.import_module(f"reference_numpy.{name}"), name)
    taken = set(inspect.signature(function).parameters)
    own = {f.name for f in dataclasses.fields(PASSES[name].params) if not f.metadata["host"]}
    assert set(PASSES[name].reads) | own <= taken


def test_headers_mirror_references() -> None:
    headers = {path.stem for path in (ROOT / "cl" / "include").glob("*.h")} - HEADERS_OF_THE_LANGUAGE
    references = {path.stem for path in (ROOT / "reference_numpy").glob("*.py")}
    assert headers <= references


@pytest.mark.parametrize("group", GROUPS)
def test_every_parameter_says_what_it_is(group: str) -> None:
    kinds = typing.get_type_hints(GROUPS[group])
    for field in dataclasses.fields(GROUPS[group]):
        about = field.metadata
        assert about["meaning"], field.name
        is_number = kinds[field.name] not in (str, bool) and typing.get_origin(kinds[field.name]) is not Literal
        assert bool(about["unit"]) == is_number, f"{field.name}: a number has a unit, and nothing else has"
        assert about["low"] <= about["high"], field.name


def test_every_group_is_of_parameters() -> None:
    for params in GROUPS.values():
        assert issubclass(params, Params)
        assert params.__doc__


def _imported(path: Path) -> set[str]:
    """Top-level names of the modules that a file imports, anywhere in it."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names = [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    names += [n.module or "." for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    return {name.split(".")[0] for name in names}


@pytest.mark.parametrize("path", sorted((ROOT / "reference_numpy").glob("*.py")), ids=lambda path: path.stem)
def test_references_stand_on_numpy_alone(path: Path) -> None:
    assert _imported(path) - set(sys.stdlib_module_names) <= {"numpy", "reference_numpy"}


def _loaded_by(code: str) -> set[str]:
    """Top-level modules in memory after running some code in a new interpreter."""
    script = f"import sys\n{code}\nprint('loaded', *{{name.split('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split()[1:])


def _command(*words: str) -> str:
    return (
        f"sys.argv = {['aw4d', *words]!r}\n"
        "from aw4d.cli import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code, end.code"
    )


def test_the_core_needs_no_torch() -> None:
    peers = ROOT / "aw4d" / "bench" / "peers"  # of the bench alone, each loaded where it is installed
    files = [path for path in (ROOT / "aw4d").rglob("*.py") if path.parent != peers]
    assert not [path for path in files if {"torch", "mitsuba"} & _imported(path)]


def test_help_loads_neither_data_nor_devices() -> None:
    loaded = _loaded_by(_command("--help"))
    assert "typer" in loaded
    assert not loaded & {"zarr", "pyopencl", "cv2", "av", "scipy", "skimage", "numpy"}


def test_the_library_is_imported_without_a_device() -> None:
    loaded = _loaded_by("import aw4d, aw4d.render, aw4d.pipeline")
    assert not loaded & {"pyopencl", "av", "typer", "mitsuba"}
