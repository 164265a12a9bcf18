"""Features in files, and the cache of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eval import cache, features, hashes
from eval.clip_score import clip_score
from eval.errors import MetricError
from eval.frechet import statistics
from eval.fvd import fvd
from eval.identity import Identity

RNG = np.random.default_rng(0)
REF, GEN = RNG.normal(size=(20, 6)), RNG.normal(size=(15, 6))
IMAGES, TEXT = RNG.normal(size=(4, 5)), RNG.normal(size=5)


def test_fvd_of_features(tmp_path: Path) -> None:
    path = tmp_path / "f.npz"
    features.write(path, {"ref": REF, "gen": GEN, "names": np.array(["a", "b"])})
    assert features.fvd_of(path) == fvd(REF, GEN)


def test_fvd_of_statistics_on_one_side_or_both(tmp_path: Path) -> None:
    path = tmp_path / "f.npz"
    ref, gen = (features.of_statistics(side, statistics(of)) for side, of in (("ref", REF), ("gen", GEN)))
    for arrays in ({**ref, "gen": GEN}, {**ref, **gen}):
        features.write(path, arrays)
        found = features.fvd_of(path)
        assert found.value == pytest.approx(fvd(REF, GEN).value, rel=1e-9)
        assert found.others["videos of ref"] == 20


def test_clip_score_of_features(tmp_path: Path) -> None:
    path = tmp_path / "f.npz"
    features.write(path, {"images": IMAGES, "text": TEXT, "tokens": 130, "context": 77})
    assert features.clip_score_of(path) == clip_score(IMAGES, TEXT, tokens=130)


def test_identity_of_features(tmp_path: Path) -> None:
    path = tmp_path / "f.npz"
    features.write(path, {"ref": [[1.0, 0], [1, 0], [0, 1]], "gen": [[1.0, 0], [0, 1], [0, 1]], "frame": [0, 0, 2]})
    assert features.identity_of(path, Identity()).value == pytest.approx(2 / 3)
    assert features.identity_of(path, Identity(mean_per="frame")).value == 0.75


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"ref": REF}, "expected an array `gen`, got ref"),
        ({"gen": GEN}, "expected an array `ref`, got gen"),
        ({"ref": REF[0], "gen": GEN}, "`ref` as numbers in 2 dimensions, got 1 of float64"),
        ({"ref": REF.astype(str), "gen": GEN}, "`ref` as numbers"),
        ({"ref_mean": REF[0], "gen": GEN}, "expected an array `ref_covariance`"),
    ],
)
def test_files_that_lack_something_are_refused(tmp_path: Path, arrays: dict[str, Any], message: str) -> None:
    features.write(tmp_path / "f.npz", arrays)
    with pytest.raises(MetricError, match=message):
        features.fvd_of(tmp_path / "f.npz")


@pytest.mark.parametrize("tokens", [np.nan, np.inf, 2.5, -1, "77", 1j])
def test_counts_that_are_none_are_refused(tmp_path: Path, tokens: Any) -> None:
    path = tmp_path / "f.npz"
    features.write(path, {"images": IMAGES, "text": TEXT, "tokens": tokens, "context": 77})
    with pytest.raises(MetricError, match=r"f\.npz: expected `tokens` as"):
        features.clip_score_of(path)
    count = {"ref_mean": np.zeros(6), "ref_covariance": np.eye(6), "ref_count": tokens}
    features.write(path, {**count, "gen": GEN})
    with pytest.raises(MetricError, match=r"f\.npz: expected `ref_count` as"):
        features.fvd_of(path)


def test_a_frame_of_any_number_takes_the_room_of_one(tmp_path: Path) -> None:
    path = tmp_path / "f.npz"
    features.write(path, {"ref": np.eye(3), "gen": np.eye(3)[[0, 1, 0]], "frame": [2**62, 7, 2**62]})
    found = features.identity_of(path, Identity(mean_per="frame"))
    assert found.frames == (1.0, 0.5)


@pytest.mark.parametrize("frame", [[0], [0.0, 1.0], [0, -1]])
def test_numbers_of_frames_that_are_none_are_refused(tmp_path: Path, frame: list[float]) -> None:
    features.write(tmp_path / "f.npz", {"ref": np.eye(2), "gen": np.eye(2), "frame": frame})
    with pytest.raises(MetricError, match=r"expected `frame` as \(2,\)"):
        features.identity_of(tmp_path / "f.npz", Identity())


def test_files_that_are_no_npz_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "one.npy", REF)
    np.savez(tmp_path / "pickled.npz", ref=np.array([{}], dtype=object))
    (tmp_path / "text.npz").write_text("no archive", encoding="utf-8")
    for name in ("one.npy", "pickled.npz", "text.npz", "absent.npz"):
        with pytest.raises(MetricError, match=f"{name}: expected an .npz file"):
            features.read(tmp_path / name)


class Maker:
    """Makes arrays, and counts how often."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self) -> features.Arrays:
        self.calls += 1
        return {"features": REF}


def kept(folder: Path, maker: Maker, **of: Any) -> features.Arrays:
    """What a cache holds of these."""
    store = cache.Cache(folder=folder)
    settings = {"content": "c", "preprocessing": {"stride": 1}, "weights": "w", **of}
    return store.arrays(store.path(**settings), maker)


def test_the_same_is_computed_once(tmp_path: Path) -> None:
    maker = Maker()
    for _ in range(3):
        assert np.array_equal(kept(tmp_path / "deep" / "folder", maker)["features"], REF)
    assert maker.calls == 1


@pytest.mark.parametrize("other", [{"content": "d"}, {"preprocessing": {"stride": 2}}, {"weights": "v"}])
def test_another_content_preprocessing_or_weight_is_computed_anew(tmp_path: Path, other: dict[str, Any]) -> None:
    maker = Maker()
    kept(tmp_path, maker)
    kept(tmp_path, maker, **other)
    assert maker.calls == 2


@pytest.mark.parametrize("damage", ["cut", "flipped", "emptied"])
def test_a_damaged_file_is_made_anew(tmp_path: Path, damage: str) -> None:
    maker = Maker()
    kept(tmp_path, maker)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    middle = len(whole) // 2
    flipped = whole[:middle] + bytes([whole[middle] ^ 255]) + whole[middle + 1 :]
    path.write_bytes({"cut": whole[:middle], "flipped": flipped, "emptied": b""}[damage])
    assert np.array_equal(kept(tmp_path, maker)["features"], REF)
    assert maker.calls == 2
    assert path.read_bytes() == whole


def test_a_write_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(np, "savez", fail)
    maker = Maker()
    with pytest.warns(UserWarning, match="cannot be written, and the next run starts anew: no space left"):
        assert np.array_equal(kept(tmp_path, maker)["features"], REF)
    assert not list(tmp_path.iterdir())


def test_the_cache_lives_with_the_users_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.Cache().folder == tmp_path / "autoweather4d"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache.Cache().folder == Path.home() / ".cache" / "autoweather4d"


def test_hashes_are_of_the_content(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    assert (
        hashes.of_file(tmp_path / "a") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    )  # FIPS 180
    assert hashes.of_files([tmp_path / "a", tmp_path / "a"]) != hashes.of_file(tmp_path / "a")
    frame = np.zeros((2, 3, 3), np.uint8)
    assert hashes.of_frames([frame, frame]) != hashes.of_frames([frame])
    assert hashes.of_frames([frame[:, ::-1]]) == hashes.of_frames([frame.copy()])
    assert hashes.of_frames([frame]) != hashes.of_frames([frame.astype(np.int8)])
