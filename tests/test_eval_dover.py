"""DOVER: two fusions of two branches that are told apart by name."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eval.dover import PRESETS, Branches, paper_fusion, read_scores, released_fusion, rescaled
from eval.errors import MetricError
from eval.values import mean

SCORES = st.floats(-1, 1)
VIDEOS = [Branches(technical=0.1107, aesthetic=-0.08285), Branches(technical=0.18425, aesthetic=-0.04511)]


def test_paper_fusion_by_hand() -> None:
    assert paper_fusion(0.5, 0.25) == pytest.approx(0.572 * 0.5 + 0.428 * 0.25)


def test_released_fusion_by_hand() -> None:
    assert released_fusion(0.1107, -0.08285) == pytest.approx(0.5)
    # one spread above the mean in both branches
    assert released_fusion(0.1107 + 0.07355, -0.08285 + 0.03774) == pytest.approx(1 / (1 + math.exp(-1)))
    assert released_fusion(0.1107 + 0.07355, -0.08285) == pytest.approx(1 / (1 + math.exp(-0.6104)))


@settings(deadline=None)
@given(SCORES, SCORES)
def test_released_fusion_is_the_weighted_mean_of_the_branches_log_odds(technical: float, aesthetic: float) -> None:
    t, a = (float(branch) for branch in rescaled(technical, aesthetic))
    if min(t, a) > 1e-9 and max(t, a) < 1 - 1e-9:
        log_odds = 0.6104 * math.log(t / (1 - t)) + 0.3896 * math.log(a / (1 - a))
        assert released_fusion(technical, aesthetic) == pytest.approx(1 / (1 + math.exp(-log_odds)), rel=1e-6)


@settings(deadline=None)
@given(SCORES, SCORES)
def test_released_fusion_stays_in_range_for_any_branches(technical: float, aesthetic: float) -> None:
    assert 0 <= released_fusion(1000 * technical, 1000 * aesthetic) <= 1


@pytest.mark.parametrize("fusion", [paper_fusion, released_fusion])
def test_swapped_branches_give_another_number(fusion: Any) -> None:
    assert fusion(0.1, -0.05) != pytest.approx(fusion(-0.05, 0.1))


class TestScore:
    def test_mean_over_videos_under_each_convention(self) -> None:
        for name, fusion in (("paper", paper_fusion), ("released", released_fusion)):
            score = PRESETS[name].score(VIDEOS)
            expected = [float(fusion(*video)) for video in VIDEOS]
            assert score.frames == pytest.approx(expected)
            assert score.value == pytest.approx(sum(expected) / 2)
            assert score.value == score.others[f"{name} fusion"]

    def test_paper_fusion_of_rescaled_branches(self) -> None:
        assert PRESETS["paper"].score(VIDEOS[:1]).others["paper fusion of rescaled branches"] == pytest.approx(0.5)

    def test_branches_are_reported(self) -> None:
        others = PRESETS["paper"].score(VIDEOS).others
        assert others["technical"] == pytest.approx((0.1107 + 0.18425) / 2)
        assert others["aesthetic"] == pytest.approx((-0.08285 - 0.04511) / 2)

    @pytest.mark.parametrize("preset", PRESETS)
    def test_by_video_are_the_scores_that_are_averaged(self, preset: str) -> None:
        convention = PRESETS[preset]
        by_video = convention.by_video(dict(zip("ab", VIDEOS, strict=True)))
        together = convention.score(VIDEOS)
        assert list(by_video) == ["a", "b"]
        assert tuple(score.value for score in by_video.values()) == together.frames
        for name, value in together.others.items():
            assert value == mean([score.others[name] for score in by_video.values()])

    def test_no_video(self) -> None:
        with pytest.raises(MetricError, match="at least one video"):
            PRESETS["paper"].score([])


class TestFiles:
    def write(self, path: Path, content: Any) -> Path:
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
        return path

    def test_columns_by_name_in_any_order(self, tmp_path: Path) -> None:
        a = self.write(tmp_path / "a.csv", "video,technical,aesthetic\nx.mp4,0.1,-0.2\n")
        b = self.write(tmp_path / "b.csv", "aesthetic, other, technical ,video\n-0.2,9,0.1,x.mp4\n")
        assert read_scores(a) == read_scores(b) == {"x.mp4": Branches(technical=0.1, aesthetic=-0.2)}

    def test_videos_without_names_are_numbered(self, tmp_path: Path) -> None:
        path = self.write(tmp_path / "a.csv", "technical,aesthetic\n1,2\n3,4\n")
        assert read_scores(path) == {"0": Branches(1, 2), "1": Branches(3, 4)}

    def test_json(self, tmp_path: Path) -> None:
        item = {"aesthetic": -0.2, "technical": 0.1}
        expected = {"x": Branches(technical=0.1, aesthetic=-0.2)}
        assert read_scores(self.write(tmp_path / "a.json", {"x": item})) == expected
        assert read_scores(self.write(tmp_path / "b.json", [item | {"video": "x"}])) == expected

    @pytest.mark.parametrize(
        "text",
        [
            "0.1,-0.2\n0.3,-0.1\n",  # columns by place alone
            "path, aesthetic score, technical score, overall/final score\nx, 50, 50, 50\n",  # rescaled, in percent
            "technical,technical,aesthetic\n1,2,3\n",
            "",
        ],
    )
    def test_csv_without_the_names_is_refused(self, tmp_path: Path, text: str) -> None:
        path = self.write(tmp_path / "a.csv", text)
        with pytest.raises(MetricError, match=r"a\.csv: expected the columns technical, aesthetic, each once"):
            read_scores(path)

    @pytest.mark.parametrize("content", [[[0.1, 0.2]], {"x": [0.1, 0.2]}, [], {}, 3, [{"technical": 1}]])
    def test_json_without_the_names_is_refused(self, tmp_path: Path, content: Any) -> None:
        with pytest.raises(MetricError, match=r"a\.json: .*expected"):
            read_scores(self.write(tmp_path / "a.json", content))

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("technical,aesthetic\n1,2\nx,2\n", "line 3: expected technical and aesthetic"),
            ("technical,aesthetic\n1\n", "line 2: expected 2 fields, got 1"),
            ("technical,aesthetic\n\n1,nan\n", "line 3: expected finite scores"),
            ("technical,aesthetic,video\n1,2,a\n3,4,a\n", "line 3: expected each video once, got a again"),
            ("technical,aesthetic\n", "expected lines below"),
        ],
    )
    def test_malformed_line_is_named(self, tmp_path: Path, text: str, message: str) -> None:
        with pytest.raises(MetricError, match=rf"a\.csv: {message}"):
            read_scores(self.write(tmp_path / "a.csv", text))
