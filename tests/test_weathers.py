"""Weathers and their combinations: which passes run, whose light counts, how amounts reach the passes."""

from __future__ import annotations

from itertools import permutations

import pytest

from aw4d.errors import InputError
from aw4d.weathers import ORDER, WEATHERS, find, parts, settings

HOURS = [name for name, weather in WEATHERS.items() if weather.hour]


@pytest.mark.parametrize("names", [("rain", "night"), ("snow", "fog"), ("rain", "fog", "night"), ("rain", "snow")])
def test_a_combination_is_the_same_in_every_order(names: tuple[str, ...]) -> None:
    made = [settings("+".join(order)) for order in permutations(names)]
    assert all(other == made[0] for other in made)


@pytest.mark.parametrize("hour", HOURS)
@pytest.mark.parametrize("name", [name for name in WEATHERS if name not in HOURS])
def test_a_combination_has_the_light_of_its_hour(name: str, hour: str) -> None:
    together = find(f"{name}+{hour}")
    assert together.light_sets == WEATHERS[hour].light_sets
    assert set(together.passes) == {*WEATHERS[hour].light, *WEATHERS[name].passes}
    assert together.passes == tuple(known for known in ORDER if known in together.passes)
    assert settings(f"{name}+{hour}").ambient == settings(hour).ambient


def test_overcast_lights_what_it_is_combined_with() -> None:
    together = settings("rain+overcast")
    assert together.ambient == settings("overcast").ambient
    assert not together.headlights.on
    assert settings("overcast+night").ambient == settings("night").ambient


def test_sleet_is_as_wet_as_the_wetter_part() -> None:
    assert settings("rain+snow", ["rain.rate_mm_h=0"]).wet_ground == settings("snow").wet_ground
    assert settings("rain+snow", ["rain.amount=heavy"]).wet_ground == settings("rain", ["rain.amount=heavy"]).wet_ground


def test_fog_in_rain_is_as_dense_as_fog() -> None:
    assert settings("rain+fog").fog.visibility_m == settings("fog").fog.visibility_m
    assert settings("rain").fog.visibility_m == 20_000


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("rian", "did you mean rain?"),
        ("rain+nigth", "got 'nigth'; did you mean night?"),
        ("rain+rain", "every weather once"),
        ("dawn+night", "one time of the day, got dawn and night"),
        ("", "expected a known weather, got ''"),
        ("rain+", "expected a known weather, got ''"),
    ],
)
def test_what_is_no_weather_is_refused(name: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        parts(name)
    assert message in str(caught.value)


def test_amounts_reach_the_passes_that_are_not_set_by_themselves() -> None:
    light, heavy = (settings("rain", [f"rain.amount={amount}"]) for amount in ("light", "heavy"))
    assert light.rain_streaks.rate_mm_h == light.ripples.rate_mm_h == 2
    assert heavy.rain_streaks.rate_mm_h == 25
    assert light.puddles.share < heavy.puddles.share
    assert light.wet_ground.wetness < heavy.wet_ground.wetness
    assert settings("rain", ["rain.rate_mm_h=10", "ripples.rate_mm_h=3"]).ripples.rate_mm_h == 3
    assert settings("snow", ["snow.depth_cm=7"]).snow_cover.depth_cm == 7
    assert settings("rain", ["snow.depth_cm=7"]).snow_cover == settings("rain").snow_cover


@pytest.mark.parametrize(
    "assignment",
    ["rain.rate_mm_h=-1", "rain.amount=much", "snow.depth_cm=-0.1", "snow.depth_cm=nan", "puddles.share=1.1"],
)
def test_impossible_amounts_are_refused(assignment: str) -> None:
    name = assignment.partition("=")[0]
    with pytest.raises(InputError, match=f"--set {name}: expected"):
        settings("rain+snow", [assignment])
