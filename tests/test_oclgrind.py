"""No kernel reads or writes out of bounds, uses a value that was never set, or races: run on Oclgrind's simulator."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from aw4d.passes import IMAGE

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def oclgrind() -> str:
    """The simulator's launcher, or a skip (a failure under AW4D_REQUIRE_CL) that says how to get it."""
    found = shutil.which("oclgrind")
    if found is None:
        reason = "oclgrind is not installed (Debian: apt-get install oclgrind)"
        if os.environ.get("AW4D_REQUIRE_CL"):
            pytest.fail(reason)
        pytest.skip(reason)
    return found


def _findings(oclgrind: str, *case: str) -> str:
    """What the simulator has to say about one case of `run_under_oclgrind`."""
    # Not by --log: every context begins that file anew, and what was found in those before is lost.
    # Unoptimised: the compiler may drop what depends on a value that was never set, and the finding with it. The
    # simulator has no caches, and no instruction that fetches into them; nor what the compiler notes where it inlines
    # a function that returns a struct.
    command = [oclgrind, "--uninitialized", "--data-races", "--build-options", "-cl-opt-disable -DNO_FETCH -DNO_INLINE"]
    command += [sys.executable, "-m", "tests.run_under_oclgrind", *case]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.parametrize("convention", ["physical", "paper"])
def test_fog(oclgrind: str, convention: str) -> None:
    assert _findings(oclgrind, "fog", convention) == ""


@pytest.mark.parametrize("convention", ["physical", "paper"])
def test_spot_lights(oclgrind: str, convention: str) -> None:
    assert _findings(oclgrind, "spot_lights", convention) == ""


@pytest.mark.parametrize("preset", ["noon", "overcast"])
def test_ambient(oclgrind: str, preset: str) -> None:
    assert _findings(oclgrind, "ambient", preset) == ""


@pytest.mark.parametrize("convention", ["physical", "paper"])
def test_snow_cover(oclgrind: str, convention: str) -> None:
    assert _findings(oclgrind, "snow_cover", convention) == ""


@pytest.mark.parametrize("case", ["wet", "dry"])
def test_reflections(oclgrind: str, case: str) -> None:
    assert _findings(oclgrind, "reflections", case) == ""


@pytest.mark.parametrize("name", ["night_grade", "overcast_sky", "harmonize"])
def test_grade(oclgrind: str, name: str) -> None:
    assert _findings(oclgrind, "grade", name) == ""


def test_image(oclgrind: str) -> None:
    assert _findings(oclgrind, "show", IMAGE) == ""


@pytest.mark.parametrize("name", ["rain_streaks", "snow_fall"])
def test_falling(oclgrind: str, name: str) -> None:
    assert _findings(oclgrind, "falling", name) == ""


def test_drops_in_one_tile(oclgrind: str) -> None:
    """A million take as long as docs/falling.md says: too long for every run."""
    assert _findings(oclgrind, "one_tile", "10000") == ""


@pytest.mark.parametrize("name", ["wet_ground", "puddles", "ripples"])
def test_ground(oclgrind: str, name: str) -> None:
    assert _findings(oclgrind, "ground", name) == ""


@pytest.mark.parametrize(
    ("fault", "finding"), [("beyond", "Invalid read"), ("unset", "uninitialized value"), ("race", "data race")]
)
def test_a_faulty_kernel_is_found_out(oclgrind: str, fault: str, finding: str) -> None:
    assert finding in _findings(oclgrind, "faulty", fault)
