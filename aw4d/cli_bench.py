"""The command `aw4d bench`: what is measured, and where its results go."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aw4d.console import out_console


def bench(
    clip: Annotated[
        list[Path] | None, typer.Option(help="A clip to measure on, beside the built-in street. Repeatable.")
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Everything.")] = None,
    plots: Annotated[Path | None, typer.Option(help="Folder for bench_*.png, or hard_cases.png.")] = None,
    markdown: Annotated[Path | None, typer.Option(help="The tables, as Markdown.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Tiny pictures and few runs: whether it works.")] = False,
    hard: Annotated[bool, typer.Option("--hard", help="Hard cases: error against bound, and exit.")] = False,
) -> None:
    """Measure speed against error: every pass on every device, the machine's limits, peers, and cost curves."""
    if hard:
        from aw4d.bench.hard import report

        report(out_console)
        if plots is not None:
            from aw4d.bench.hard_sweeps import draw_sweeps

            draw_sweeps(plots / "hard_cases.png")
        return
    from aw4d.bench.run import run_bench

    run_bench(clip or [], out_console, json_file=json_file, plots=plots, markdown=markdown, quick=quick)
