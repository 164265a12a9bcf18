"""Hard cases as a report: every pass on inputs at its limits, its error beside the bound that the problem implies."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from aw4d import opencl
from aw4d.backend import Backend
from aw4d.backend_numpy import NumpyBackend
from aw4d.backend_opencl import OpenCLBackend
from aw4d.bench.hard_cases import CASES, Case
from aw4d.bench.hard_inputs import Trial, trial
from aw4d.compare import VECTORS
from aw4d.params import Params
from aw4d.passes import PASSES

Array = NDArray[np.float64]
HALF_ULP = 2.0**-24
ADMITTED = 1e-5  # of the value, or of a thousandth of the bright ones where it is darker
FACTOR = 16  # on half an ulp times the condition number
DARK = 1e-30  # of white; what is darker is as good as black
DRAWS = 8  # of the inputs' signs, for the condition number
SIGNED = frozenset({"normal", "ripple"})


@dataclass(frozen=True, kw_only=True)
class HardCase:
    """One pass on one hard input: the error that lies highest above its bound on a device.

    Parameters
    ----------
    step, family, case, device
        What was run.
    plane
        The result it was seen in.
    error
        |x - ref| / max(|ref|, 1e-3 p99(|ref|)); infinite where x is not finite or light is negative.
    condition
        Of the value there: how much larger the relative change of a result is than that of the inputs. 0 where the
        error needed no such excuse.
    """

    step: str
    family: str
    case: str
    device: str
    plane: str
    error: float
    condition: float

    @property
    def bound(self) -> float:
        """1e-5, or 16 * 2^-24 times the condition number."""
        return max(ADMITTED, FACTOR * HALF_ULP * self.condition)

    @property
    def within(self) -> bool:
        """Whether the error is inside its bound."""
        return self.error <= self.bound


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """What a pass makes of a trial by definition, in float64, and how far half an ulp of its inputs moves it."""

    trial: Trial
    results: Mapping[str, Array]

    def moved(self) -> dict[str, Array]:
        """The farthest of some draws of the signs, by result."""
        rng = np.random.default_rng(1)
        far = {name: np.zeros_like(_sizes(name, values)) for name, values in self.results.items()}
        for _ in range(DRAWS):
            for name, values in _defined(self.trial, rng).items():
                far[name] = np.maximum(far[name], _sizes(name, values - self.results[name]))
        return far


def _sizes(name: str, values: Array) -> Array:
    """Of numbers, their size; of directions, their length."""
    return np.asarray(np.linalg.norm(values, axis=-1) if name in VECTORS else np.abs(values))


def _results(step: str) -> list[str]:
    return list(dict.fromkeys([*PASSES[step].writes, *PASSES[step].layers]))


def _defined(held: Trial, nudged_by: np.random.Generator | None = None) -> Mapping[str, Array]:
    backend, params = NumpyBackend(), held.params
    planes = backend.upload(held.frame, held.scene)
    for name, values in held.working.items():
        backend.put(planes, name, values)
    if nudged_by is not None:
        planes.arrays = {name: _nudged(values, nudged_by) for name, values in planes.arrays.items()}
        planes.arguments = {
            name: _nudged(value, nudged_by) if _is_measured(name) else value for name, value in planes.arguments.items()
        }
        params = _Nudged(params, nudged_by)
    backend.run(held.step, planes, params)
    return backend.download64(planes, _results(held.step))


class _Nudged(Params):
    """Parameters of which those numbers are moved that no float32 holds: a kernel gets them rounded."""

    def __init__(self, params: Params, rng: np.random.Generator) -> None:
        self._params, self._rng = params, rng

    def arguments(self) -> dict[str, Any]:
        """Arguments of the pass."""
        return {
            name: _nudged(value, self._rng) if isinstance(value, float) and value != float(np.float32(value)) else value
            for name, value in self._params.arguments().items()
        }


def _is_measured(argument: str) -> bool:
    """Inputs that are float32 as they come; places are kept as sums of two and tables are the environment's own."""
    return argument in {"fx", "fy", "cx", "cy", "sun_direction"} or argument.startswith("light_")


def _nudged(value: Any, rng: np.random.Generator) -> Any:
    """Half an ulp more or less of every number."""
    if np.asarray(value).dtype.kind != "f":
        return value
    return value * (1 + HALF_ULP * rng.choice([-1.0, 1.0], size=np.shape(value)))


def truth(held: Trial) -> Truth:
    """The definition of a trial's results.

    Raises
    ------
    FloatingPointError
        One is not finite, or is light and negative.
    """
    results = _defined(held)
    for name, values in results.items():
        if not np.isfinite(values).all() or (name not in SIGNED and (values < 0).any()):
            raise FloatingPointError(
                f"{held.step}: {name}: expected finite light, got {values.min()} to {values.max()}"
            )
    return Truth(trial=held, results=results)


