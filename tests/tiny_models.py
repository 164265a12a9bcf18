"""Models of the metrics' kinds, tiny and random, as files like those that users have."""

from __future__ import annotations

import json
from pathlib import Path

import open_clip
import torch
from torch import nn

CONFIG = {
    "embed_dim": 16,
    "vision_cfg": {"image_size": 32, "layers": 2, "width": 64, "patch_size": 8},
    "text_cfg": {"context_length": 77, "vocab_size": 49408, "width": 64, "heads": 1, "layers": 1},
}


def clip(*, seed: int, quick_gelu: bool = False) -> nn.Module:
    """A CLIP whose random weights are large enough for its answers to differ."""
    torch.manual_seed(seed)
    net = open_clip.CLIP(**CONFIG, quick_gelu=quick_gelu)
    for parameter in net.parameters():
        if parameter.ndim > 1:
            nn.init.normal_(parameter, std=0.2)
    return net.eval()


def save_clip(folder: Path, *, seed: int = 0, quick_gelu: bool = False) -> Path:
    """A checkpoint with its configuration beside it, as on Hugging Face."""
    folder.mkdir(parents=True, exist_ok=True)
    config = {"model_cfg": {**CONFIG, "quick_gelu": quick_gelu}, "preprocess_cfg": {"interpolation": "bicubic"}}
    (folder / "open_clip_config.json").write_text(json.dumps(config), encoding="utf-8")
    path = folder / "open_clip_pytorch_model.bin"
    torch.save(clip(seed=seed, quick_gelu=quick_gelu).state_dict(), path)
    return path


def save_archive(path: Path, *, seed: int) -> Path:
    """A TorchScript archive, as OpenAI published its weights."""
    net = clip(seed=seed, quick_gelu=True)
    mask = net._buffers.pop("attn_mask")  # a constant in theirs
    net.attn_mask = mask
    torch.jit.trace(net, (torch.zeros(1, 3, 32, 32), torch.zeros(1, 77, dtype=torch.int64))).save(str(path))
    return path


class I3DShaped(nn.Module):
    """Takes and returns what I3D does; its features see motion, as they are of differences in time too."""

    def __init__(self, features: int = 400) -> None:
        super().__init__()
        self.space = nn.Conv3d(3, features // 2, (1, 7, 7), stride=(1, 4, 4))
        self.time = nn.Conv3d(3, features - features // 2, (3, 7, 7), stride=(1, 4, 4))

    def forward(
        self, x: torch.Tensor, rescale: bool = False, resize: bool = False, return_features: bool = False
    ) -> torch.Tensor:
        if resize:
            x = nn.functional.interpolate(x, size=(x.shape[2], 32, 32), mode="trilinear", align_corners=False)
        if rescale:
            x = 2 * x / 255 - 1
        parts = [layer.relu().mean(dim=(2, 3, 4)) for layer in (self.space(x), self.time(x))]
        found = torch.cat(parts, dim=1)
        return found if return_features else found.softmax(dim=1)


def save_i3d(path: Path, *, seed: int = 0, features: int = 400) -> Path:
    """A scripted module that is called as I3D is."""
    torch.manual_seed(seed)
    net = I3DShaped(features).eval()
    for parameter in net.parameters():
        nn.init.normal_(parameter, std=0.3)
    torch.jit.script(net).save(str(path))
    return path
