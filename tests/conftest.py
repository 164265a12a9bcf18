"""Fixtures shared by the tests: where the real recordings are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
KITTI_DRIVE = "kitti_raw/2011_09_26/2011_09_26_drive_0013_sync"


@pytest.fixture(scope="session")
def test_data() -> Path:
    """Folder of real recordings, or a skip that says why."""
    folder = Path(os.environ.get("AW4D_TEST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no recordings: {folder} does not exist (set AW4D_TEST_DATA)")
    return folder


@pytest.fixture(scope="session")
def kitti_drive(test_data: Path) -> Path:
    """The KITTI raw drive of 57 frames."""
    return test_data / KITTI_DRIVE