def on_device(held: Trial, backend: Backend, layers: bool = True) -> Mapping[str, NDArray[np.float32]]:
    """What a backend makes of a trial, with all layers or, as an edit has it, with none: kernels differ."""
    step = PASSES[held.step]
    planes = backend.upload(held.frame, held.scene, list(step.layers) if layers else [])
    for name, values in held.working.items():
        backend.put(planes, name, values)
    backend.run(held.step, planes, held.params)
    return backend.download(planes, _results(held.step) if layers else step.writes)


def tried(exact: Truth, backend: Backend, case: Case, device: str) -> HardCase:
    """The worst that a backend makes of a trial, with its layers and without."""
    ways = (True, False) if PASSES[exact.trial.step].layers else (True,)
    rows = [worst(exact, on_device(exact.trial, backend, layers), case, device) for layers in ways]
    return max(rows, key=lambda row: row.error / row.bound)


def worst(exact: Truth, found: Mapping[str, NDArray[np.float32]], case: Case, device: str) -> HardCase:
    """The result of a trial that lies highest above its bound."""
    moved: dict[str, Array] | None = None
    seen: list[HardCase] = []
    for name, expected in exact.results.items():
        if name not in found:
            continue
        size = _sizes(name, expected)
        scale = np.maximum(size, max(1e-3 * float(np.percentile(size, 99)), DARK))
        values = found[name].astype(np.float64)
        wrong = ~np.isfinite(values) | ((values < 0) & (name not in SIGNED))
        off = (
            np.where(wrong.any(axis=-1) if name in VECTORS else wrong, np.inf, _sizes(name, values - expected)) / scale
        )
        condition = np.zeros_like(off)
        if off.max() > ADMITTED and np.isfinite(off).all():
            moved = moved or exact.moved()
            condition = moved[name] / scale / HALF_ULP
        at = np.unravel_index(np.argmax(off / np.maximum(ADMITTED, FACTOR * HALF_ULP * condition)), off.shape)
        named = {"step": exact.trial.step, "family": case.family, "case": case.name, "device": device, "plane": name}
        seen.append(HardCase(**named, error=float(off[at]), condition=float(condition[at])))
    return max(seen, key=lambda row: row.error / row.bound)


def measure(backends: Mapping[str, Backend], steps: Iterable[str] = PASSES) -> Iterator[HardCase]:
    """Every hard case of some passes on some backends, by name."""
    for step in steps:
        for case in CASES:
            if case.concerns(step):
                exact = truth(trial(step, case.scenery))
                for device, backend in backends.items():
                    yield tried(exact, backend, case, device)


def devices() -> dict[str, Backend]:
    """Every usable OpenCL device by name.

    Raises
    ------
    InputError
        No OpenCL runtime can be loaded.
    """
    return {report.label: OpenCLBackend(report.index) for report in opencl.devices() if report.usable}


def report(console: Console) -> list[HardCase]:
    """Run the hard cases on every usable OpenCL device, print the worst of every pass and family, and return them all.

    Raises
    ------
    InputError
        No OpenCL runtime can be loaded.
    """
    backends = devices()
    found = list(measure(backends))
    console.print(table(found))
    outside = [row for row in found if not row.within]
    console.print(f"{len(found)} runs on {len(backends)} devices, {len(outside)} outside their bound")
    for row in outside:
        console.print(
            f"  {row.step}, {row.family}, {row.case}, {row.plane}, {row.device}: {row.error:.1e} of {row.bound:.1e}",
            markup=False,
            soft_wrap=True,
        )
    return found


def table(found: Sequence[HardCase]) -> Table:
    """The worst run of every pass and family."""
    out = Table(title="error against float64; bound: 1e-5, or 16 x 2^-24 x the condition number")
    for column in ("pass", "family", "runs", "worst case", "plane", "error", "condition", "bound", "within"):
        out.add_column(column, overflow="fold")
    groups: dict[tuple[str, str], list[HardCase]] = {}
    for row in found:
        groups.setdefault((row.step, row.family), []).append(row)
    for (step, family), rows in groups.items():
        top = max(rows, key=lambda row: row.error / row.bound)
        condition = f"{top.condition:.1e}" if top.condition else ""
        verdict = "yes" if all(row.within for row in rows) else "[red]no[/]"
        cells = (top.case, top.plane, f"{top.error:.1e}", condition, f"{top.bound:.1e}", verdict)
        out.add_row(step, family, str(len(rows)), *cells)
    return out
