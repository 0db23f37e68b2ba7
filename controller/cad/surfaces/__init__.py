"""What has to be inspected: points on every surface, features, tolerances."""

from ._samples import SurfaceSamples, sample_surface
from .features import Feature, FeatureKind, FeatureWall, find_features

__all__ = [
    "Feature",
    "FeatureKind",
    "FeatureWall",
    "SurfaceSamples",
    "find_features",
    "sample_surface",
]
