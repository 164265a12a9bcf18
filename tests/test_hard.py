"""Every pass on every hard case, on every device and width: finite, no negative light, the error inside its bound."""

from __future__ import annotations

import numpy as np
import pytest

from aw4d import opencl
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.hard import HALF_ULP, Truth, measure, on_device, truth, worst
from aw4d.bench.hard_cases import CASES, Case
from aw4d.bench.hard_inputs import Scenery, lamp, trial
from aw4d.passes import PASSES


@pytest.mark.parametrize("step", PASSES)
def test_a_pass_survives_its_hard_cases(opencl_backends: dict[str, OpenCLBackend], step: str) -> None:
    outside = [row for row in measure(opencl_backends, [step]) if not row.within]
    assert not outside, "\n".join(
        f"{row.family}, {row.case}, {row.plane}, {row.device}: {row.error:.1e} of {row.bound:.1e}" for row in outside
    )


@pytest.mark.parametrize("step", PASSES)
def test_two_runtimes_agree(step: str) -> None:
    """What one makes of a hard case lies as near to what another does as both must lie to the definition."""
    usable = [OpenCLBackend(report.index) for report in opencl.devices() if report.usable]
    if len(usable) < 2:
        pytest.skip("one OpenCL device or none: nothing to compare (see `aw4d doctor`)")
    first, *others = usable
    for case in CASES:
        if not case.concerns(step):
            continue
        held = trial(step, case.scenery)
        made = {name: values.astype(np.float64) for name, values in on_device(held, first).items()}
        for other in others:
            row = worst(Truth(trial=held, results=made), on_device(held, other), case, other.name)
            assert row.within, f"{row.family}, {row.case}, {row.plane}: {row.error:.1e} of {row.bound:.1e}"


@pytest.mark.parametrize("step", PASSES)
def test_every_pass_has_hard_cases(step: str) -> None:
    assert {case.family for case in CASES if case.concerns(step)} >= {"shape", "place"}


def test_cases_have_names_of_their_own() -> None:
    for step in PASSES:
        names = [(case.family, case.name) for case in CASES if case.concerns(step)]
        assert len(names) == len(set(names))


def _case(scenery: Scenery) -> Case:
    return Case(family="made up", name="one", scenery=scenery)


def test_a_wrong_result_is_seen(opencl_device: OpenCLBackend) -> None:
    """The control: a result that is off by 1e-4, one that is not finite, and negative light."""
    case = _case(Scenery())
    exact = truth(trial("overcast_sky", case.scenery))
    found = dict(on_device(exact.trial, opencl_device))
    assert worst(exact, found, case, "it").within
    brightest = np.unravel_index(np.argmax(found["rgb"]), found["rgb"].shape)
    for value in (found["rgb"][brightest] * np.float32(1.0001), np.float32(np.nan), np.float32(-1e-3)):
        off = found["rgb"].copy()
        off[brightest] = value
        assert not worst(exact, found | {"rgb": off}, case, "it").within


def test_the_condition_number_is_that_of_a_power() -> None:
    """A light's square distance: 1 / d^2 of a lamp far from all else changes twice as much as the depth does."""
    far = lamp((0.0, 0.0, -1e5), kind="point", r_max_m=1e9 - 1, intensity=(1e12, 1e12, 1e12))
    flat = Scenery(lights=(far,), planes=lambda source: {"emissive": np.zeros_like(source["emissive"])})
    exact = truth(trial("spot_lights", flat))
    lit = exact.results["direct"] > 1e-3 * exact.results["direct"].max()
    condition = exact.moved()["direct"][lit] / exact.results["direct"][lit] / HALF_ULP
    # The lamp's place counts twice, its light once, normals and materials a little.
    assert 3 < np.median(condition) < 30
