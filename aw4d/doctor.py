"""The state of OpenCL on this machine, for people."""

from __future__ import annotations

from rich.console import Console

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
    try:
        found = opencl.devices()
    except InputError as error:
        console.print(str(error), style="red")
        found = ()
    for r in found:
        console.print(f"[bold]{r.index}[/]  {r.name}", highlight=False)
        console.print(f"   {r.platform}, {r.version}; {r.kind}, {r.units} units, vectors of {r.width}", highlight=False)
        verdict = "[green]works[/]: a kernel was built and ran" if r.usable else f"[red]refused[/]: {r.problem}"
        verdict = "[green]works[/]: a kernel was built and ran" if r.usable else f"[red]refused[/]: {r.problem}"
        console.print(f"   {verdict}", highlight=False)
    if not any(r.usable for r in found):
        console.print(HOW_TO_GET_ONE)
        return False
    console.print(f"auto takes {opencl.choose().index}: {opencl.choose().label}", highlight=False, soft_wrap=True)
    return True
