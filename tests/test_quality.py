"""Qualities: what they set gives way to weathers and assignments, and `balanced` shows what `exact` does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import aw4d
from aw4d.clip import Clip
from aw4d.colour import srgb_codes
from aw4d.errors import InputError
from aw4d.ingest import ingest_street
from aw4d.quality import QUALITIES
from aw4d.weathers import WEATHERS, Settings, settings

COMBINED = ("rain+night", "snow+fog", "fog+night")


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    path = tmp_path_factory.mktemp("quality") / "street.aw4d"
    ingest_street(path, frames=2, width=160, height=88, workers=1)
    return Clip(path)


def test_the_parameters_defaults_are_balanced() -> None:
    assert QUALITIES["balanced"] == ()
    assert settings("fog").ambient == settings("fog", quality="balanced").ambient
    assert settings("fog").fog.nodes == Settings().fog.nodes


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize("weather", WEATHERS)
def test_what_a_weather_sets_counts_before_a_quality(weather: str, quality: str) -> None:
    made = settings(weather, quality=quality)
    for text in WEATHERS[weather].sets:
        group, _, rest = text.partition(".")
        name, _, value = rest.partition("=")
        assert str(getattr(getattr(made, group), name)).removesuffix(".0") == value


@pytest.mark.parametrize("quality", QUALITIES)
def test_assignments_count_before_a_quality(quality: str) -> None:
    made = settings("rain", ["fog.nodes=2", "reflections.steps=9"], quality)
    assert (made.fog.nodes, made.reflections.steps) == (2, 9)


def test_an_unknown_quality_is_refused() -> None:
    with pytest.raises(InputError, match="--quality: expected exact, balanced, fast, got 'best'"):
        settings("fog", quality="best")


@pytest.mark.parametrize("weather", [*WEATHERS, *COMBINED])
def test_balanced_shows_what_exact_does(street: Clip, weather: str) -> None:
    exact, balanced = (
        srgb_codes(next(aw4d.edit(street, weather, backend="numpy", frames=[1], quality=quality)).rgb)
        for quality in ("exact", "balanced")
    )
    assert np.percentile(np.abs(balanced - exact), 99.99) <= 1


def test_fast_differs_more(street: Clip) -> None:
    exact, balanced, fast = (
        srgb_codes(next(aw4d.edit(street, "rain+night", backend="numpy", frames=[1], quality=quality)).rgb)
        for quality in ("exact", "balanced", "fast")
    )
    assert np.abs(fast - exact).mean() > np.abs(balanced - exact).mean()


def test_the_sidecar_records_the_quality(street: Clip, tmp_path: Path) -> None:
    from aw4d.output import write_edit
    from aw4d.pipeline import plan
    from aw4d.render import open_backend

    made = plan(street, "overcast", quality="fast")
    content = write_edit(street, made, open_backend("numpy"), [0], tmp_path / "out")
    assert content["quality"] == "fast"
    assert content["settings"]["ambient"]["occlusion_slices"] == made.settings.ambient.occlusion_slices
