"""What the documents say of parameters and commands is what there is."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

from aw4d.params import FogParams, HeadlightParams, Params
from tests.conftest import ROOT

DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("params", [FogParams, HeadlightParams])
def test_every_parameter_is_documented(params: type[Params]) -> None:
    text = (ROOT / "docs" / "fog.md").read_text(encoding="utf-8")
    for field in dataclasses.fields(params):
        assert f"`{field.name}`" in text, field.name


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
