"""Qualities: points on the front of error against time, as assignments that give way to a weather's own."""

from __future__ import annotations

from aw4d.errors import InputError

# What a quality sets other than the parameters' defaults; docs/quality.md has what each costs and errs by.
QUALITIES: dict[str, tuple[str, ...]] = {
    "exact": ("fog.nodes=64", "fog.faintest=0", "ambient.occlusion_steps=9"),
    "balanced": (),
    "fast": (
        "fog.nodes=4",
        "ambient.occlusion_slices=2",
        "ambient.occlusion_steps=6",
        "reflections.steps=14",
    ),
}
DEFAULT_QUALITY = "balanced"


def quality_sets(quality: str) -> tuple[str, ...]:
    """What a quality sets, as `group.field=value`.

    Raises
    ------
    InputError
        There is no such quality.
    """
    if quality not in QUALITIES:
        raise InputError(f"--quality: expected {', '.join(QUALITIES)}, got {quality!r}")
    return QUALITIES[quality]
