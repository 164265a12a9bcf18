"""Models of metrics: tiny random ones, saved and loaded as real ones are; nothing is fetched."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eval import hashes
from eval.errors import MetricError
from eval.fvd import fvd
from eval.models.clip import Clip
from eval.models.i3d import I3D
from eval.models.weights import module

Picture = NDArray[np.uint8]


@pytest.fixture(autouse=True)
def no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever opens a connection fails."""

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a model was loaded over the network")

    monkeypatch.setattr(socket.socket, "connect", refuse)


@pytest.fixture(scope="module")
def clip_file(open_clip: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights of a tiny CLIP, its configuration beside them."""
    from tests.tiny_models import save_clip

    return save_clip(tmp_path_factory.mktemp("clip"))


@pytest.fixture(scope="module")
def clip(clip_file: Path) -> Clip:
    """A tiny CLIP."""
    return Clip(clip_file)


@pytest.fixture(scope="module")
def i3d_file(open_clip: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tiny module that is called as I3D is."""
    from tests.tiny_models import save_i3d

    return save_i3d(tmp_path_factory.mktemp("i3d") / "i3d_torchscript.pt")


def pictures(n: int, height: int = 40, width: int = 60, seed: int = 0) -> list[Picture]:
    """Random pictures."""
    return list(np.random.default_rng(seed).integers(0, 256, (n, height, width, 3), dtype=np.uint8))


def moving_videos(n: int, *, seed: int, frames: int = 12) -> list[Picture]:
    """Videos of a bright square that crosses a dim picture at a steady pace."""
    rng = np.random.default_rng(seed)
    videos = []
    for _ in range(n):
        video = np.full((frames, 32, 32, 3), rng.integers(20, 60), np.uint8)
        top, pace = rng.integers(0, 20), rng.uniform(1.0, 1.8)
        for t, frame in enumerate(video):
            left = int(pace * t)
            frame[top : top + 10, left : left + 10] = 220
        videos.append(video)
    return videos


def test_embeddings_are_those_of_the_saved_network(clip: Clip, torch: Any) -> None:
    from tests.tiny_models import clip as make

    picture = np.random.default_rng(0).integers(0, 256, (32, 32, 3), dtype=np.uint8)  # no resizing, no crop
    mean, std = np.array([0.48145466, 0.4578275, 0.40821073]), np.array([0.26862954, 0.26130258, 0.27577711])
    x = torch.tensor(((picture / 255 - mean) / std).transpose(2, 0, 1)[None], dtype=torch.float32)
    with torch.no_grad():
        expected = make(seed=0).encode_image(x).numpy()
    np.testing.assert_allclose(clip.images([picture], resize="shortest"), expected, rtol=1e-4, atol=1e-5)


def test_embeddings_do_not_depend_on_the_batch_nor_on_the_run(clip: Clip) -> None:
    frames = pictures(5)
    once = clip.images(frames, resize="shortest")
    assert np.array_equal(once, clip.images(frames, resize="shortest"))
    np.testing.assert_allclose(clip.images(frames, resize="shortest", batch=2), once, rtol=1e-5, atol=1e-6)


def test_shortest_sees_the_middle_and_squash_sees_all(clip: Clip) -> None:
    frame = pictures(1, 40, 80)[0]
    other = frame.copy()
    other[:, :15] = 0  # outside the middle 40 columns, and outside what a bicubic filter reaches
    for resize, same in (("shortest", True), ("squash", False), ("longest", False)):
        a, b = clip.images([frame, other], resize=resize)  # type: ignore[arg-type]
        assert np.array_equal(a, b) == same, resize


def test_there_is_a_feature_for_each_patch(clip: Clip) -> None:
    found = clip.patches(pictures(2, 32, 32))
    assert found.shape == (2, 16, 64)
    assert clip.images(pictures(1), resize="squash").shape == (1, 16)  # and the whole's embedding is as before
    assert clip.patches([]).shape[0] == 0


def test_a_text_over_the_limit_is_cut_to_its_beginning(clip: Clip) -> None:
    text = "fog " * 75
    assert clip.context == 77
    assert clip.tokens("") == 2
    assert clip.tokens(text) == 77
    assert clip.tokens(text + "rain") == 78
    assert not np.array_equal(clip.text("fog"), clip.text(text))
    assert np.array_equal(clip.text(text), clip.text(text + "rain and snow"))


def test_the_activation_is_the_configurations_and_changes_the_answer(open_clip: Any, tmp_path: Path) -> None:
    from tests.tiny_models import save_clip

    plain, quick = (Clip(save_clip(tmp_path / str(q), quick_gelu=q)) for q in (False, True))
    assert (plain.activation, quick.activation) == ("GELU", "QuickGELU")
    frames = pictures(1)
    assert not np.allclose(plain.images(frames, resize="squash"), quick.images(frames, resize="squash"), rtol=1e-3)


def test_an_archive_of_openais_is_quickgelu(open_clip: Any, tmp_path: Path) -> None:
    from tests.tiny_models import clip as make
    from tests.tiny_models import save_archive

    source = make(seed=1, quick_gelu=True)
    clip = Clip(save_archive(tmp_path / "tiny.pt", seed=1))
    assert clip.activation == "QuickGELU"
    found, expected = clip.text("fog"), source.encode_text(open_clip.tokenize(["fog"]))[0].detach().numpy()
    np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())  # such archives hold 16 bits
    with pytest.raises(MetricError, match="says its model itself"):
        Clip(tmp_path / "tiny.pt", model="ViT-B-32")


