"""Any admitted frame under any admitted parameters: finite, no negative light, the error inside its bound.

An example is one frame of up to 165 pixels with its camera, lamps, time and parameters, run by NumPy and by every
OpenCL device at its widest. `AW4D_EXAMPLES=10000` asks for as many of every pass; `-k fog` for one.
"""

from __future__ import annotations

import dataclasses
import os
import typing
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from aw4d.bench.hard import tried, truth
from aw4d.bench.hard_cases import Case
from aw4d.bench.hard_inputs import Scenery, lamp, trial, turned
from aw4d.errors import InputError
from aw4d.gbuffer import PLANES, GBuffer
from aw4d.params import RGB, Params
from aw4d.passes import PASSES

if TYPE_CHECKING:
    from aw4d.backend_opencl import OpenCLBackend

EXAMPLES = int(os.environ.get("AW4D_EXAMPLES", "25"))
SIZES = [(1, 1), (1, 5), (5, 1), (7, 13), (16, 2), (17, 3), (33, 5), (5, 33)]
# What is made of other things than numbers, and how many there are of what falls: see `hard_cases` for the many.
NOT_DRAWN = {"preset", "map", "frames", "drops", "flakes", "convention", "steady", "faintest"}
LARGEST = 1e3  # of a parameter without an upper end


def _values(field: dataclasses.Field[Any], kind: Any) -> list[Any]:
    """Both ends of a parameter's range, its default, and two values between."""
    low, high = max(field.metadata["low"], -LARGEST), min(field.metadata["high"], LARGEST)
    if kind is int or kind == int | None:
        return [field.default, int(low), int(min(high, 64)), int(min(high, low + 2))]
    small, large = low + 1e-3 * (high - low), low + 0.3 * (high - low)
    if kind in (RGB, RGB | None):
        return [(n, n, n) for n in (low, small, large, high)]
    return [field.default, low, small, large, high]


def params_of(step: str) -> st.SearchStrategy[dict[str, Any]]:
    """A few parameters of a pass other than their defaults."""
    kinds = typing.get_type_hints(PASSES[step].params)
    choices: dict[str, st.SearchStrategy[Any]] = {}
    for field in dataclasses.fields(PASSES[step].params):
        kind = kinds[field.name]
        if field.name not in NOT_DRAWN and kind is not bool and typing.get_origin(kind) is not Literal:
            choices[field.name] = st.sampled_from(_values(field, kind))
    if not choices:
        return st.just({})
    names = st.lists(st.sampled_from(sorted(choices)), max_size=3, unique=True)
    return names.flatmap(lambda chosen: st.fixed_dictionaries({name: choices[name] for name in chosen}))


HARD_VALUES = {
    "rgb": [0.0, 1e-30, 1.0, 1e5],
    "depth": [1e-3, 0.4, 10.0, 1e5],
    "albedo": [0.0, 1e-6, 1.0],
    "roughness": [0.0, 1e-3, 0.045, 1.0],
    "metallic": [0.0, 0.5, 1.0],
    "emissive": [0.0, 1e5],
    "sky": [0, 1],
    "road": [0, 1],
    "vehicle": [0, 1, 2],
}


@st.composite
def planes_of(draw: st.DrawFn, step: str) -> Callable[[GBuffer], dict[str, Any]]:
    """Some planes with hard values at some pixels, or at all."""
    known = [name for name in PASSES[step].reads if name in HARD_VALUES]
    hard = draw(st.lists(st.sampled_from(known), max_size=2, unique=True)) if known else []
    seed, share = draw(st.integers(0, 2**16)), draw(st.sampled_from([0.1, 1.0]))

    def planes(source: GBuffer) -> dict[str, Any]:
        rng = np.random.default_rng(seed)
        out = {}
        for name in hard:
            values = np.array(HARD_VALUES[name], dtype=PLANES[name].dtype)
            picked = values[rng.integers(0, len(values), source[name].shape)] if share < 1 else rng.choice(values)
            where = rng.random(source[name].shape) < share
            out[name] = np.where(where, picked, source[name]).astype(PLANES[name].dtype)
        return out

    return planes


@st.composite
def lamps(draw: st.DrawFn) -> Any:
    """A lamp anywhere around, of any cone and reach."""
    place = draw(st.tuples(st.floats(-40, 40), st.floats(-20, 20), st.floats(-30, 80)))
    axis = draw(st.sampled_from([(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.1, 0.1)]))
    outer, sharp = draw(st.floats(1, 89.5)), draw(st.floats(0.05, 0.95))
    kind, reach = draw(st.sampled_from(["spot", "point", "directional"])), draw(st.floats(0.5, 200))
    return lamp(place, direction=axis, kind=kind, inner_deg=outer * sharp, outer_deg=outer, r_max_m=reach)


@st.composite
def sceneries(draw: st.DrawFn, step: str) -> Scenery:
    """Any frame, any camera, any lamps, any parameters."""
    turn = draw(st.sampled_from([(0, 0, 0), (20, 5, 0), (0, 90, 0), (0, -90, 10), (130, 3, 180), (-70, -20, 37)]))
    origin = draw(st.sampled_from([(0.0, 0.0, 0.0), (5e5, 100.0, -5e5), (-4e6, -20.0, 4e6)]))
    return Scenery(
        size=draw(st.sampled_from(SIZES)),
        seed=draw(st.integers(0, 2**16)),
        rotation=turned(*turn),
        origin=origin,
        place=draw(st.tuples(st.floats(-400, 400), st.floats(-400, 400))),
        time=draw(st.sampled_from([0.0, 0.1, 7.3, 1e6])),
        preset=draw(st.sampled_from(["overcast", "noon", "midnight"])),
        lights=tuple(draw(st.lists(lamps(), max_size=2))),
        params=draw(params_of(step)),
        planes=draw(planes_of(step)),
    )


def _admitted(step: str, params: dict[str, Any]) -> bool:
    try:
        made: Params = PASSES[step].params(**params)
        made.arguments()
    except InputError:  # one parameter's range depends on another's
        return False
    return True


@pytest.mark.parametrize("step", PASSES)
def test_any_frame_under_any_parameters(opencl_device: OpenCLBackend, step: str) -> None:
    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )
    @given(scenery=sceneries(step))
    def survives(scenery: Scenery) -> None:
        own = dict(scenery.params)
        if step == "fog" and {"sigma_s", "visibility_m"} <= own.keys():
            own.pop("visibility_m")
        assume(_admitted(step, own))
        exact = truth(trial(step, dataclasses.replace(scenery, params=own)))
        case = Case(family="any", name=str(own), scenery=scenery)
        row = tried(exact, opencl_device, case, opencl_device.name)
        assert np.isfinite(row.error), f"{row.plane}: not finite, or negative light, under {own}"
        assert row.within, f"{row.plane}: {row.error:.1e} of {row.bound:.1e} under {own}"

    survives()
