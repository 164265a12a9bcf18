"""The state of OpenCL on this machine, for people."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape

from aw4d import opencl
from aw4d.errors import InputError

HOW_TO_GET_ONE = (
    "No OpenCL device works. Everything runs on NumPy, some 100 times slower. To get one:\n"
    "  Debian, Ubuntu:   sudo apt-get install pocl-opencl-icd\n"
    "  without root:     pip install intel-opencl-rt intel-cmplr-lib-rt   (also on AMD processors)\n"
    "  GPU:              the vendor's driver, then `clinfo` must list the card"
)


def report(console: Console) -> bool:
    """Print every device, what a kernel built and run on it showed, and which one `auto` takes.

    Returns
    -------
    bool
        Whether any device works.
    """

    def say(text: str) -> None:
        console.print(text, highlight=False, soft_wrap=True)

    try:
        found = opencl.devices()
    except InputError as error:
        say(f"[red]{escape(str(error))}[/]")
        found = ()
    for r in found:
        say(f"[bold]{r.index}[/]  {escape(r.name)}")
        say(f"   {escape(r.platform)}, {escape(r.version)}; {r.kind}, {r.units} units, vectors of {r.width}")
        works = "[green]works[/]: a kernel was built and ran"
        say("   " + (works if r.usable else f"[red]refused[/]: {escape(r.problem)}"))
    if not any(r.usable for r in found):
        say(HOW_TO_GET_ONE)
        return False
    say(f"auto takes {opencl.choose().index}: {escape(opencl.choose().label)}")
    return True
