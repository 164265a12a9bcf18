"""I3D, which sees videos: TorchScript from a file. Carreira and Zisserman 2017."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval import hashes
from eval.errors import MetricError
from eval.models import weights

FEATURES = 400  # one for each class of Kinetics-400, before the softmax
WHENCE = (
    "FVD needs I3D trained on Kinetics-400 as TorchScript, i3d_torchscript.pt (49 MB): the conversion of DeepMind's "
    "kinetics-i3d (Apache-2.0) by the authors of StyleGAN-V, on Hugging Face as flateon/FVD-I3D-torchscript. "
    "Fetch it yourself and pass its path with --i3d-weights."
)


class I3D:
    """I3D from a TorchScript file, called as x, rescale=True, resize=True, return_features=True.

    Parameters
    ----------
    path
        The file. It holds code that runs when it is called: take it from whom you trust.

    Raises
    ------
    MetricError
        PyTorch is missing, there is no such file, or it is not TorchScript.
    """

    def __init__(self, path: Path) -> None:
        self._torch: Any = weights.module("torch")
        self.path = weights.found(path, WHENCE)
        self.sha256 = hashes.of_file(path)
        self.device = weights.device()
        try:
            self._net = self._torch.jit.load(str(path), map_location=self.device).eval()
        except RuntimeError as error:
            raise MetricError(f"weights {path}: expected TorchScript, got a file that is none. {WHENCE}") from error

    @property
    def description(self) -> dict[str, str]:
        """All that decides the numbers: the file, which holds the network too, and its SHA-256."""
        return {"file": self.path.name, "sha256": self.sha256}

    @property
    def identity(self) -> str:
        """One hash of the same, wherever the file is and whatever it is called: for the keys of caches."""
        return self.sha256

    def features(self, clips: Iterable[NDArray[np.uint8]], batch: int = 1) -> NDArray[np.float32]:
        """Features of clips (T, H, W, 3) of RGB codes, (N, 400); clips of one batch have one shape.

        Raises
        ------
        MetricError
            The module does not take these arguments, or returns something else.
        """
        groups = [self._features(group) for group in weights.batches(clips, batch)]
        return np.concatenate(groups) if groups else np.empty((0, FEATURES), np.float32)

    def _features(self, clips: list[NDArray[np.uint8]]) -> NDArray[np.float32]:
        x = self._torch.from_numpy(np.stack(clips)).to(self.device).float().permute(0, 4, 1, 2, 3)
        try:
            with self._torch.no_grad():
                found = self._net(x, rescale=True, resize=True, return_features=True)
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1]
            raise MetricError(f"weights {self.path}: called on clips {tuple(x.shape)} it fails: {reason}") from error
        if tuple(found.shape) != (len(clips), FEATURES):
            got = tuple(found.shape)
            raise MetricError(f"weights {self.path}: expected features ({len(clips)}, {FEATURES}), got {got}. {WHENCE}")
        return np.asarray(found.float().cpu().numpy(), dtype=np.float32)
