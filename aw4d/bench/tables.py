"""The tables of a run: for the terminal and as Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table as RichTable

from aw4d.bench.against import PeerRow
from aw4d.bench.bars import bars
from aw4d.bench.found import MEASURE, Found
from aw4d.bench.limits import BUILTINS
from aw4d.bench.passes import NUMPY, PassRow
from aw4d.bench.timing import Timing
from aw4d.bench.whole import STAGES


@dataclass(frozen=True, kw_only=True)
class Table:
    """A title, a line that says what it shows, and text in columns."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""


def _ms(time: Timing) -> str:
    """Median and quartiles, three digits."""
    return (
        f"{time.median_ms:.3g} ({time.low_ms:.3g} to {time.high_ms:.3g})" if time.runs > 1 else f"{time.median_ms:.3g}"
    )


def _error(value: float | None) -> str:
    return "–" if value is None else f"{value:.1e}"


def tables(found: Found) -> Iterator[Table]:
    """All tables of a run that have rows."""
    for table in (
        _bars(found),
        _limits(found),
        *_passes(found),
        *_peers(found),
        *_knobs(found),
        *_costs(found),
        _whole(found),
        _left_out(found),
    ):
        if table.rows:
            yield table


def _bars(found: Found) -> Table:
    rows = [(bar.what, bar.wanted, bar.got, "yes" if bar.met else "no") for bar in bars(found)]
    return Table(title="What is asked for", columns=("what", "wanted", "got", "met"), rows=rows)


def _limits(found: Found) -> Table:
    rows = [
        (
            one.device,
            str(one.width),
            f"{one.fma_gflop_s:.0f}",
            f"{one.copy_gb_s:.1f}",
            *(f"{one.builtins_g_s[name]:.2g}" for name in BUILTINS),
        )
        for one in found.limits
    ]
    columns = ("device", "width", "fma, GFLOP/s", "copy, GB/s", *(f"{name}, G/s" for name in BUILTINS))
    return Table(title="Limits of the machine", columns=columns, rows=rows, note="The better of before and after.")


def _passes(found: Found) -> Iterator[Table]:
    devices = [one.device for one in found.limits]
    for scene, width, height in dict.fromkeys((row.scene, row.width, row.height) for row in found.passes):
        here = [row for row in found.passes if (row.scene, row.width, row.height) == (scene, width, height)]
        rows = []
        for step in dict.fromkeys(row.step for row in here):
            by_device = {row.device: row for row in here if row.step == step}
            one = next(row for row in by_device.values())
            numpy = by_device.get(NUMPY)
            cells = [step, f"{one.bytes / 1e6:.1f}", f"{one.operations / 1e6:.0f}"]
            cells.append(f"{numpy.time.median_ms:.3g}" if numpy else "–")
            for device in devices:
                cells += _device_cells(by_device[device])
            rows.append(cells)
        each = [f"{device}: {what}" for device in devices for what in ("ms", "of the limit", "error")]
        columns = ("pass", "MB", "M operations", "numpy, ms", *each)
        note = "Median and quartiles; error: maximum, 99.99th percentile."
        yield Table(title=f"Passes, {scene}, {width}x{height}", columns=columns, rows=rows, note=note)


def _device_cells(row: PassRow) -> list[str]:
    errors = "–" if row.max_error is None else f"{_error(row.max_error)}, {_error(row.p9999_error)}"
    return [_ms(row.time), f"{row.share or 0:.0%} {row.bound}", errors]


def _peers(found: Found) -> Iterator[Table]:
    columns = ("pass", "scene", "by", "ms", "times the fastest device", "error: maximum", "99.99th percentile")
    rows = [(*_peer_cells(row), _error(row.max_error), _error(row.p9999_error)) for row in found.peers]
    note = "The same arithmetic on the same planes with the same threads."
    yield Table(title="Peers", columns=columns, rows=rows, note=note)
    painted = [(row.step, row.peer, _ms(row.time)) for row in found.today]
    note = "For time alone: these paint over pixels by chance, and know neither depth nor light."
    yield Table(title="What people use today", columns=("transform", "by", "ms"), rows=painted, note=note)


def _peer_cells(row: PeerRow) -> tuple[str, str, str, str, str]:
    return row.step, row.scene, row.peer, _ms(row.time), f"{row.ratio:.2f}"


