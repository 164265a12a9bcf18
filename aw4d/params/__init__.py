"""Every parameter of every pass: unit, range and source on each field; defaults live here and nowhere else."""

from aw4d.params.ambient import AmbientParams
from aw4d.params.amounts import RainParams, SnowParams
from aw4d.params.base import CONVENTIONS, RGB, Params, param
from aw4d.params.exposure import ExposureParams
from aw4d.params.falling import RainStreaksParams, SnowFallParams
from aw4d.params.fog import DEFAULT_VISIBILITY_M, KOSCHMIEDER, FogParams
from aw4d.params.grade import HarmonizeParams, NightGradeParams, OvercastSkyParams
from aw4d.params.ground import PuddlesParams, RipplesParams, WetGroundParams
from aw4d.params.lights import HeadlightParams, LightParams, StreetLampParams, VehicleLightParams
from aw4d.params.reflections import ReflectionsParams
from aw4d.params.snow import SnowCoverParams
from aw4d.params.spot_lights import SpotLightsParams

__all__ = [
    "CONVENTIONS",
    "DEFAULT_VISIBILITY_M",
    "KOSCHMIEDER",
    "RGB",
    "AmbientParams",
    "ExposureParams",
    "FogParams",
    "HarmonizeParams",
    "HeadlightParams",
    "LightParams",
    "NightGradeParams",
    "OvercastSkyParams",
    "Params",
    "PuddlesParams",
    "RainParams",
    "RainStreaksParams",
    "ReflectionsParams",
    "RipplesParams",
    "SnowCoverParams",
    "SnowFallParams",
    "SnowParams",
    "SpotLightsParams",
    "StreetLampParams",
    "VehicleLightParams",
    "WetGroundParams",
    "param",
]
