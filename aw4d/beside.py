"""A second process that compiles an edit's kernels from the last one on, where a driver compiles them one at a time.

PoCL compiles a kernel when it first runs, under one lock for all threads of a process, and keeps it on disk. The second
process runs the passes of the edit on a frame of nothing, the last pass first; this process begins with the first, and
where they meet each finds what the other has left there. Nothing depends on it: wherever it ends, this process
compiles the rest.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from aw4d.backend import Twin
from aw4d.backend_opencl import OpenCLBackend
from aw4d.camera import Camera
from aw4d.gbuffer import PLANES, GBuffer, Plane
from aw4d.params import Params
from aw4d.passes import IMAGE, WORKING
from aw4d.scene import Scene

CODE = "from aw4d.beside import main; main()"  # what the second process runs


def begin(
    twin: Twin,
    passes: Mapping[str, Params],
    planes: Sequence[str],
    layers: Sequence[str],
    camera: Camera,
    scene: Callable[[], Scene],
) -> threading.Thread | None:
    """Start the second process; it ends by itself, and no later than this one.

    Parameters
    ----------
    twin
        The backend that it opens.
    passes
        Parameters by the passes' names, in their order.
    planes, layers, camera, scene
        What a frame has; the scene is asked for while the process starts.

    Returns
    -------
    A thread that lives as long as the second process; None where none can be started.
    """
    command = [sys.executable, "-P", "-c", CODE, str(twin.device), str(twin.width)]
    found = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    nowhere = subprocess.DEVNULL
    try:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=nowhere, stderr=nowhere, env=found)
    except OSError:
        return None
    task = pickle.dumps((dict(passes), list(planes), list(layers), camera, scene()))
    thread = threading.Thread(target=_attend, args=(process, task), daemon=True, name="beside")
    thread.start()
    return thread


def _attend(process: subprocess.Popen[bytes], task: bytes) -> None:
    """Give a process its task and keep its input open until it ends, by which it knows that this one lives."""
    with contextlib.suppress(OSError), process:
        assert process.stdin is not None
        process.stdin.write(task)
        process.stdin.flush()
        process.wait()


def main() -> None:
    """What the second process does."""
    backend = OpenCLBackend(int(sys.argv[1]), int(sys.argv[2]))
    task = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_the_first, daemon=True).start()
    compile_from_the_end(backend, *task)


def _end_with_the_first() -> None:
    sys.stdin.buffer.read()
    os._exit(1)


def compile_from_the_end(
    backend: OpenCLBackend,
    passes: Mapping[str, Params],
    planes: Sequence[str],
    layers: Sequence[str],
    camera: Camera,
    scene: Scene,
) -> None:
    """Run passes, the last one first, on a frame of nothing: what is compiled is the same for all frames of a size."""
    frame = backend.upload(nothing({"rgb", *planes}, camera), scene, layers)  # the image is made of `rgb`
    for name, channels in WORKING.items():  # what the passes before would have made
        shape = camera.shape if channels == 1 else (*camera.shape, channels)
        backend.put(frame, name, np.zeros(shape, np.float32))
    backend.download(frame, [IMAGE])
    for name in reversed(list(passes)):
        backend.run(name, frame, passes[name])
        backend.finish()


def nothing(planes: Collection[str], camera: Camera) -> GBuffer:
    """A frame of a wall that faces the camera, as near and as dark as can be."""
    held: dict[str, Plane] = {}
    for name in planes:
        spec = PLANES[name]
        held[name] = np.full(spec.shape(*camera.shape), max(spec.low, 0), spec.dtype)
    if "normal" in held:
        held["normal"][..., 2] = -1
    return GBuffer(held, camera=camera, time=0.0)
