"""The predicted picture of a posed part by the CAD, for a person's eye: no measurement.

Before the backlight the part is a shadow between the two levels of the picture. Under a lamp it is
as bright as a matt surface would be there, with its shadows, at the scale that fits the rest of the
picture best. Highlights, the gripper, and what stands behind the part are not predicted.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from pydantic import ValidationError

from controller.arrays import BoolArray, FloatArray, Grey
from controller.cad import Solid
from controller.config import Cell
from controller.imaging import (
    Camera,
    PointLamp,
    RayCaster,
    Roi,
    ViewMaps,
    inverse_pose,
    render_maps,
    transform,
    view_roi,
)
from controller.setup.optics import build_camera, build_lamps

from ..run import ViewReport

MARGIN_PX: Final = 24  # margin round the part in which the background level is taken
FIT_PX: Final = 160  # longer side of the grid that the lamp's scale is fitted on
FIT_ROUNDS: Final = 5
OUTLYING: Final = 2.5  # robust standard deviations: farther off a pixel is no matt surface
RIM_PX: Final = 3  # distance inside the border at which levels of a shadow are taken
BLUR_PX: Final = 0.8  # approximate blur of the camera
START_MM: Final = 0.05  # offset of a shadow ray's start from its own surface
BACKLIT: Final = "backlight"  # ending of the panels' names


@dataclass(frozen=True, eq=False, slots=True)
class PredictedPiece:
    """A piece of a predicted picture.

    Attributes
    ----------
    level : (height, width) grey
    known : (height, width) mask of the prediction
    """

    level: FloatArray
    known: BoolArray


class Predictor:
    """Predicts pictures of one part in one cell.

    Parameters
    ----------
    solid : the part
    cell : as the run's first row has it

    Raises
    ------
    ValidationError : this version cannot read the cell
    """

    def __init__(self, solid: Solid, cell: Mapping[str, Any]) -> None:
        self._cell = Cell.model_validate(cell)
        self._mesh = solid.mesh
        self._caster = RayCaster(solid.mesh)

    @classmethod
    def of(cls, solid: Solid | str, cell: Mapping[str, Any]) -> "Predictor | str":
        """Return the predictor, or the reason why nothing can be predicted."""
        if isinstance(solid, str):
            return solid
        try:
            return cls(solid, cell)
        except ValidationError:
            return "another version of cellctl wrote the cell of this run"

    def predict(
        self, view: ViewReport, lamp: str, picture: Grey, window: Roi
    ) -> PredictedPiece | str:
        """Return the prediction for a window of a view's picture, or the reason why there is none.

        Parameters
        ----------
        view : view with the measured pose
        lamp : lamp of the picture, as in the cell file
        picture : as taken, whole
        window : x0, y0, x1, y1 [px], within the picture
        """
        if len(view.T_world_part) == 0:
            return "the part's pose in this view is not known"
        T_world_part = np.asarray(view.T_world_part, dtype=float)
        cameras = self._cell.cameras
        camera = build_camera(cameras.overhead if lamp.startswith("table_") else cameras.inspection)
        size_px = (picture.shape[1], picture.shape[0])
        if camera.size_px != size_px:
            return "the picture is of another size than the camera's"
        whole = view_roi(np.asarray(self._mesh.vertices), T_world_part, camera, MARGIN_PX)
        if whole is None:
            return "the part is out of this picture"
        if lamp.endswith(BACKLIT):
            return self._shadow(T_world_part, camera, picture, window, whole)
        if lamp not in self._cell.lamps:
            return f"the cell has no lamp {lamp}"
        (source,) = build_lamps(self._cell, [lamp])
        return self._lit(T_world_part, camera, source, picture, window, whole)

    def _shadow(
        self, T_world_part: FloatArray, camera: Camera, picture: Grey, window: Roi, whole: Roi
    ) -> PredictedPiece:
        mask = render_maps(self._caster, T_world_part, camera, whole).mask.astype(np.uint8)
        x0, y0, x1, y1 = whole
        seen = picture[y0:y1, x0:x1]
        kernel = np.ones((2 * RIM_PX + 1, 2 * RIM_PX + 1), np.uint8)
        inside = cv2.erode(mask, kernel, borderValue=0) > 0
        beside = cv2.dilate(mask, kernel) == 0
        dark = float(np.median(seen[inside])) if inside.any() else 0.0
        bright = float(np.percentile(seen[beside], 75)) if beside.any() else 255.0
        here = render_maps(self._caster, T_world_part, camera, window).mask
        level = cv2.GaussianBlur(np.where(here, dark, bright), (0, 0), BLUR_PX)
        return PredictedPiece(np.asarray(level, dtype=float), np.ones(here.shape, dtype=bool))

    def _lit(
        self,
        T_world_part: FloatArray,
        camera: Camera,
        lamp: PointLamp,
        picture: Grey,
        window: Roi,
        whole: Roi,
    ) -> PredictedPiece | str:
        x0, y0, x1, y1 = whole
        step = max(1, round(max(x1 - x0, y1 - y0) / FIT_PX))
        coarse = render_maps(self._caster, T_world_part, camera, whole, step)
        if not coarse.mask.any():
            return "the part is out of this picture"
        soft = cv2.blur(picture, (step, step)) if step > 1 else picture
        seen = np.asarray(soft[y0:y1:step, x0:x1:step], dtype=float)
        light = self._light(coarse, T_world_part, camera, lamp, step)
        scale, offset = _fitted(light[coarse.mask], seen[coarse.mask])
        here = render_maps(self._caster, T_world_part, camera, window)
        sharp = offset + scale * self._light(here, T_world_part, camera, lamp, 1)
        level = np.asarray(cv2.GaussianBlur(sharp, (0, 0), BLUR_PX), dtype=float)
        return PredictedPiece(np.clip(level, 0, 255), here.mask)

    def _light(
        self,
        maps: ViewMaps,
        T_world_part: FloatArray,
        camera: Camera,
        lamp: PointLamp,
        step: int,
    ) -> FloatArray:
        """Return a lamp's light on a matt surface, (height, width); 0 beside the part."""
        x0, y0, x1, y1 = maps.roi
        lines = camera.sight_line_table[y0:y1:step, x0:x1:step].astype(float)
        on = maps.mask
        points = camera.position_mm + lines[on] * maps.depth_mm[on][:, None]
        normals = self._caster.normals[maps.triangle[on]] @ T_world_part[:3, :3].T
        start = transform(inverse_pose(T_world_part), points + START_MM * normals)
        found = np.zeros(len(points))
        for source in lamp.points_mm:
            towards = source - points
            distance = np.linalg.norm(towards, axis=1)
            unit = towards / distance[:, None]
            cosine = np.clip((unit * normals).sum(axis=1), 0.0, None)
            lit = np.flatnonzero(cosine > 0)
            free = np.zeros(len(points), dtype=bool)
            free[lit] = ~self._caster.blocked(start[lit], unit[lit] @ T_world_part[:3, :3])
            found += free * cosine * (100.0 / distance) ** 2
        level = np.zeros(maps.triangle.shape)
        level[on] = found / len(lamp.points_mm)
        return level


def _fitted(light: FloatArray, seen: FloatArray) -> tuple[float, float]:
    """Return scale and offset that put a lamp's light into grey levels, in spite of highlights."""
    columns = np.stack([light, np.ones_like(light)], axis=1)
    kept = np.ones(len(light), dtype=bool)
    scale, offset = 0.0, float(np.median(seen))
    for _ in range(FIT_ROUNDS):
        (scale, offset), *_ = np.linalg.lstsq(columns[kept], seen[kept], rcond=None)
        rest = np.abs(seen - columns @ (scale, offset))
        kept = rest <= OUTLYING * 1.4826 * max(float(np.median(rest)), 0.5)
        if kept.sum() < 2:
            break
    if scale <= 0:  # a surface gets no darker by more light
        return 0.0, float(np.median(seen))
    return float(scale), float(offset)
