"""What the documents say of parameters and commands is what there is."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

from aw4d.params import Params
from aw4d.weathers import GROUPS
from tests.conftest import ROOT

DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


# Where the parameters of a group are described.
PLACES = {
    "ambient": "ambient.md",
    "exposure": "light.md",
    "fog": "fog.md",
    "harmonize": "grade.md",
    "headlights": "fog.md",
    "lights": "lights.md",
    "night_grade": "grade.md",
    "overcast_sky": "grade.md",
    "puddles": "rain.md",
    "rain": "weathers.md",
    "rain_streaks": "falling.md",
    "reflections": "reflections.md",
    "ripples": "rain.md",
    "snow": "weathers.md",
    "snow_cover": "snow.md",
    "snow_fall": "falling.md",
    "spot_lights": "light.md",
    "street_lamps": "lights.md",
    "vehicle_lights": "lights.md",
    "wet_ground": "rain.md",
}


@pytest.mark.parametrize(("group", "params"), GROUPS.items())
def test_every_parameter_is_documented(group: str, params: type[Params]) -> None:
    text = (ROOT / "docs" / PLACES[group]).read_text(encoding="utf-8")
    for field in dataclasses.fields(params):
        assert f"`{field.name}`" in text or f"`{group}.{field.name}`" in text, field.name


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", document.read_text(encoding="utf-8")):
        assert (document.parent / target).exists(), target


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_commands_exist(document: Path) -> None:
    from typer.main import get_command

    from aw4d.cli import app

    known = set(get_command(app).commands)  # type: ignore[attr-defined]
    for command in re.findall(r"^\s*aw4d ([a-z]+)", document.read_text(encoding="utf-8"), re.MULTILINE):
        assert command in known, command
