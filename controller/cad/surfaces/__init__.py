"""What has to be inspected: points on every surface, features, tolerances."""

from ._samples import SurfaceSamples, sample_surface
from .features import Feature, FeatureKind, Step, find_features

__all__ = [
    "Feature",
    "FeatureKind",
    "Step",
    "SurfaceSamples",
    "find_features",
    "sample_surface",
]
