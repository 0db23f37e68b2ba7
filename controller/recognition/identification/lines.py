"""What lines, corners and circles of a picture propose; references.md P3.2."""

import numpy as np

from controller.arrays import Grey
from controller.imaging import Camera

from ..grey import image_features, propose
from ..library import Candidate, Library


def by_lines(
    crop: Grey, corner_px: tuple[int, int], camera: Camera, library: Library, most: int
) -> list[Candidate]:
    """Return what the grey levels of a crop propose, the likeliest first.

    Parameters
    ----------
    crop : (h, w) grey
    corner_px : (x0, y0) of the crop in the picture
    camera : overhead, calibrated
    library : of the parts that may be there
    most : of proposals
    """
    corner = np.array(corner_px, dtype=np.float64)
    features = image_features(crop, lambda p: camera.on_plane(p + corner)[:, :2])
    foot = (float(camera.position_mm[0]), float(camera.position_mm[1]))
    proposed = []
    for h in propose(features, library.grey_index, foot_mm=foot, most=most):
        part, pose = library.grey_views[h.model_index]
        x, y = (float(v) for v in h.shift_mm)
        proposed.append(Candidate(part, pose, h.turn_rad, x, y, h.score, 0.0))
    return proposed
