"""The light that comes from all around: analytic skies, recorded maps, and the tables that the pass `ambient` reads."""

from aw4d.environment.build import analytic, environment
from aw4d.environment.model import Environment, EnvironmentArrays, arrays
from aw4d.environment.neural import rendered
from aw4d.environment.presets import Preset

__all__ = ["Environment", "EnvironmentArrays", "Preset", "analytic", "arrays", "environment", "rendered"]
