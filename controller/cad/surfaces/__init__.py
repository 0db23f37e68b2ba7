"""Surfaces to be inspected: sample points, features, tolerances."""

from ._counted import SAMPLE_SHARE, count_caution, counted_defect_mm, counted_samples
from ._samples import SurfaceSamples, by_face, sample_surface
from ._shares import face_shares, share_of, uncertainty_of
from ._widths import inner_mm
from .features import Feature, FeatureKind, FeatureWall, find_features
from .mouths import Mouth, Recess, find_mouths, find_recesses

__all__ = [
    "SAMPLE_SHARE",
    "Feature",
    "FeatureKind",
    "FeatureWall",
    "Mouth",
    "Recess",
    "SurfaceSamples",
    "by_face",
    "count_caution",
    "counted_defect_mm",
    "counted_samples",
    "face_shares",
    "find_features",
    "find_mouths",
    "find_recesses",
    "inner_mm",
    "sample_surface",
    "share_of",
    "uncertainty_of",
]