def _knobs(found: Found) -> Iterator[Table]:
    columns = ("knob", "setting", "ms", "error: maximum", "99.99th percentile", "mean, 8-bit codes", "on the front")
    rows = [
        (
            point.knob,
            f"{point.setting} (default)" if point.default else point.setting,
            _ms(point.time),
            _error(point.max_error),
            _error(point.p9999_error),
            f"{point.mean_codes:.2g}",
            "yes" if point.on_front else "no",
        )
        for point in found.knobs
    ]
    yield Table(title="Speed against error", columns=columns, rows=rows)
    of_quality = ("weather", "clip", "quality", "ms", "99.99th percentile, 8-bit codes", "maximum")
    qualities = [
        (one.weather, one.clip, one.quality, f"{one.ms:.3g}", f"{one.p9999_codes:.2f}", f"{one.max_codes:.2f}")
        for one in found.qualities
    ]
    note = "Passes of one frame; error against `exact`."
    yield Table(title="Qualities", columns=of_quality, rows=qualities, note=note)
    half = [(row.step, _error(row.max_error), _error(row.p9999_error)) for row in found.half_planes]
    note = "Error of each pass where all planes that it reads were rounded to float16 first."
    of_half = ("pass", "error: maximum", "99.99th percentile")
    yield Table(title="Float16 planes", columns=of_half, rows=half, note=note)


def _costs(found: Found) -> Iterator[Table]:
    fits = [
        (fit.step, fit.device, f"{fit.fixed_ms:.2g}", f"{fit.ms_a_megapixel:.3g}", f"{fit.off:.0%}")
        for fit in found.pixels
    ]
    columns = ("pass", "device", "fixed, ms", "ms a megapixel", "farthest from the line")
    yield Table(title="Cost by pixels", columns=columns, rows=fits)
    rows = []
    for point in found.costs:
        first = next(p for p in found.costs if (p.step, p.device, p.of) == (point.step, point.device, point.of))
        times = point.time.median_ms / first.time.median_ms
        rows.append((point.step, point.device, f"{point.count:,} {point.of}", _ms(point.time), f"{times:.1f}"))
    columns = ("pass", "device", "for", "ms", "times the first")
    yield Table(title="Cost by lights and particles", columns=columns, rows=rows)
    memory = [(str(one.frames), f"{one.peak_mb:.0f}") for one in found.memory]
    yield Table(title="Memory by frames", columns=("frames", "peak, MB"), rows=memory)


def _whole(found: Found) -> Table:
    rows = []
    for row in found.whole:
        total = sum(row.stages_ms.values())
        stages = [f"{row.stages_ms[stage]:.1f} ({row.stages_ms[stage] / total:.0%})" for stage in STAGES]
        rows.append((row.weather, *stages, f"{row.edit_s:.2f}", f"{row.bare_s:.2f}", f"{row.ratio:.2f}"))
    columns = ("weather", *(f"{stage}, ms" for stage in STAGES), "edit, s", "decode and encode alone, s", "ratio")
    note = "Stages one after the other, a frame; in an edit they overlap."
    return Table(title="End to end", columns=columns, rows=rows, note=note)


def _left_out(found: Found) -> Table:
    rows = [(one.what, one.why) for one in found.left_out]
    return Table(title="Left out", columns=("what", "why"), rows=rows)


def show(found: Found, console: Console) -> None:
    """Print all tables."""
    for table in tables(found):
        drawn = RichTable(title=table.title, caption=table.note or None)
        for column in table.columns:
            drawn.add_column(column, overflow="fold")
        for row in table.rows:
            drawn.add_row(*row)
        console.print(drawn)


def to_markdown(found: Found, command: str) -> str:
    """All tables, and what made them."""
    about = ", ".join(f"{key} {value}" for key, value in found.about.items())
    parts = ["# Bench", f"Made by `{command}` in {sum(found.seconds.values()):.0f} s; not edited by hand."]
    parts.append(f"{about}. [performance.md](performance.md) says how to read it. Error: `{MEASURE}`.")
    for table in tables(found):
        head = [f"## {table.title}"] + ([table.note] if table.note else [])
        lines = [_line(table.columns), _line(["---"] * len(table.columns)), *map(_line, table.rows)]
        parts += [*head, "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
