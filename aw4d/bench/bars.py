"""What a run is held to, and by how much it misses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from aw4d.bench.against import COMPILED, NUMBA, PeerRow
from aw4d.bench.curves import ALL, PixelFit
from aw4d.bench.found import Found
from aw4d.bench.frames import AT
from aw4d.bench.passes import NUMPY, PassRow
from aw4d.compare import BAR_MAX, BAR_P9999

FMA_SHARE, COPY_SHARE = 0.55, 0.8
TIMES_COMPILED, TIMES_NUMBA = 20.0, 5.0
OFF_LINE, LIGHTS_TIMES, PARTICLES_TIMES, MEMORY_TIMES, EDIT_TIMES = 0.1, 4.0, 15.0, 1.05, 1.5


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One thing that is asked for and what came."""

    what: str
    wanted: str
    got: str
    met: bool


def bars(found: Found) -> list[Bar]:
    """All bars that the run measured, with the best device of each pass."""
    return [*_shares(found), *_errors(found), *_peers(found), *_costs(found), *_whole(found)]


def best_rows(found: Found) -> list[PassRow]:
    """For every pass the faster device's row on the street at the size that is looked at, or at the only one."""
    on_street = [row for row in found.passes if row.scene == "street" and row.device != NUMPY]
    at = [row for row in on_street if (row.width, row.height) == AT] or on_street
    best: dict[str, PassRow] = {}
    for row in at:
        if row.step not in best or row.time.median_ms < best[row.step].time.median_ms:
            best[row.step] = row
    return list(best.values())


def _shares(found: Found) -> Iterator[Bar]:
    for row in best_rows(found):
        least = FMA_SHARE if row.bound == "fma" else COPY_SHARE
        share = row.share or 0.0
        yield Bar(
            what=f"{row.step}: share of the {row.bound} limit",
            wanted=f">= {least:.0%}",
            got=f"{share:.0%}",
            met=share >= least,
        )


def _errors(found: Found) -> Iterator[Bar]:
    held = [row for row in found.passes if row.max_error is not None and row.device != NUMPY]
    for name, bar in (("max_error", BAR_MAX), ("p9999_error", BAR_P9999)):
        if held:
            worst = max(held, key=lambda row, name=name: getattr(row, name))  # type: ignore[misc]
            value = getattr(worst, name)
            where = f"{worst.step}, {worst.scene} {worst.width}x{worst.height}"
            label = "largest error" if name == "max_error" else "99.99th percentile error"
            yield Bar(what=f"{label} of any pass ({where})", wanted=f"<= {bar:g}", got=f"{value:.1e}", met=value <= bar)


def _peers(found: Found) -> Iterator[Bar]:
    for row in found.peers:
        least = {COMPILED: TIMES_COMPILED, NUMBA: TIMES_NUMBA}.get(row.peer)
        if least is None or row.step not in ("spot_lights", "fog"):
            continue
        what = f"{row.step}, 8 lights, {row.scene}: times as fast as {row.peer}"
        yield Bar(what=what, wanted=f">= {least:g}", got=f"{row.ratio:.1f}", met=row.ratio >= least)
    if found.peers:
        slow: PeerRow = min(found.peers, key=lambda row: (row.is_device, row.ratio))
        what = f"no pass slower than a peer: the nearest, {slow.peer} on {slow.step}"
        yield Bar(what=what, wanted=">= 1", got=f"{slow.ratio:.2f}", met=slow.ratio >= 1)


def _costs(found: Found) -> Iterator[Bar]:
    if found.pixels:
        together = [fit for fit in found.pixels if fit.step == ALL]
        alone: PixelFit = max((fit for fit in found.pixels if fit.step != ALL), key=lambda fit: fit.off)
        for fit in (*together, alone):
            farthest = ": farthest from it" if fit is alone else ""
            what = f"linear in pixels{farthest}, {fit.step} on {fit.device}"
            yield Bar(what=what, wanted=f"<= {OFF_LINE:.0%}", got=f"{fit.off:.0%}", met=fit.off <= OFF_LINE)
    for step, device in dict.fromkeys((point.step, point.device) for point in found.costs):
        for of, most in (("lights", LIGHTS_TIMES), ("particles", PARTICLES_TIMES)):
            seen = [p for p in found.costs if (p.step, p.device, p.of) == (step, device, of)]
            if len(seen) < 2:
                continue
            times = seen[-1].time.median_ms / seen[0].time.median_ms
            what = f"{step} on {device}: {seen[-1].count:,} {of} over {seen[0].count:,}"
            yield Bar(what=what, wanted=f"<= {most:g} times", got=f"{times:.1f}", met=times <= most)
    if len(found.memory) > 1:
        times = found.memory[-1].peak_mb / found.memory[0].peak_mb
        what = f"memory of {found.memory[-1].frames} frames over {found.memory[0].frames}"
        yield Bar(what=what, wanted=f"<= {MEMORY_TIMES:g} times", got=f"{times:.3f}", met=times <= MEMORY_TIMES)


def _whole(found: Found) -> Iterator[Bar]:
    for row in found.whole:
        what = f"edit of {row.frames} frames in {row.weather} over decode and encode"
        yield Bar(what=what, wanted=f"<= {EDIT_TIMES:g} times", got=f"{row.ratio:.2f}", met=row.ratio <= EDIT_TIMES)