def test_weights_without_their_model_are_refused(clip_file: Path, tmp_path: Path) -> None:
    alone = tmp_path / "weights.bin"
    alone.write_bytes(clip_file.read_bytes())
    with pytest.raises(MetricError, match=r"open_clip_config\.json in the same folder, or --clip-model"):
        Clip(alone)
    with pytest.raises(MetricError, match="expected a name of open_clip"):
        Clip(alone, model="hf-hub:laion/CLIP-ViT-L-14-laion2B-s32B-b82K")
    with pytest.raises(MetricError, match="do not fit ViT-B-32"):
        Clip(alone, model="ViT-B-32")
    with pytest.raises(MetricError, match="from the hub"):
        Clip(alone, model="roberta-ViT-B-32")


def test_broken_weights_are_refused(open_clip: Any, clip_file: Path, tmp_path: Path) -> None:
    for name in ("open_clip_config.json", "weights.bin"):
        (tmp_path / name).write_text("{}", encoding="utf-8")
    with pytest.raises(MetricError, match="expected a model_cfg"):
        Clip(tmp_path / "weights.bin")
    (tmp_path / "open_clip_config.json").write_bytes((clip_file.parent / "open_clip_config.json").read_bytes())
    with pytest.raises(MetricError, match=r"weights\.bin: they do not fit"):
        Clip(tmp_path / "weights.bin")
    for name in ("cut.bin", "cut.safetensors"):
        (tmp_path / name).write_bytes(clip_file.read_bytes()[:-1000])
        with pytest.raises(MetricError, match=f"{name}: they do not fit"):
            Clip(tmp_path / name)


def test_missing_weights_say_whence_they_come(open_clip: Any, tmp_path: Path) -> None:
    for model in (Clip, I3D):
        with pytest.raises(MetricError, match=r"none\.pt: expected a file.*(MIT|Apache-2\.0)"):
            model(tmp_path / "none.pt")


def test_i3d_returns_what_the_module_does(i3d_file: Path, torch: Any) -> None:
    clips = moving_videos(3, seed=0)
    found = I3D(i3d_file).features(clips, batch=2)
    x = torch.tensor(np.stack(clips), dtype=torch.float32).permute(0, 4, 1, 2, 3)
    with torch.no_grad():
        expected = torch.jit.load(str(i3d_file))(x, rescale=True, resize=True, return_features=True).numpy()
    assert found.shape == (3, 400)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5)
    assert I3D(i3d_file).features([]).shape == (0, 400)


def test_i3d_takes_clips_of_different_lengths_one_by_one(i3d_file: Path) -> None:
    clips = [*moving_videos(1, seed=0, frames=10), *moving_videos(1, seed=1, frames=16)]
    assert I3D(i3d_file).features(clips).shape == (2, 400)


def test_shuffled_frames_make_fvd_worse(i3d_file: Path) -> None:
    net, rng = I3D(i3d_file), np.random.default_rng(0)
    ref, others = moving_videos(40, seed=1), moving_videos(40, seed=2)
    shuffled = [video[rng.permutation(len(video))] for video in others]
    a, b, c = (net.features(videos, batch=8) for videos in (ref, others, shuffled))
    steady, jumping = fvd(a, b).value, fvd(a, c).value
    assert fvd(a, a).value == 0
    assert isinstance(steady, float)
    assert isinstance(jumping, float)
    assert jumping > 2 * steady


