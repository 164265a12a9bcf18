"""One run of the bench: section by section, in one process, the machine's limits before and after."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.limits import best, limits
from aw4d.errors import InputError
from aw4d.io.files import replacing


def run_bench(
    clips: Sequence[Path],
    console: Console,
    *,
    json_file: Path | None = None,
    plots: Path | None = None,
    markdown: Path | None = None,
    quick: bool = False,
) -> dict[str, Any]:
    """Measure, print, and write what is asked for.

    Raises
    ------
    InputError
        No OpenCL device works.
    """
    backends = [OpenCLBackend(report.index) for report in opencl.devices() if report.usable]
    if not backends:
        raise InputError("bench: expected an OpenCL device to measure, got none (see `aw4d doctor`)")
    before = [limits(backend) for backend in backends]
    found = {"limits": [asdict(best(old, limits(backend))) for old, backend in zip(before, backends, strict=True)]}
    if json_file is not None:
        with replacing(json_file) as temporary:
            temporary.write_text(json.dumps(found, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    console.print_json(data=found)
    return found
