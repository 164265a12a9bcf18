"""CLIP, which sees pictures and reads texts: open_clip with a checkpoint of the user's. Radford et al. 2021."""

from __future__ import annotations

import json
import logging
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval import hashes
from eval.clip_score import Resize
from eval.errors import MetricError
from eval.models import weights

CONFIG = "open_clip_config.json"
WHENCE = (
    "CLIP's weights are for you to fetch, for example ViT-L/14: OpenAI's ViT-L-14.pt (MIT), or from Hugging Face "
    f"laion/CLIP-ViT-L-14-laion2B-s32B-b82K (MIT), open_clip_model.safetensors with {CONFIG} beside it. "
    "Pass the path with --clip-weights."
)


class Clip:
    """A CLIP of open_clip's kinds, in float32.

    What the weights belong to is told by the file itself (an archive of OpenAI's), by `open_clip_config.json` in its
    folder, or by `model`. The activation is part of that, and no checkpoint of plain weights says which it was trained
    with: OpenAI's weights, and those grown from them, need a model whose name ends in `-quickgelu`. The wrong one
    gives wrong numbers without an error; `activation` says which is used, `description` and `identity` have it.

    Parameters
    ----------
    path
        File of weights: .safetensors, a PyTorch checkpoint, or an archive of OpenAI's.
    model
        A name of open_clip's, such as ViT-L-14-quickgelu; None where the weights say it.

    Raises
    ------
    MetricError
        open_clip is missing, there is no such file, the model is unknown or not told, or the weights are another's.
    """

    def __init__(self, path: Path, model: str | None = None) -> None:
        self._torch: Any = weights.module("torch")
        self._open_clip: Any = weights.module("open_clip")
        self.path = weights.found(path, WHENCE)
        self.device = weights.device()
        if _is_archive(path):
            self._of_archive(model)
        else:
            self._of_config(model)
        self._net.to(self.device).eval()
        self.context: int = self._tokenizer.context_length
        kinds = {type(layer).__name__ for layer in self._net.modules()}
        self.activation = "QuickGELU" if "QuickGELU" in kinds else "GELU"
        self.sha256 = hashes.of_file(path)

    @property
    def description(self) -> dict[str, str]:
        """All that decides the numbers: the file of weights and its SHA-256, the model, the activation."""
        return {"file": self.path.name, "sha256": self.sha256, "model": self.model, "activation": self.activation}

    @property
    def identity(self) -> str:
        """One hash of the same, wherever the files are and whatever they are called: for the keys of caches."""
        return hashes.of_settings({key: value for key, value in self.description.items() if key != "file"})

    def _of_archive(self, model: str | None) -> None:
        if model is not None:
            raise MetricError(f"weights {self.path}: an archive of OpenAI's says its model itself, got {model}")
        self.model = "OpenAI archive"
        try:
            self._net = self._open_clip.load_openai_model(str(self.path), precision="fp32", device="cpu")
        except Exception as error:  # open_clip, torch and safetensors have no error in common
            raise MetricError(f"weights {self.path}: expected a CLIP of OpenAI's: {_first(error)}") from error
        self._tokenizer = self._open_clip.SimpleTokenizer(context_length=self._net.context_length)

    def _of_config(self, model: str | None) -> None:
        known = model or self._beside()
        self._refuse_what_is_fetched(known)
        self.model = model or f"{CONFIG} {hashes.of_file(self.path.parent / CONFIG)}"
        try:
            with _without_warnings():  # of the random weights that the next line replaces
                self._net = self._open_clip.create_model(known, load_weights=False, pretrained_text=False)
            self._open_clip.load_checkpoint(self._net, str(self.path))
        except Exception as error:  # open_clip, torch and safetensors have no error in common
            raise MetricError(f"weights {self.path}: they do not fit {model or CONFIG}: {_first(error)}") from error
        self._tokenizer = self._open_clip.get_tokenizer(known)

    def _beside(self) -> str:
        """open_clip's name of the folder that holds the weights and their configuration."""
        config = self.path.parent / CONFIG
        if not config.is_file():
            raise MetricError(
                f"weights {self.path}: expected {CONFIG} in the same folder, or --clip-model with a name of "
                "open_clip's: ViT-L-14-quickgelu for OpenAI's weights, ViT-L-14 for LAION's"
            )
        return f"local-dir:{self.path.parent}"

    def _refuse_what_is_fetched(self, known: str) -> None:
        """Models that open_clip would download a part of."""
        beside = known.startswith("local-dir:")
        if not beside and known not in self._open_clip.list_models():
            raise MetricError(f"--clip-model: expected a name of open_clip.list_models(), got {known!r}")
        try:
            text = dict(self._open_clip.get_model_config(known)["text_cfg"])
        except (json.JSONDecodeError, KeyError, TypeError) as error:
            raise MetricError(f"{self.path.parent / CONFIG}: expected a model_cfg of open_clip's: {error!r}") from error
        fetched = sorted(key for key in ("hf_model_name", "hf_tokenizer_name") if text.get(key))
        if fetched:
            raise MetricError(
                f"model {known}: expected open_clip's own text tower, got one from the hub ({fetched[0]})"
            )

    def images(self, pictures: Iterable[NDArray[np.uint8]], *, resize: Resize, batch: int = 16) -> NDArray[np.float32]:
        """Embeddings of RGB pictures (H, W, 3), (N, E), as the model makes them: not of unit length."""
        return self._seen(pictures, resize, batch, self._net.encode_image)

    def patches(self, pictures: Iterable[NDArray[np.uint8]], *, batch: int = 16) -> NDArray[np.float32]:
        """Features of the patches of RGB pictures, squashed to squares, (N, P, width), row by row.

        Raises
        ------
        MetricError
            The model sees no patches: it is no vision transformer.
        """
        visual = self._net.visual
        if not hasattr(visual, "output_tokens"):
            raise MetricError(f"model {self.model}: expected a vision transformer, which has patches, got none")
        visual.output_tokens = True
        try:
            return self._seen(pictures, "squash", batch, lambda x: visual(x)[1])
        finally:
            visual.output_tokens = False

    def text(self, text: str) -> NDArray[np.float32]:
        """Embedding of a text, (E,), not of unit length; of one that is too long, of its beginning."""
        with self._torch.no_grad():
            found = self._net.encode_text(self._tokenizer([text]).to(self.device))
        return np.asarray(found[0].cpu().numpy(), dtype=np.float32)

    def tokens(self, text: str) -> int:
        """How many tokens a text has, with its start and end; the model reads `context` of them."""
        return len(self._tokenizer.encode(text)) + 2

    def _seen(
        self, pictures: Iterable[NDArray[np.uint8]], resize: Resize, batch: int, look: Any
    ) -> NDArray[np.float32]:
        prepare = self._preparation(resize)
        groups = []
        for group in weights.batches(pictures, batch):
            x = self._torch.stack([prepare(picture) for picture in group]).to(self.device)
            with self._torch.no_grad():
                groups.append(look(x).float().cpu().numpy())
        return np.concatenate(groups) if groups else np.empty((0, 1), np.float32)

    def _preparation(self, resize: Resize) -> Any:
        """open_clip's own preparation of a picture, with the given resizing in place of the model's."""
        from open_clip.model import get_model_preprocess_cfg
        from open_clip.transform import PreprocessCfg, image_transform_v2
        from PIL import Image

        settings = {**get_model_preprocess_cfg(self._net), "resize_mode": resize}
        transform = image_transform_v2(PreprocessCfg(**settings), is_train=False)
        return lambda picture: transform(Image.fromarray(picture))


def _is_archive(path: Path) -> bool:
    """Whether a file is TorchScript, as OpenAI's are; what torch.save writes is a zip file too, but without code."""
    if not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        return any(name.endswith("/constants.pkl") for name in archive.namelist())


@contextmanager
def _without_warnings() -> Iterator[None]:
    """open_clip's warnings go to the root logger."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)


def _first(error: BaseException) -> str:
    """The first lines of an error that may list every tensor of a network."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()] or [repr(error)]
    return " ".join(lines[:2])[:300]