def test_other_modules_than_i3d_are_refused(open_clip: Any, torch: Any, tmp_path: Path) -> None:
    from tests.tiny_models import save_i3d

    clips = moving_videos(1, seed=0)
    with pytest.raises(MetricError, match=r"expected features \(1, 400\), got \(1, 8\)"):
        I3D(save_i3d(tmp_path / "small.pt", features=8)).features(clips)
    torch.jit.script(torch.nn.ReLU()).save(str(tmp_path / "relu.pt"))
    with pytest.raises(MetricError, match=r"relu\.pt: called on clips \(1, 3, 12, 32, 32\) it fails"):
        I3D(tmp_path / "relu.pt").features(clips)
    (tmp_path / "text.pt").write_text("no module", encoding="utf-8")
    with pytest.raises(MetricError, match=r"text\.pt: expected TorchScript"):
        I3D(tmp_path / "text.pt")


def test_weights_are_named_by_their_content(clip_file: Path, clip: Clip) -> None:
    assert clip.sha256 == hashes.of_file(clip_file)


def test_a_models_identity_is_all_that_decides_its_numbers_and_nothing_else(clip_file: Path, tmp_path: Path) -> None:
    from tests.tiny_models import save_clip

    same, weights, config = (tmp_path / name for name in ("same", "weights", "config"))
    for folder in (same, config):
        folder.mkdir()
        for file in clip_file.parent.iterdir():
            (folder / file.name).write_bytes(file.read_bytes())
    preprocessing = json.loads((config / "open_clip_config.json").read_text(encoding="utf-8"))
    preprocessing["preprocess_cfg"]["mean"] = [0.5, 0.5, 0.5]
    (config / "open_clip_config.json").write_text(json.dumps(preprocessing), encoding="utf-8")
    renamed = (same / clip_file.name).rename(same / "other.bin")
    save_clip(weights, seed=1)
    identity = Clip(clip_file).identity
    assert Clip(renamed).identity == identity
    for changed in (weights, config):
        assert Clip(changed / clip_file.name).identity != identity


def test_a_model_is_described_without_the_folder_that_it_is_in(clip: Clip, clip_file: Path, i3d_file: Path) -> None:
    said = clip.description
    assert (said["file"], said["sha256"], said["activation"]) == (clip_file.name, clip.sha256, "GELU")
    assert said["model"].startswith("open_clip_config.json ")
    assert not any(str(clip_file.parent) in text for text in said.values())
    i3d = I3D(i3d_file)
    assert i3d.description == {"file": i3d_file.name, "sha256": i3d.identity}


def test_the_activation_is_part_of_the_identity(open_clip: Any, tmp_path: Path) -> None:
    from tests.tiny_models import save_clip

    models = [Clip(save_clip(tmp_path / str(quick), quick_gelu=quick)) for quick in (False, True)]
    plain, quick = models
    assert plain.sha256 == quick.sha256
    assert plain.identity != quick.identity
    assert [model.description["activation"] for model in models] == ["GELU", "QuickGELU"]


def test_real_i3d_on_black_against_white() -> None:
    """The published figure of videos (8, 30, 3, 64, 64) of zeros against ones."""
    path = os.environ.get("AW4D_I3D_WEIGHTS")
    if not path:
        pytest.skip("no weights of I3D: set AW4D_I3D_WEIGHTS to i3d_torchscript.pt")
    net = I3D(Path(path))
    black, white = (net.features([np.full((30, 64, 64, 3), code, np.uint8)] * 8, batch=8) for code in (0, 255))
    assert fvd(black, white).value == pytest.approx(151.256, rel=1e-3)


def test_without_a_package_the_error_says_what_to_install() -> None:
    with pytest.raises(MetricError, match=r"no_such_package is not installed: pip install 'autoweather4d\[metrics\]'"):
        module("no_such_package")


def test_importing_eval_imports_no_torch() -> None:
    script = (
        "import importlib, pkgutil, sys, eval\n"
        "for found in pkgutil.walk_packages(eval.__path__, 'eval.'): importlib.import_module(found.name)\n"
        "print(*{name.split('.')[0] for name in sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not {"torch", "torchvision", "open_clip", "timm"} & set(done.stdout.split())
