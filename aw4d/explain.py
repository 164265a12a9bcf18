"""What an edit does and leaves out: time of every pass, what it works on of all there is, errors of approximations."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from aw4d.backend import Backend
from aw4d.clip import Clip
from aw4d.colour import srgb_codes
from aw4d.considered import Count, counts
from aw4d.pipeline import Plan, inputs, render
from aw4d.quality import QUALITIES
from aw4d.render import with_clip_exposure
from aw4d.weathers import settings

LOOKED_AT = 3  # frames, spread over those that are asked for
EXACT = "exact"


@dataclass(frozen=True, kw_only=True)
class Approximation:
    """A parameter that is not that of `exact`: how far the picture is from the one with that, in 8-bit codes."""

    parameter: str
    value: float
    exact: float
    p9999_codes: float
    max_codes: float


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """What was seen on some frames.

    Parameters
    ----------
    frames
        Numbers of the frames looked at.
    ms
        Time of every pass that runs, the median of these frames [ms].
    skipped
        Passes that do not run, with the reason: they would change no bit, or another renderer stands for them.
    counts
        Of what there is in these frames, what passes work on; docs/explain.md says what holds for the rest.
    approximations
        What errs; figures of the worst frame.
    """

    frames: tuple[int, ...]
    ms: dict[str, float]
    skipped: dict[str, str]
    counts: tuple[Count, ...]
    approximations: tuple[Approximation, ...]

    def to_json(self) -> dict[str, Any]:
        """The same as JSON."""
        return dataclasses.asdict(self)


def explain(clip: Clip, made: Plan, backend: Backend, chosen: Sequence[int]) -> Explanation:
    """Render a few of the chosen frames to see what passes do and take; none is kept."""
    frames = tuple(chosen[i] for i in sorted({round(i) for i in np.linspace(0, len(chosen) - 1, LOOKED_AT)}))
    made = with_clip_exposure(clip, made, backend)
    seen = [counts(clip, made, backend, index) for index in frames]
    took = [_milliseconds(clip, made, backend, index) for index in frames]
    return Explanation(
        frames=frames,
        ms={step.name: float(np.median([ms[step.name] for ms in took])) for step in made.steps},
        skipped=made.skipped,
        counts=tuple(sum(same[1:], same[0]) for same in zip(*seen, strict=True)),
        approximations=_approximations(clip, made, backend, frames),
    )


def _milliseconds(clip: Clip, made: Plan, backend: Backend, index: int) -> dict[str, float]:
    """Time of every pass [ms], each waited for. Kernels must have been built."""
    planes = backend.upload(*inputs(clip.frame(index, made.planes), made, index))
    took = {}
    for step in made.steps:
        backend.finish()
        start = time.perf_counter()
        backend.run(step.name, planes, step.params)
        backend.finish()
        took[step.name] = 1e3 * (time.perf_counter() - start)
    return took


def _approximations(clip: Clip, made: Plan, backend: Backend, frames: Sequence[int]) -> tuple[Approximation, ...]:
    """What every parameter changes that a quality sets and that is not that of `exact`, one at a time."""
    exact = settings(made.weather, quality=EXACT)
    out = []
    for key in sorted({text.partition("=")[0] for sets in QUALITIES.values() for text in sets}):
        group, _, field = key.partition(".")
        value, best = (getattr(getattr(of, group), field) for of in (made.settings, exact))
        if value == best or group not in {step.name for step in made.steps}:
            continue
        off = [_codes_apart(clip, made, _with(made, group, field, best), backend, index) for index in frames]
        p9999, most = (max(errors) for errors in zip(*off, strict=True))
        out.append(Approximation(parameter=key, value=value, exact=best, p9999_codes=p9999, max_codes=most))
    return tuple(out)


def _with(made: Plan, group: str, field: str, value: float) -> Plan:
    """The plan with one parameter of a pass replaced."""
    params = dataclasses.replace(getattr(made.settings, group), **{field: value})
    steps = tuple(dataclasses.replace(s, params=params) if s.name == group else s for s in made.steps)
    return dataclasses.replace(made, steps=steps, settings=dataclasses.replace(made.settings, **{group: params}))


def _codes_apart(clip: Clip, made: Plan, other: Plan, backend: Backend, index: int) -> tuple[float, float]:
    """99.99th percentile and largest difference of two plans' pictures of a frame, in 8-bit codes."""
    frame = clip.frame(index, made.planes)
    one, two = (srgb_codes(render(backend, frame, plan, index)["rgb"]) for plan in (made, other))
    off = np.abs(one - two)
    return float(np.percentile(off, 99.99)), float(off.max())


def show(made: Plan, explanation: Explanation, console: Console) -> None:
    """Print an explanation for people."""
    looked_at = ", ".join(map(str, explanation.frames))
    console.print(f"{made.weather}, {made.quality}; looked at: frames {looked_at}", highlight=False)
    for table in (_passes(explanation), _counted(explanation), _errors(explanation)):
        if table.row_count:
            console.print(table)


def _table(title: str, *columns: str) -> Table:
    table = Table(title=title, title_justify="left")
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def _passes(explanation: Explanation) -> Table:
    table = _table("passes", "pass", "ms", "why not")
    for name, ms in explanation.ms.items():
        table.add_row(name, f"{ms:.2f}", "")
    for name, reason in explanation.skipped.items():
        table.add_row(name, "not run", reason)
    return table


def _counted(explanation: Explanation) -> Table:
    table = _table("of all that is there, what is worked on", "pass", "what", "considered", "evaluated")
    for count in explanation.counts:
        share = f" ({count.evaluated / count.considered:.1%})" if count.considered else ""
        table.add_row(count.step, count.what, f"{count.considered:,}", f"{count.evaluated:,}{share}")
    return table


def _errors(explanation: Explanation) -> Table:
    title = "approximations: how far the picture is from that of the exact value, in 8-bit codes, worst frame"
    table = _table(title, "parameter", "value", "exact", "99.99th percentile", "maximum")
    for a in explanation.approximations:
        table.add_row(a.parameter, f"{a.value:g}", f"{a.exact:g}", f"{a.p9999_codes:.3f}", f"{a.max_codes:.3f}")
    return table
