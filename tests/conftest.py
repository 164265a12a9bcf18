"""Fixtures shared by the tests: real recordings, and every OpenCL device at every width."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from aw4d.errors import InputError

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

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


def _opencl_configurations() -> list[tuple[int, int]]:
    """(device, width) of every usable OpenCL device; the width of a GPU is 1."""
    from aw4d import opencl

    try:
        usable = [report for report in opencl.devices() if report.usable]
    except InputError:
        usable = []
    return [(r.index, width) for r in usable for width in (opencl.WIDTHS if r.kind == "cpu" else (1,))]


def _need_device(found: object) -> None:
    if found is None:
        if os.environ.get("AW4D_REQUIRE_CL"):
            pytest.fail("AW4D_REQUIRE_CL is set, but no OpenCL device builds and runs a kernel (see `aw4d doctor`)")
        pytest.skip("no OpenCL device builds and runs a kernel (see `aw4d doctor`)")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """`opencl_backend` stands for every device at every width, `opencl_device` for every device at its widest."""
    for fixture, first_width_only in (("opencl_backend", False), ("opencl_device", True)):
        if fixture not in metafunc.fixturenames:
            continue
        found = _opencl_configurations()
        if first_width_only:
            found = list({device: (device, width) for device, width in found}.values())
        ids = [f"device{device}-width{width}" for device, width in found]
        metafunc.parametrize(fixture, found or [None], ids=ids or ["no-device"], indirect=True, scope="session")


@pytest.fixture(scope="session")
def opencl_backend(request: pytest.FixtureRequest) -> OpenCLBackend:
    """An OpenCL backend; once for every usable device and every width."""
    _need_device(request.param)
    from aw4d.backend_opencl import OpenCLBackend

    return OpenCLBackend(*request.param)


@pytest.fixture(scope="session")
def opencl_device(request: pytest.FixtureRequest) -> OpenCLBackend:
    """An OpenCL backend at the device's widest; once for every usable device."""
    _need_device(request.param)
    from aw4d.backend_opencl import OpenCLBackend

    return OpenCLBackend(*request.param)


@pytest.fixture(scope="session")
def opencl_backends() -> dict[str, OpenCLBackend]:
    """All of them at once, by name: for tests whose reference takes longer than the kernels."""
    found = _opencl_configurations()
    _need_device(found or None)
    from aw4d.backend_opencl import OpenCLBackend

    return {backend.name: backend for backend in (OpenCLBackend(*configuration) for configuration in found)}


@pytest.fixture(scope="session")
def torch() -> Any:
    """PyTorch, or a skip that says why."""
    return pytest.importorskip("torch", reason="no PyTorch: pip install 'autoweather4d[metrics]'")


@pytest.fixture(scope="session")
def torchvision_operators(torch: Any) -> Any:
    """Lets a torchvision that was built for another build of this torch import; what is returned must be kept.

    Its operators do not load then, and its import fails at two that it registers more for. No test calls them.
    """
    package = importlib.util.find_spec("torchvision")
    folder = Path(*package.submodule_search_locations or ()) if package else Path("no torchvision")
    try:
        torch.ops.load_library(str(next(folder.glob("_C.*"))))
    except (OSError, StopIteration):
        library = torch.library.Library("torchvision", "DEF")
        for name in ("nms", "qnms"):
            library.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
        return library


@pytest.fixture(scope="session")
def open_clip(torchvision_operators: Any) -> Any:
    """open_clip, or a skip that says why."""
    return pytest.importorskip("open_clip", reason="no open_clip: pip install 'autoweather4d[metrics]'")
