"""The lit pictures of one view: each must lie where the pose says, and look as its light allows."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, Grey
from controller.cad import SurfaceSamples
from controller.imaging import ViewMaps, transform

from .._connected import connected_findings, grow
from .._pose import PosedPart, PoseFit
from .._scene import HOLDER_MARGIN_PX, ViewScene, Visibility
from .._types import Check, Finding, FindingKind, Unjudged, ViewTask
from ..registration import Registration, register
from .compare import Compared, compare
from .light import Light, Surface, bound_light, find_surface

SHADING_STEP_PX: Final = 2  # shading is compared on every second pixel: defects are many px large
LENS_PX: Final = 0.7  # about how a lens blurs
LENS_WIDTH_PX: Final = 0.56  # as `register` measures that
MIN_NODES: Final = 3  # a difference in shading is at least as wide, on the grid
MIN_WIDTH_PX: Final = 7.0  # and leaves so much of a defect, the blur of its border taken off
DISC_SHARE: Final = 0.6  # of a defect's disc that must lie on compared pixels


class LitPictures:
    """The lit pictures of one view; what they share is found once.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    task : the view, with its lamps and limits
    scene : what stands there besides the part
    fit : pose of the part, with its outline
    visible : which samples are in sight
    sharp : how sharp the backlit picture is; None where it does not show
    """

    def __init__(
        self,
        part: PosedPart,
        samples: SurfaceSamples,
        task: ViewTask,
        scene: ViewScene,
        fit: PoseFit,
        visible: Visibility,
        sharp: Registration | None,
    ) -> None:
        self._part, self._samples, self._task, self._scene = part, samples, task, scene
        self._fit, self._visibility, self._sharp = fit, visible, sharp
        step = SHADING_STEP_PX
        whole = fit.maps
        x0, y0, x1, y1 = whole.roi
        self._window = (slice(y0, y1, step), slice(x0, x1, step))
        maps = ViewMaps(whole.roi, whole.triangle[::step, ::step], whole.depth_mm[::step, ::step])
        self._surface: Surface = find_surface(part.solid, maps, fit.T_world_part, task.camera, step)
        com = transform(fit.T_world_part, part.solid.centroid_mm[None])[0]
        self._mm = task.camera.mm_per_px(com)
        # only inside the outline: beside it stands whatever stands behind the part
        filled = np.zeros(maps.mask.shape, dtype=np.uint8)
        contours, _ = cv2.findContours(
            maps.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(filled, contours, -1, 1, thickness=cv2.FILLED)
        slack = max(1, round(task.limits.slack_px / step))
        self._inside: BoolArray = ~grow(filled == 0, slack)
        self._unheld: BoolArray = ~scene.holder_mask[self._window]

    def check(
        self, lamp_name: str, picture: Grey
    ) -> tuple[Check, list[Finding], NDArray[np.uint8]]:
        """Return what a lamp's picture compared, what it found, and why not the rest (n,)."""
        task, limits = self._task, self._task.limits
        lamp = next(lamp for lamp in task.lamps if lamp.name == lamp_name)
        light = bound_light(
            self._surface, self._part.caster, self._fit.T_world_part, task.camera, lamp,
            self._scene.holder,
        )  # fmt: skip
        outcome = self._misfit(picture, light) or self._compare(picture, light)
        if isinstance(outcome, str):
            nothing = np.zeros(len(self._samples.points_mm), dtype=bool)
            code = np.where(self._visibility.free, Unjudged.LAMP.number, 0)
            return Check(lamp_name, outcome, nothing), [], code.astype(np.uint8)
        compared, code = self._per_sample(outcome)
        check = Check(lamp_name, "", compared, limits.smallest_defect_mm, misfit=outcome.misfit)
        step = SHADING_STEP_PX
        kernel = np.ones((MIN_NODES, MIN_NODES), np.uint8)
        opened = cv2.morphologyEx(outcome.wrong.astype(np.uint8), cv2.MORPH_OPEN, kernel)
        x0, y0, x1, y1 = self._fit.maps.roi
        area = np.where(self._surface.seen, self._surface.area_mm2, np.float32(self._mm**2))
        full, areas = (
            np.repeat(np.repeat(a, step, axis=0), step, axis=1)[: y1 - y0, : x1 - x0]
            for a in (opened > 0, area)
        )
        found = connected_findings(
            full, FindingKind.SURFACE, lamp_name, self._part, self._fit.maps, task.camera,
            self._fit.T_world_part, (x0, y0), areas, limits.min_area_mm2,
        )  # fmt: skip
        return check, found, code

    def _misfit(self, picture: Grey, light: Light) -> str:
        """Return why a lit picture does not lie on the pose, or is not sharp; empty if it does."""
        limits, fit = self._task.limits, self._fit
        expected = self._expected(picture, light)
        steps = register(picture, fit.edge_px, fit.edge_normals, expected)
        if steps is None:
            return "it shows too little of the part's outline to verify the pose"
        shift = float(np.linalg.norm(steps.shift_px))
        if shift > limits.max_lit_shift_px:
            return (
                f"it is {shift:.1f} px beside the backlit one, "
                f"{limits.max_lit_shift_px:.1f} px is allowed: the part or the camera moved"
            )
        # the expected picture is blurred by a good lens; the backlit one tells how good this one is
        lens = max(self._sharp.width_px - LENS_WIDTH_PX, 0.0) if self._sharp is not None else 0.0
        if steps.growth_px - lens > limits.max_edge_growth_px:
            return (
                f"its edges are {steps.growth_px:.1f} px wider than they should be, "
                f"{lens + limits.max_edge_growth_px:.1f} px is allowed: out of focus, or moved"
            )
        return ""

    def _expected(self, picture: Grey, light: Light) -> Float32Array:
        """Return the whole picture as predicted, to a grey level or ten, (height, width)."""
        step = SHADING_STEP_PX
        whole = self._fit.maps
        x0, y0, x1, y1 = whole.roi
        matt = 0.5 * (light.least + light.most)
        bright = self._surface.seen & (matt > 0.3)
        observed = picture[self._window].astype(np.float32)
        gain = float(np.median(observed[bright] / matt[bright])) if bright.any() else 0.0
        full = np.repeat(np.repeat(matt, step, axis=0), step, axis=1)[: y1 - y0, : x1 - x0]
        out = np.full(picture.shape, _ground_level(picture, whole, self._scene), dtype=np.float32)
        # a node may be seen where the pixel beside it is not: its neighbour's light then
        wide = cv2.dilate(full, np.ones((3, 3), np.uint8))
        lit = gain * np.where(full > 0, full, wide)
        out[y0:y1, x0:x1] = np.where(whole.mask, lit, out[y0:y1, x0:x1])
        return np.asarray(cv2.GaussianBlur(out, (0, 0), LENS_PX), dtype=np.float32)

    def _compare(self, picture: Grey, light: Light) -> Compared | str:
        task, scene, surface = self._task, self._scene, self._surface
        x0, y0, x1, y1 = self._fit.maps.roi
        step = SHADING_STEP_PX
        smooth = cv2.GaussianBlur(picture[y0:y1, x0:x1], (0, 0), 1.0)
        observed = smooth[::step, ::step].astype(np.float32)
        valid = self._unheld & ~grow(light.touched, HOLDER_MARGIN_PX // step + 1)
        return compare(
            observed, surface, light, self._inside, valid,
            _ground_level(picture, self._fit.maps, scene), self._part.solid.faces, task.limits,
            self._flattest,
        )  # fmt: skip

    @property
    def _flattest(self) -> float:
        """The cosine below which the smallest defect is too narrow in the picture."""
        return float(MIN_WIDTH_PX * self._mm / self._task.limits.smallest_defect_mm)

    def _per_sample(self, outcome: Compared) -> tuple[BoolArray, NDArray[np.uint8]]:
        """Return which samples a picture compared (n,), and why not the others (n,)."""
        disc_px = self._task.limits.smallest_defect_mm / self._mm / SHADING_STEP_PX
        size = max(1, round(disc_px)) | 1
        share = cv2.blur(outcome.compared.astype(np.float32), (size, size))
        x0, y0, _, _ = self._fit.maps.roi
        u, v = ((self._visibility.pixels - [x0, y0]) // SHADING_STEP_PX).T
        height, width = outcome.compared.shape
        inside = self._visibility.free & (u >= 0) & (v >= 0) & (u < width) & (v < height)
        compared = np.zeros(len(u), dtype=bool)
        code = np.zeros(len(u), dtype=np.uint8)
        v, u = v[inside], u[inside]
        whole = outcome.compared[v, u] & (share[v, u] >= DISC_SHARE)
        compared[inside] = whole & (self._flattest < 1.0)
        edge = Unjudged.EDGE.number
        reason = outcome.reason[v, u]
        code[inside] = np.where(whole, 0, np.where(reason == 0, edge, reason))
        return compared, code


def _ground_level(picture: Grey, maps: ViewMaps, scene: ViewScene) -> float:
    """Return how bright the wall behind the part is under a lamp, where no shadow falls."""
    clear = scene.panel & ~scene.holder_mask
    x0, y0, x1, y1 = maps.roi
    clear[y0:y1, x0:x1] = False
    values = picture[clear]
    return float(np.quantile(values[::7], 0.9)) if len(values) > 700 else 255.0
