"""What has to be inspected: points on every surface, features, tolerances."""

from ._samples import SurfaceSamples, sample_surface

__all__ = ["SurfaceSamples", "sample_surface"]
