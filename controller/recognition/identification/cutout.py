"""Cutouts of the pictures about one object, computed on demand."""

from functools import cached_property

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import Camera, render_maps

from ..fitting import EdgeFit, EdgeModel, GreyMeasure, ImageEdges, Measure, OutlineMeasure
from ..segmentation import Region
from .scene import TableScene

RIM_MM = 0.8  # width of a part's rim whose grey levels blur with what lies beside it
BESIDE_PX = 3  # distance outside the mask within which strong edges are still the part's


class ObjectCutout:
    """One object's share of the pictures.

    Parameters
    ----------
    region : as it was cut out
    scene : its pictures, and the parts that it may be
    """

    def __init__(self, region: Region, scene: TableScene) -> None:
        self.region, self.scene = region, scene
        self.camera, self.library = scene.camera, scene.library
        self.is_backlit = scene.is_backlit
        self.is_lit = len(scene.pictures) > 1 or not scene.is_backlit

    @cached_property
    def mm_per_px(self) -> float:
        """Size of a pixel on the table at the object."""
        x0, y0, x1, y1 = self.region.box_px
        middle_px = np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])
        return self.scene.mm_per_px(self.camera.on_plane(middle_px)[0, :2])

    @property
    def corner_px(self) -> tuple[int, int]:
        """First pixel of its crops in the picture."""
        return self.region.box_px[0], self.region.box_px[1]

    @cached_property
    def crops(self) -> tuple[Grey, ...]:
        """The pictures, cut to its box."""
        x0, y0, x1, y1 = self.region.box_px
        return tuple(np.ascontiguousarray(picture[y0:y1, x0:x1]) for picture in self.scene.pictures)

    @cached_property
    def outline(self) -> OutlineMeasure:
        """Its outline."""
        return OutlineMeasure.of_loops(self.region.loops_px)

    @cached_property
    def greys(self) -> tuple[GreyMeasure, ...]:
        """Gradients of the pictures."""
        if not self.is_backlit:
            first, *others = self.crops
            return (GreyMeasure(first, self.corner_px, is_lit=True, others=others),)
        last = len(self.crops) - 1
        return tuple(
            GreyMeasure(crop, self.corner_px, is_lit=k < last) for k, crop in enumerate(self.crops)
        )

    @property
    def measure(self) -> Measure:
        """The measure to which poses are fitted."""
        return self.outline if self.is_backlit else self.greys[0]

    @cached_property
    def inside(self) -> BoolArray:
        """Mask (h, w) of the part's pixels in the crop, without its blurred rim."""
        rim = 2 * max(1, round(RIM_MM / self.mm_per_px)) + 1
        mask = self.region.mask.astype(np.uint8)
        return np.asarray(cv2.erode(mask, np.ones((rim, rim), np.uint8)) > 0)

    @property
    def telling(self) -> tuple[Grey, ...]:
        """The crops that show its inside: those under lamps, or else the only one."""
        if self.is_backlit:
            return self.crops[: max(len(self.crops) - 1, 1)]
        return self.crops[1:] or self.crops

    @cached_property
    def image_edges(self) -> tuple[ImageEdges, ...]:
        """Strong edges of each measure that shows the object's inside; under lamps, also round it.

        Under each lamp other edges show: a low step that the ring light leaves flat casts a shadow
        under the side light. Before a light table each lamp's picture is a measure of its own.
        """
        within = self.inside
        if not self.is_backlit:
            wide = np.ones((2 * BESIDE_PX + 1,) * 2, np.uint8)
            within = np.asarray(cv2.dilate(self.region.mask.astype(np.uint8), wide) > 0)
        telling = self.greys[: max(len(self.greys) - self.is_backlit, 1)]
        return tuple(ImageEdges.of(grey, within) for grey in telling)


def part_depth_mm(
    model: EdgeModel, fit: EdgeFit, camera: Camera, box_px: tuple[int, int, int, int]
) -> FloatArray:
    """Return the depth (h, w) of a box of the picture from the camera to a part; inf beside it.

    Parameters
    ----------
    model, fit : model of the part, and its fitted pose
    camera : overhead, calibrated
    box_px : (x0, y0, x1, y1) pixels, the last ones excluded
    """
    x0, y0, x1, y1 = box_px
    out = np.full((y1 - y0, x1 - x0), np.inf)
    seen = fit.edges.pixels
    low = np.maximum(np.floor(seen.min(axis=0)).astype(int) - 2, [x0, y0])
    high = np.minimum(np.ceil(seen.max(axis=0)).astype(int) + 3, [x1, y1])
    if (low >= high).any():
        return out
    roi = (int(low[0]), int(low[1]), int(high[0]), int(high[1]))
    maps = render_maps(model.caster, fit.T_world_part, camera, roi)
    out[low[1] - y0 : high[1] - y0, low[0] - x0 : high[0] - x0] = maps.depth_mm
    return out
