"""A damaged file is read or refused in one line, whatever its damage: no crash, no hang, no other exception.

`AW4D_FUZZ_FILES=2000` asks for that many files in all; each format is read in a process of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.fuzz_files import FORMATS

FILES = int(os.environ.get("AW4D_FUZZ_FILES", "2000"))
SECONDS = 240  # that all files of a format may take; one that hangs takes longer


@pytest.mark.parametrize("form", FORMATS)
def test_damaged_files(form: str, tmp_path: Path) -> None:
    count = -(-FILES // len(FORMATS))
    command = [sys.executable, "-X", "faulthandler", "-m", "tests.fuzz_files", form, "0", str(count), str(tmp_path)]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired as hung:
        last = (hung.stdout or b"").decode().splitlines()[-1:]
        pytest.fail(f"{form}: hangs at {last}")
    seen = done.stdout.splitlines()
    assert done.returncode == 0, f"{form}: ended with {done.returncode} at {seen[-1:]}: {done.stderr[-1500:]}"
    assert sum(line.split(" ")[0].isdecimal() for line in seen) == count  # OpenEXR has words of its own there
