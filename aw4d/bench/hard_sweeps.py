"""Errors over one quantity at a time: roughness, distance, density, size of the coordinates; and their picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aw4d.backend import Backend
from aw4d.bench.hard import ADMITTED, HardCase, devices, on_device, truth, worst
from aw4d.bench.hard_cases import Case
from aw4d.bench.hard_inputs import Scenery, trial
from aw4d.gbuffer import GBuffer
from aw4d.io.files import replacing

LEAST, MOST = 1e-9, 1e-3  # error that the picture shows
SIZE = (48, 16)  # width, height [px]


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """One quantity: what it is, its values, the passes that it concerns, and the scenery at a value."""

    label: str
    values: tuple[float, ...]
    steps: tuple[str, ...]
    scenery: Callable[[float], Scenery]


def _even(plane: str, value: float) -> Scenery:
    """A plane of one value."""

    def planes(source: GBuffer) -> dict[str, Any]:
        return {plane: np.full_like(source[plane], value)}

    return Scenery(size=SIZE, planes=planes)


SWEEPS: dict[str, Sweep] = {
    "roughness": Sweep(
        label="roughness",
        values=tuple(np.geomspace(1e-4, 1, 25).tolist()),
        steps=("spot_lights", "ambient", "reflections"),
        scenery=lambda value: _even("roughness", value),
    ),
    "distance": Sweep(
        label="depth [m]",
        values=tuple(np.geomspace(1e-3, 1e5, 33).tolist()),
        steps=("fog", "spot_lights", "ambient"),
        scenery=lambda value: _even("depth", value),
    ),
    "density": Sweep(
        label="scattering coefficient [1/m]",
        values=tuple(np.geomspace(1e-8, 10, 37).tolist()),
        steps=("fog",),
        scenery=lambda value: Scenery(size=SIZE, params={"sigma_s": value}),
    ),
    "coordinates": Sweep(
        label="distance from the world's origin [m]",
        values=tuple(np.geomspace(1, 1e7, 29).tolist()),
        steps=("puddles", "ripples", "snow_cover"),
        scenery=lambda value: Scenery(size=SIZE, origin=(value, 0.0, -value)),
    ),
}


def sweep(name: str, backends: Mapping[str, Backend]) -> list[tuple[float, HardCase]]:
    """Every value of a sweep with its error, pass by pass and backend by backend."""
    chosen, found = SWEEPS[name], []
    for step in chosen.steps:
        for value in chosen.values:
            case = Case(family=name, name=f"{value:.3g}", scenery=chosen.scenery(value))
            exact = truth(trial(step, case.scenery))
            for device, backend in backends.items():
                found.append((value, worst(exact, on_device(exact.trial, backend), case, device)))
    return found


def draw_sweeps(path: Path) -> None:
    """A panel a sweep, a curve a pass by its worst device; dashed the bound where a condition number lifts it."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    backends = devices()
    figure, panels = plt.subplots(2, 2, figsize=(12, 8), layout="constrained")
    for panel, name in zip(panels.flat, SWEEPS, strict=True):
        _panel(panel, SWEEPS[name].label, sweep(name, backends))
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=90)
    plt.close(figure)


def _panel(panel: Any, label: str, found: list[tuple[float, HardCase]]) -> None:
    for number, step in enumerate(dict.fromkeys(row.step for _, row in found)):
        worst_row: dict[float, HardCase] = {}
        for value, row in found:
            if row.step == step and (value not in worst_row or row.error > worst_row[value].error):
                worst_row[value] = row
        errors = [max(row.error, LEAST) for row in worst_row.values()]
        panel.loglog(list(worst_row), errors, color=f"C{number}", label=step)
        bounds = [row.bound for row in worst_row.values()]
        if max(bounds) > ADMITTED:
            panel.loglog(list(worst_row), bounds, color=f"C{number}", linestyle="--", linewidth=0.7)
    panel.axhline(ADMITTED, color="black", linewidth=0.8)
    panel.set(xlabel=label, ylabel="largest error", ylim=(LEAST, MOST))
    panel.legend(fontsize=8)
