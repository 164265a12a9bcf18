"""Videos, depths and their pairs: the same frames from every form, and whatever does not fit is told by name."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from aw4d.clip import ClipInfo, ClipWriter
from aw4d.colour import decode_srgb8
from aw4d.errors import InputError
from aw4d.evaluation.depths import open_depth
from aw4d.evaluation.pairs import Selection, depth_pairs, video_pairs
from aw4d.evaluation.stream import WORKERS, records, scores
from aw4d.evaluation.videos import Video, open_video
from aw4d.gbuffer import GBuffer
from aw4d.io.images import write_exr, write_png
from aw4d.io.video import VideoWriter, read_video
from aw4d.output import sidecar_path
from eval.edge_f1 import EdgeF1
from eval.errors import MetricError
from eval.psnr import Psnr
from eval.score import score
from eval.si_rmse import SiRmse
from eval.ssim import Ssim
from eval.values import Undefined, undefined
from tests.made_up import camera, picture, planes

WIDTH, HEIGHT, FRAMES = 48, 32, 6
ANY = Selection()


def shot(index: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    return picture(width, height, index)


def make_video(path: Path, frames: int = FRAMES, *, fps: float = 10, width: int = WIDTH, height: int = HEIGHT) -> Path:
    path.parent.mkdir(exist_ok=True)
    with VideoWriter(path, fps=fps) as writer:
        for index in range(frames):
            writer.write(shot(index, width, height))
    return path


def make_pictures(folder: Path, frames: int = FRAMES) -> Path:
    folder.mkdir(parents=True)
    for index in range(frames):
        write_png(folder / f"{index}.png", shot(index))
    return folder


def make_clip(path: Path, frames: int = FRAMES) -> Path:
    view = camera(WIDTH, HEIGHT)
    with ClipWriter(path, (frames, HEIGHT, WIDTH), fingerprint="made up") as writer:
        for i in range(frames):
            held = {"rgb": decode_srgb8(shot(i)), **planes(WIDTH, HEIGHT, i)}
            writer.write(i, GBuffer(held, camera=view, time=i / 10))
        info = ClipInfo(
            name="made up",
            width=WIDTH,
            height=HEIGHT,
            K=np.broadcast_to(view.K, (frames, 3, 3)).copy(),
            camera_to_world=np.broadcast_to(view.camera_to_world, (frames, 4, 4)).copy(),
            times=np.arange(frames) / 10,
        )
        writer.finish(info)
    return path


def range_map(index: int) -> np.ndarray:
    """Depth [m] that every format holds exactly: whole multiples of 1/256."""
    return (np.arange(1, WIDTH * HEIGHT + 1).reshape(HEIGHT, WIDTH) / 256 + index).astype(np.float32)


def make_depths(path: Path, kind: str, frames: int = FRAMES) -> Path:
    if kind == "npz":
        np.savez_compressed(path.with_suffix(".npz"), depths=np.stack([range_map(i) for i in range(frames)]))
        return path.with_suffix(".npz")
    path.mkdir()
    for i in range(frames):
        file = path / f"{i}.{kind}"
        if kind == "npy":
            np.save(file, range_map(i))
        elif kind == "exr":
            write_exr(file, {"Y": range_map(i)})
        else:
            write_png(file, (range_map(i) * 256).astype(np.uint16))
    return path


def everything(video: Video) -> np.ndarray:
    return np.stack(list(video.frames(range(video.count))))


# Forms of a video


def test_a_file_gives_the_frames_that_its_decoder_gives(tmp_path: Path) -> None:
    video = open_video(make_video(tmp_path / "a.mp4"))
    np.testing.assert_array_equal(everything(video), np.stack(list(read_video(video.path))))
    assert (video.name, video.count, video.height, video.width) == ("a", FRAMES, HEIGHT, WIDTH)
    assert video.fps == pytest.approx(10)


def test_a_folder_and_a_clip_give_the_codes_themselves(tmp_path: Path) -> None:
    for video in (open_video(make_pictures(tmp_path / "a")), open_video(make_clip(tmp_path / "b.clip"))):
        np.testing.assert_array_equal(everything(video), np.stack([shot(i) for i in range(FRAMES)]))
        assert (video.count, video.height, video.width) == (FRAMES, HEIGHT, WIDTH)


def test_names_are_numbers_where_they_have_numbers(tmp_path: Path) -> None:
    video = open_video(make_pictures(tmp_path / "a", frames=12))  # 0, 1, 10, 11, 2, … by letters
    np.testing.assert_array_equal(everything(video)[10], shot(10))


@pytest.mark.parametrize("make", [lambda p: make_video(p / "a.mp4"), lambda p: make_pictures(p / "a")])
def test_only_the_frames_that_are_wanted(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    video = open_video(make(tmp_path))
    np.testing.assert_array_equal(np.stack(list(video.frames(range(1, 6, 2)))), everything(video)[1:6:2])


def test_an_edit_with_odd_sides_has_the_size_of_what_was_edited(tmp_path: Path) -> None:
    path = make_video(tmp_path / "a.mp4", width=47, height=31)
    assert (open_video(path).height, open_video(path).width) == (32, 48)
    sidecar_path(path).write_text(json.dumps({"size": [47, 31]}))
    assert everything(open_video(path)).shape == (FRAMES, 31, 47, 3)
    sidecar_path(path).write_text(json.dumps({"size": [40, 30]}))  # of another video
    assert everything(open_video(path)).shape == (FRAMES, 32, 48, 3)
    sidecar_path(path).write_text("no JSON")
    assert everything(open_video(path)).shape == (FRAMES, 32, 48, 3)


def test_a_cut_file_is_told(tmp_path: Path) -> None:
    path = make_video(tmp_path / "a.mp4", frames=40)
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(InputError, match=r"a\.mp4.*(truncated|damaged)"):
        open_video(path)


def test_no_video_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"nothing of the kind" * 100)
    with pytest.raises(InputError, match=r"a\.mp4"):
        open_video(tmp_path / "a.mp4")


def test_a_cut_picture_is_told(tmp_path: Path) -> None:
    video = open_video(make_pictures(tmp_path / "a"))
    file = tmp_path / "a" / "3.png"
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"3\.png.*truncated"):
        everything(video)


def test_a_picture_of_another_size_is_told(tmp_path: Path) -> None:
    video = open_video(make_pictures(tmp_path / "a"))
    write_png(tmp_path / "a" / "3.png", shot(0, 50, 40))
    with pytest.raises(InputError, match=r"frame 3.*48x32.*50x40"):
        everything(video)


@pytest.mark.parametrize("other", ["7.jpg", "7.mp4"])
def test_a_folder_of_several_kinds_is_refused(tmp_path: Path, other: str) -> None:
    folder = make_pictures(tmp_path / "a")
    (folder / other).write_bytes(b"x")
    with pytest.raises(InputError, match="one kind"):
        open_video(folder)


# Forms of depth


@pytest.mark.parametrize("kind", ["npy", "png", "exr", "npz"])
def test_every_format_gives_the_same_depth(tmp_path: Path, kind: str) -> None:
    video = open_depth(make_depths(tmp_path / "a", kind))
    np.testing.assert_array_equal(everything(video), np.stack([range_map(i) for i in range(FRAMES)]))
    np.testing.assert_array_equal(next(video.frames(range(4, 5))), range_map(4))
    assert (video.name, video.count, video.height, video.width) == ("a", FRAMES, HEIGHT, WIDTH)


def test_the_sky_of_a_clip_has_no_depth(tmp_path: Path) -> None:
    found = everything(open_depth(make_clip(tmp_path / "a.clip")))
    held = planes(WIDTH, HEIGHT, 2)
    assert (found[2][held["sky"]] == 0).all()
    np.testing.assert_array_equal(found[2][~held["sky"]], held["depth"][~held["sky"]])


def test_half_floats_that_are_compressed_or_not(tmp_path: Path) -> None:
    whole = np.stack([range_map(i) for i in range(FRAMES)]).astype(np.float16)
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", depths=whole)
        np.testing.assert_array_equal(everything(open_depth(tmp_path / "a.npz")), whole.astype(np.float32))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"data": np.ones((2, 3, 4), np.float32)}, "named depths"),
        ({"depths": np.ones((3, 4), np.float32)}, r"\(T, H, W\).*\(3, 4\)"),
        ({"depths": np.ones((2, 3, 4), np.uint8)}, "uint8"),
        ({"depths": np.asfortranarray(np.ones((2, 3, 4)))}, "in rows"),
        ({"depths": np.array(["a"], dtype=object)}, "object"),
    ],
)
def test_an_npz_of_another_kind_is_told(tmp_path: Path, arrays: dict[str, np.ndarray], message: str) -> None:
    np.savez(tmp_path / "a.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=message):
        open_depth(tmp_path / "a.npz")


def test_a_damaged_npz_is_told(tmp_path: Path) -> None:
    path = make_depths(tmp_path / "a", "npz")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"whole \.npz"):
        everything(open_depth(path))
    path.write_bytes(bytes(data[: len(data) // 2]))
    with pytest.raises(InputError, match=r"whole \.npz"):
        open_depth(path)


def test_depth_of_eight_bits_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    write_png(tmp_path / "a" / "0.png", np.full((4, 5), 9, np.uint8))
    with pytest.raises(InputError, match="16 bits, got 8"):
        open_depth(tmp_path / "a")


def test_nan_depth_is_left_out_and_counted(tmp_path: Path) -> None:
    ref, gen = make_depths(tmp_path / "a", "npy"), make_depths(tmp_path / "b", "npy")
    hole = range_map(0)
    hole[: HEIGHT // 4] = np.nan
    np.save(gen / "0.npy", hole)
    np.save(gen / "3.npy", np.full_like(hole, np.nan))
    found = scores(depth_pairs(ref, gen, ANY)[0], {"si-rmse": SiRmse()})["si-rmse"]
    assert found.value == pytest.approx(0, abs=1e-12)
    assert undefined(found.frames) == {"no pixel has a depth on both sides": 1}
    assert found.others["share of pixels left out"] == pytest.approx((1 / 4 + 1) / FRAMES)


# Pairs


def test_one_against_one(tmp_path: Path) -> None:
    (pair,) = video_pairs(make_clip(tmp_path / "source.clip"), make_video(tmp_path / "fog.mp4"), ANY)
    assert (pair.name, len(pair), pair.size) == ("fog", FRAMES, (HEIGHT, WIDTH))
    for index, (ref, gen) in enumerate(pair):
        np.testing.assert_array_equal(ref, shot(index))
        assert gen.shape == ref.shape


def test_folders_of_videos_are_paired_by_stem(tmp_path: Path) -> None:
    for name in ("a", "b"):
        make_video(tmp_path / "gen" / f"{name}.mp4")
    make_pictures(tmp_path / "ref" / "a")
    make_clip(tmp_path / "ref" / "b.clip")
    (tmp_path / "gen" / "notes.txt").write_text("no video")
    assert [pair.name for pair in video_pairs(tmp_path / "ref", tmp_path / "gen", ANY)] == ["a", "b"]


def test_whoever_has_no_partner_is_named(tmp_path: Path) -> None:
    for side, names in (("ref", "ab"), ("gen", "bcd")):
        for name in names:
            make_video(tmp_path / side / f"{name}.mp4", frames=1)
    with pytest.raises(InputError, match=r"gen/c\.mp4, .*gen/d\.mp4, .*ref/a\.mp4$"):
        video_pairs(tmp_path / "ref", tmp_path / "gen", ANY)


def test_two_of_one_stem_are_named(tmp_path: Path) -> None:
    for name in ("a.mp4", "a.mkv"):
        make_video(tmp_path / "ref" / name, frames=1)
    with pytest.raises(InputError, match=r"a\.mkv, a\.mp4"):
        video_pairs(tmp_path / "ref", tmp_path / "ref", ANY)


def test_a_csv_pairs_one_with_many(tmp_path: Path) -> None:
    make_video(tmp_path / "ref" / "source.mp4")
    for name in ("fog", "rain"):
        make_video(tmp_path / "gen" / f"{name}.mp4")
    rows = tmp_path / "pairs.csv"
    rows.write_text("weather,ref,gen\nfog,source.mp4,fog.mp4\nrain,source.mp4,rain.mp4\n")
    found = video_pairs(tmp_path / "ref", tmp_path / "gen", ANY, rows)
    assert [(pair.ref.name, pair.name) for pair in found] == [("source", "fog"), ("source", "rain")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\nx,y\n", "columns ref and gen, got a, b"),
        ("ref,gen\n", "a row below"),
        ("ref,gen\na.mp4,\n", "line 2.*a.mp4, nothing"),
        ("ref,gen\na.mp4,a.mp4\na.mp4,lost.mp4\n", r"line 3.*lost\.mp4.*nothing"),
        ("ref,gen\na.mp4,a.mp4\na.mp4,a.mp4\n", "line 3.*every gen once"),
        ("ref,gen\na.mp4,list.csv\n", "another kind of file"),
    ],
)
def test_a_csv_that_cannot_be_followed_is_told(tmp_path: Path, text: str, message: str) -> None:
    make_video(tmp_path / "a.mp4", frames=1)
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        video_pairs(tmp_path, tmp_path, ANY, tmp_path / "list.csv")


def test_what_is_no_video_is_told(tmp_path: Path) -> None:
    one = make_video(tmp_path / "a.mp4", frames=1)
    (tmp_path / "b.txt").write_text("b")
    (tmp_path / "empty").mkdir()
    for other, message in (("lost.mp4", "nothing"), ("b.txt", "another kind"), ("empty", "another kind of folder")):
        with pytest.raises(InputError, match=rf"{other}.*{message}"):
            video_pairs(one, tmp_path / other, ANY)


def test_lengths_must_be_equal_unless_frames_says_which(tmp_path: Path) -> None:
    ref, gen = make_video(tmp_path / "a.mp4", frames=6), make_video(tmp_path / "b.mp4", frames=4)
    with pytest.raises(InputError, match=r"6 of .*a\.mp4 and 4 of .*b\.mp4: --frames 0:4"):
        video_pairs(ref, gen, ANY)
    with pytest.raises(InputError, match=r"5 of .* and 4 of"):
        video_pairs(ref, gen, Selection(frames="0:5"))
    (pair,) = video_pairs(ref, gen, Selection(frames="1:4"))
    assert len(list(pair)) == len(pair) == 3
    np.testing.assert_array_equal(next(iter(pair))[0], everything(open_video(ref))[1])


def test_rates_must_be_equal_unless_stride_says_which(tmp_path: Path) -> None:
    ref, gen = make_video(tmp_path / "a.mp4", 12, fps=30), make_video(tmp_path / "b.mp4", 4, fps=10)
    with pytest.raises(InputError, match=r"30 a second in .* and 10 in .*--stride"):
        video_pairs(ref, gen, ANY)
    (pair,) = video_pairs(ref, gen, Selection(stride="3:1"))
    assert (list(pair.ref_frames), list(pair.gen_frames)) == ([0, 3, 6, 9], [0, 1, 2, 3])
    (pair,) = video_pairs(ref, gen, Selection(stride="1", frames="0:4"))
    assert list(pair.ref_frames) == list(pair.gen_frames) == [0, 1, 2, 3]
    (pair,) = video_pairs(ref, ref, Selection(stride="5", frames="1:"))
    assert list(pair.gen_frames) == [5, 10]
    assert len(list(pair)) == 2


def test_sizes_must_be_equal_unless_resize_says_which(tmp_path: Path) -> None:
    ref, gen = make_video(tmp_path / "a.mp4"), make_video(tmp_path / "b.mp4", width=96, height=64)
    with pytest.raises(InputError, match=r"48x32 in .*a\.mp4 and 96x64 in .*b\.mp4: --resize 48x32"):
        video_pairs(ref, gen, ANY)
    (pair,) = video_pairs(ref, gen, Selection(resize="48x32"))
    one, other = next(iter(pair))
    assert one.shape == other.shape == (32, 48, 3)
    # Half the size by areas is the mean of four pixels.
    whole = everything(open_video(gen))[0].reshape(32, 2, 48, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(other, whole, atol=0.75)


def test_depth_is_resized_without_mixing(tmp_path: Path) -> None:
    ref = make_depths(tmp_path / "a", "npz")
    (pair,) = depth_pairs(ref, ref, Selection(resize="20x30"))
    one, _ = next(iter(pair))
    assert one.shape == (30, 20)
    assert np.isin(one, range_map(0)).all()


@pytest.mark.parametrize(
    ("selection", "message"),
    [
        (Selection(frames="x"), "--frames"),
        (Selection(frames="9:12"), "names no frame"),
        (Selection(stride="0"), "--stride"),
        (Selection(stride="1:2:3"), "--stride"),
        (Selection(resize="640"), "--resize"),
        (Selection(resize="0x480"), "--resize"),
    ],
)
def test_an_option_that_cannot_be_followed_is_told(tmp_path: Path, selection: Selection, message: str) -> None:
    path = make_video(tmp_path / "a.mp4")
    with pytest.raises(InputError, match=message):
        video_pairs(path, path, selection)


# Streaming


def test_streaming_gives_what_one_metric_after_the_other_gives(tmp_path: Path) -> None:
    (pair,) = video_pairs(make_pictures(tmp_path / "a"), make_video(tmp_path / "b.mp4"), ANY)
    metrics = {"psnr": Psnr(), "ssim": Ssim(), "edge-f1": EdgeF1()}
    found = scores(pair, metrics)
    frames = list(pair)
    for name, metric in metrics.items():
        assert found[name] == score(metric, *zip(*frames, strict=True))
        assert len(found[name].frames) == FRAMES


def test_frames_are_drawn_no_faster_than_they_are_used() -> None:
    waiting: list[int] = []
    used: list[float] = []

    class Mark:
        def frame(self, ref: np.ndarray, gen: np.ndarray) -> float:
            used.append(float(ref[0, 0]))
            return used[-1]

    def frames() -> Iterator[tuple[np.ndarray, np.ndarray]]:
        for index in range(50):
            waiting.append(index - len(used))
            yield np.full((4, 4), index), np.zeros((4, 4))

    assert [record["mark"] for record in records(frames(), {"mark": Mark()})] == list(range(50))
    assert max(waiting) <= 2 * WORKERS


def test_an_error_in_a_frame_ends_the_run(tmp_path: Path) -> None:
    (pair,) = video_pairs(make_video(tmp_path / "a.mp4", width=10), make_video(tmp_path / "b.mp4", width=10), ANY)
    with pytest.raises(MetricError, match="ssim"):
        scores(pair, {"ssim": Ssim()})


def test_equal_videos_have_ideal_values(tmp_path: Path) -> None:
    path = make_pictures(tmp_path / "a")
    found = scores(video_pairs(path, path, ANY)[0], {"psnr": Psnr(), "ssim": Ssim(), "edge-f1": EdgeF1()})
    assert {name: one.value for name, one in found.items()} == {"psnr": float("inf"), "ssim": 1.0, "edge-f1": 1.0}
    assert not any(isinstance(value, Undefined) for one in found.values() for value in one.frames)


MEASURE = """
import resource, sys
from pathlib import Path
from aw4d.evaluation.pairs import Selection, depth_pairs, video_pairs
from aw4d.evaluation.stream import scores
from eval.edge_f1 import EdgeF1
from eval.psnr import Psnr
from eval.si_rmse import SiRmse
from eval.ssim import Ssim
video, depth = map(Path, sys.argv[1:])
scores(video_pairs(video, video, Selection())[0], {"psnr": Psnr(), "ssim": Ssim(), "edge-f1": EdgeF1()})
scores(depth_pairs(depth, depth, Selection())[0], {"si-rmse": SiRmse()})
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def test_ten_times_the_frames_take_the_same_memory(tmp_path: Path) -> None:
    peaks = []
    for frames in (60, 600):
        video = make_video(tmp_path / f"{frames}.mp4", frames, width=160, height=96)
        depth = make_depths(tmp_path / str(frames), "npz", frames)
        command = [sys.executable, "-c", MEASURE, str(video), str(depth)]
        peaks.append(int(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
    assert peaks[1] < 1.05 * peaks[0]
