"""The lit pictures of one view: each must lie on the pose, and look as its light allows."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, Grey, on_each_pixel
from controller.cad import SurfaceSamples
from controller.imaging import ViewMaps, inverse_pose, transform
from controller.recognition.fitting import ModelEdgePoints, predict_edges
from messages import key, say

from .._connected import connected_findings, grow
from .._pose import PosedPart, PoseFit, point_spread
from .._scene import ViewScene, Visibility
from .._types import Check, Finding, FindingKind, InspectionLimits, Unjudged, ViewTask
from ..limits import FLATTEST_COS, POSE_SPREADS, SURE_SIGMAS, strip_px
from ..registration import (
    Registration,
    confirm_edges,
    picture_noise,
    register,
    register_edges,
)
from .bounce import Neighbours, find_neighbours
from .brightness import Brightness, fit_brightness
from .claims import shares_of_face
from .coded import on_code
from .compare import (
    BURNT_GREY,
    FITTED_COUNT,
    MAX_BURNT,
    WORST_TYPICAL,
    Compared,
    compare,
    fitted_nodes,
    in_penumbra,
)
from .finish import Finish, Polish
from .learned import (
    DARK_GREY,
    OTHER_FINISH,
    Known,
    LearnedView,
    contrast,
    known_at,
    ratio,
)
from .light import Light, bound_light
from .marks import Answers, answers, finds, smallest_nodes
from .spots import local_findings
from .surface import Surface, find_surface
from .texture import DARKEST_GREY, Texture, borders, creases, find_texture, learned_texture

STEP_PX: Final = 2  # faces are compared on every second pixel: shadows are as narrow as defects
LENS_PX: Final = 0.7  # typical blur of a lens
SHARP_STACK_PX: Final = 0.7  # the same as `register_edges` measures it
LENS_WIDTH_PX: Final = 0.56  # the same as `register` measures it
MIXED_PX: Final = 1.0  # a pixel next to an edge has some of its other side in it
MIN_NODES: Final = 3  # least width of a difference in light, on the grid
MIN_WIDTH_PX: Final = 7.0  # least width of a defect in the picture, without the blur of its border
# Share of the own lamp's error below which another lamp explains a picture better.
OTHER_LAMP: Final = 0.7
MIN_OTHER_ERROR: Final = (
    0.045  # a picture off by less may be this lamp's on a flat part, where all lamps look alike
)
FAINT_GREY: Final = 12.0
DISC_SHARE: Final = 0.6  # least share of a defect's disc on compared pixels
# Radii of a disc between its centre and a straight border that leaves `DISC_SHARE` of it: the root
# of 0.5 + (t sqrt(1 - t^2) + asin t) / pi = share, to a thousandth.
DISC_OFF: Final = 0.5 * np.pi * (DISC_SHARE - 0.5)
SPREAD_NODES: Final = 8  # step in nodes: the pose's spread changes slowly
# Border of a gripper's shadow, which no lamp's size is known well enough for.
SHADOW_NODES: Final = 5
PARTLY_NODES: Final = 2  # width in nodes: lamps are a little larger than their centres suggest
LIT: Final = 0.05  # least light that shows texture, in that of a surface square to the lamp
NOT_SHOWN: Final = key("it shows too little of the part's outline and edges to verify the pose")
MIN_NOISE_GREY: Final = 0.3  # least noise, in grey levels of eight bits


@dataclass(frozen=True, eq=False, slots=True)
class _LitPicture:
    """One lamp's picture, and the bounds of its light; (h, w) of the nodes.

    Attributes
    ----------
    name, picture : of the lamp, (height, width)
    observed : grey, hardly smoothed
    light : bounds of it
    valid : on the part, off the gripper and its shadow
    fitting : whose light is known well enough to fit a picture's brightness
    ground : how bright the wall behind the part is
    """

    name: str
    picture: Grey
    observed: Float32Array
    light: Light
    valid: BoolArray
    fitting: BoolArray
    ground: float

    @property
    def is_told(self) -> bool:
        """True if enough of the surface in sight is known to be lit."""
        return bool(self.fitting.sum() >= FITTED_COUNT)


class LitPictures:
    """The lit pictures of one view; their common data are computed once.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    task : the view, with its lamps and limits
    scene : what stands there besides the part
    fit : pose of the part, with its outline
    visible : which samples are in sight
    sharp : how sharp the backlit picture is; None where it does not show
    pictures : by lamp name
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
        pictures: Mapping[str, Grey],
    ) -> None:
        self._part, self._samples, self._task, self._scene = part, samples, task, scene
        self._fit, self.visible, self._sharp = fit, visible, sharp
        self._pictures = pictures
        self._lit_by: dict[str, _LitPicture] = {}
        self._fits: dict[str, Brightness] = {}
        self._refusals: dict[str, tuple[str, str | None]] = {}  # misfit and refusal, by lamp
        whole, step = fit.maps, STEP_PX
        nodes = ViewMaps(whole.roi, whole.triangle[::step, ::step], whole.depth_mm[::step, ::step])
        self._surface = find_surface(part.solid, nodes, fit.T_world_part, task.camera, step)
        com = transform(fit.T_world_part, part.solid.centroid_mm[None])[0]
        self._mm = task.camera.mm_per_px(com)
        # only inside the outline: beside it stands whatever stands behind the part
        filled = np.zeros(fit.maps.mask.shape, dtype=np.uint8)
        contours, _ = cv2.findContours(
            fit.maps.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(filled, contours, -1, 1, thickness=cv2.FILLED)
        self._inside: BoolArray = ~grow(filled == 0, task.limits.slack_px)

    @cached_property
    def _free(self) -> BoolArray:
        """Nodes (h, w) on the part, off the gripper and off codes."""
        x0, y0, x1, y1 = self._fit.maps.roi
        unheld = ~self._scene.holder_mask[y0:y1:STEP_PX, x0:x1:STEP_PX]
        return np.asarray(self._inside[::STEP_PX, ::STEP_PX] & unheld & ~self._coded)

    @cached_property
    def _coded(self) -> BoolArray:
        """Nodes (h, w) on codes."""
        on: BoolArray = np.zeros(self._surface.seen.shape, dtype=bool)
        if self._task.facts.codes_mm:
            points = transform(inverse_pose(self._fit.T_world_part), self._surface.points)
            masks = [on_code(points, corners) for corners in self._task.facts.codes_mm]
            on[self._surface.seen] = np.logical_or.reduce(masks)
        return on

    @cached_property
    def _edges(self) -> ModelEdgePoints:
        """Edges of the part in sight, off the gripper."""
        edges = predict_edges(self._part.edges, self._fit.T_world_part, self._task.camera)
        width, height = self._task.camera.size_px
        free = np.ones(len(edges.pixels), dtype=bool)
        for side_px in (-STEP_PX, STEP_PX):  # what is behind an outline is beside the part
            x, y = np.round(edges.pixels + side_px * edges.normals).astype(int).T
            inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
            free &= inside
            free[inside] &= ~self._scene.holder_mask[y[inside], x[inside]]
        return replace(
            edges,
            points_mm=edges.points_mm[free],
            pixels=edges.pixels[free],
            normals=edges.normals[free],
            on_outline=edges.on_outline[free],
            lift=edges.lift[free],
            jump_mm=edges.jump_mm[free],
        )

    @cached_property
    def _smooth_faces(self) -> BoolArray:
        """Nodes on smooth faces, off edges, outline and gripper."""
        play = strip_px(self._mm) + POSE_SPREADS * self._spread_px
        return self._off_edges & (self._edge_px > play)

    @cached_property
    def _edge_px(self) -> Float32Array:
        """Distance (h, w) of each node's pixels from the nearest edge of the CAD model [px]."""
        maps, step = self._fit.maps, STEP_PX
        faces = self._part.solid.face_of_triangle[maps.triangle]
        face = np.where(maps.mask, faces, -1).astype(np.int32)
        depth_mm = np.where(maps.mask, maps.depth_mm, 0.0)
        side_mm = depth_mm / float(self._task.camera.K[0, 0])
        away = _away_px(borders(face, depth_mm, side_mm))
        # a node's nearest pixel counts
        nearest = cv2.erode(away, np.ones((step, step), np.uint8), anchor=(0, 0))[::step, ::step]
        nodes = np.minimum(nearest / np.float32(step), _away_px(creases(self._surface)))
        return np.asarray(np.float32(step) * nodes)

    @cached_property
    def _off_edges(self) -> BoolArray:
        """Nodes in sight (h, w), off the gripper and off edges."""
        off = self._surface.seen & self._free & (self._edge_px > MIXED_PX)
        return np.asarray(off & (self._surface.cosine > FLATTEST_COS))

    @cached_property
    def _spread_px(self) -> Float32Array:
        """Uncertainty of the pose at the nodes (h, w), one standard deviation [px]."""
        surface = self._surface
        rows, columns = np.nonzero(surface.seen)
        some = np.flatnonzero((rows % SPREAD_NODES == 0) & (columns % SPREAD_NODES == 0))
        shape = tuple(-(-n // SPREAD_NODES) for n in surface.seen.shape)
        coarse = np.zeros(shape, dtype=np.float32)
        spread = point_spread(self._part, self._task, self._fit, surface.points[some])
        coarse[rows[some] // SPREAD_NODES, columns[some] // SPREAD_NODES] = spread
        wide = np.asarray(cv2.dilate(coarse, np.ones((3, 3), np.uint8)), np.float32)
        return on_each_pixel(wide, SPREAD_NODES, surface.seen.shape)

    @property
    def surface(self) -> Surface:
        """The visible surface on the grid of nodes."""
        return self._surface

    @property
    def in_sight(self) -> BoolArray:
        """Mask (n,) of the samples that nothing stands before."""
        return self.visible.free & ~self.visible.beside_gripper

    @property
    def corner_px(self) -> tuple[int, int]:
        """Pixel (x, y) of the first node."""
        return self._fit.maps.roi[:2]

    @property
    def polish(self) -> tuple[Polish, ...]:
        """Evidence on the polish of the finish, of each picture that proves anything."""
        return tuple(
            self._brightness(lamp.name).polish
            for lamp in self._task.lamps
            if self.refusal(lamp.name) == ""
        )

    def refusal(self, lamp_name: str) -> str | None:
        """Return why a lamp's picture proves nothing, empty if it does; None if it lights nothing.

        Parameters
        ----------
        lamp_name : one of the view's lamps
        """
        if lamp_name not in self._refusals:
            lit = self._lit(lamp_name)
            misfit = self._misfit(lit)
            self._refusals[lamp_name] = misfit, self._refusal(lit, misfit)
        return self._refusals[lamp_name][1]

    def _refusal(self, lit: "_LitPicture", misfit: str) -> str | None:
        if not lit.is_told and (not misfit or misfit == NOT_SHOWN):
            # nothing that this lamp is known to light is in sight: nothing is compared or found
            return None
        if misfit:
            return misfit
        brightness = self._brightness(lit.name)
        return self._unlike(lit, brightness) or self._other_lamp(lit, brightness)

    def ratio(self, lamp_name: str) -> tuple[Float32Array, BoolArray]:
        """Return the logarithm of picture to prediction (h, w), and a mask of where it is good.

        Parameters
        ----------
        lamp_name : of a picture that is not refused
        """
        observed = self._averaged(lamp_name)
        # the gripper's shadow moves on the part as this slips, and is no part of how it looks
        good = self._off_edges & self._lit(lamp_name).valid & (observed < BURNT_GREY)
        return ratio(observed, self._brightness(lamp_name)), good

    def check(
        self, lamp_name: str, finish: Finish, learned: LearnedView | None = None
    ) -> tuple[Check, list[Finding], NDArray[np.uint8]]:
        """Return the check of a lamp's picture, its findings, and the reasons for the rest (n,).

        Parameters
        ----------
        lamp_name : one of the view's lamps
        finish : of the part
        learned : the same view of good parts; None for none
        """
        task, limits = self._task, self._task.limits
        lit = self._lit(lamp_name)
        reason = self.refusal(lamp_name)
        if reason != "":
            why = Unjudged.UNLIT if reason is None else Unjudged.LAMP
            code = np.where(self.visible.free, why.number, 0)
            is_dark = reason is None and bool(self._refusals[lamp_name][0])
            check = Check(lamp_name, reason or "", self._none(), is_dark=is_dark)
            return check, [], code.astype(np.uint8)
        brightness = self._brightness(lamp_name)
        mirrored, uneven = lit.light.bounced.most_mirrored(finish)
        outcome = compare(
            lit.observed, self._surface, lit.light, brightness, mirrored, lit.valid, lit.ground,
            limits, self._flattest,
        )  # fmt: skip
        found = self._wrong_light(lamp_name, outcome)
        texture, noise, bounced, known = self._texture(lit, brightness, uneven, learned)
        answer = answers(texture, noise, bounced, limits.false_marks, limits.weak_marks, known)
        if answer.noisier > OTHER_FINISH:
            # not what was learned: prediction decides
            texture, noise, bounced, known = self._texture(lit, brightness, uneven, None)
            answer = answers(texture, noise, bounced, limits.false_marks, limits.weak_marks)
        found += local_findings(
            answer,
            texture,
            lit.picture,
            self._surface,
            self._part,
            self._fit,
            task,
            lamp_name,
            STEP_PX,
        )
        compared, code = self._per_sample(outcome, answer, texture)
        check = Check(
            lamp_name, "", compared, limits.smallest_defect_mm, misfit=brightness.misfit,
            smallest_mm=self._smallest(answer, texture),
            learned_from=0 if known is None or learned is None else learned.parts,
        )  # fmt: skip
        return check, found, code

    def _lit(self, lamp_name: str) -> "_LitPicture":
        """Return a lamp's picture with the bounds of its light on the part, from a cache."""
        if lamp_name not in self._lit_by:
            lamp = next(lamp for lamp in self._task.lamps if lamp.name == lamp_name)
            light = bound_light(
                self._surface, self._part.caster, self._fit.T_world_part, self._task.camera, lamp,
                self._scene.wide, self._about,
            )  # fmt: skip
            picture = self._pictures[lamp_name]
            x0, y0, x1, y1 = self._fit.maps.roi
            soft = cv2.GaussianBlur(picture[y0:y1, x0:x1], (0, 0), 1.0)
            valid = self._free & ~grow(light.touched, SHADOW_NODES)
            self._lit_by[lamp_name] = _LitPicture(
                lamp_name,
                picture,
                np.asarray(soft[::STEP_PX, ::STEP_PX], np.float32),
                light,
                valid,
                fitted_nodes(self._surface, light, valid),
                _ground_level(picture, self._fit.maps, self._scene),
            )
        return self._lit_by[lamp_name]

    @cached_property
    def _about(self) -> Neighbours:
        """Surroundings of the visible surface: part and gripper."""
        return find_neighbours(
            self._surface, self._part.caster, self._fit.T_world_part, self._task.camera,
            self._scene.holder,
        )  # fmt: skip

    def _brightness(self, lamp_name: str) -> Brightness:
        """Return a lamp's light as fitted to its picture, from a cache."""
        if lamp_name not in self._fits:
            lit = self._lit(lamp_name)
            told = lit.fitting & (lit.observed < BURNT_GREY)
            if told.sum() < FITTED_COUNT:
                told = lit.fitting
            self._fits[lamp_name] = fit_brightness(
                lit.observed, lit.light, told, self._surface.face
            )
        return self._fits[lamp_name]

    def _other_lamp(self, mine: "_LitPicture", brightness: Brightness) -> str:
        """Return another lamp of the view that explains a picture far better, empty if none."""
        for lamp in self._task.lamps:
            if lamp.name == mine.name:
                continue
            other = self._lit(lamp.name)
            told = mine.observed < BURNT_GREY
            fitting = other.fitting & told
            used = told & self._surface.seen & ~in_penumbra(other.light) & ~in_penumbra(mine.light)
            used &= other.valid & mine.valid
            if min(fitting.sum(), used.sum()) < FITTED_COUNT:
                continue
            own = _error(mine.observed[used], brightness.predicted[used])
            if own < MIN_OTHER_ERROR:
                continue
            by_other = fit_brightness(mine.observed, other.light, fitting, self._surface.face)
            error = _error(mine.observed[used], by_other.predicted[used])
            if error < OTHER_LAMP * own:
                return say(
                    "it looks as lit by {name}, {error_percent:.1f} % off in the mean, not by "
                    "{own_name}, {own_percent:.1f} %: were the lamps swapped?",
                    name=lamp.name,
                    error_percent=100 * error,
                    own_name=mine.name,
                    own_percent=100 * own,
                )
        return ""

    def _none(self) -> BoolArray:
        return np.zeros(len(self._samples.points_mm), dtype=bool)

    def _unlike(self, lit: "_LitPicture", brightness: Brightness) -> str:
        """Return the reason why a picture cannot be of this lamp on this part, empty if it can."""
        limits = self._task.limits
        fitted = lit.observed[lit.fitting]
        if float((fitted >= BURNT_GREY).mean()) > MAX_BURNT:
            return key("it is burnt out: a shorter exposure or a darker lamp is needed")
        if float(np.quantile(fitted, 0.9)) < limits.min_contrast / 4:
            return key("it gives no light: is the lamp on?")
        if brightness.typical > WORST_TYPICAL:
            return say(
                "brightness scatters by {typical_percent:.0f} % about the prediction, "
                "{worst_typical_percent:.0f} % is allowed: not this lamp, or not this "
                "finish",
                typical_percent=100 * brightness.typical,
                worst_typical_percent=100 * WORST_TYPICAL,
            )
        return ""

    def _wrong_light(self, lamp_name: str, outcome: Compared) -> list[Finding]:
        """Return connected places with wrong light or shadow."""
        limits = self._task.limits
        kernel = np.ones((MIN_NODES, MIN_NODES), np.uint8)
        opened = cv2.morphologyEx(outcome.wrong.astype(np.uint8), cv2.MORPH_OPEN, kernel)
        x0, y0, x1, y1 = self._fit.maps.roi
        area = np.where(self._surface.seen, self._surface.area_mm2, np.float32(self._mm**2))
        full, areas = (on_each_pixel(a, STEP_PX, (y1 - y0, x1 - x0)) for a in (opened > 0, area))
        return connected_findings(
            full, FindingKind.SURFACE, lamp_name, self._part, self._fit.maps, self._task.camera,
            self._fit.T_world_part, (x0, y0), areas, limits.min_area_mm2,
        )  # fmt: skip

    def _texture(
        self,
        lit: "_LitPicture",
        brightness: Brightness,
        uneven: Float32Array,
        learned: LearnedView | None,
    ) -> tuple[Texture, Float32Array, Float32Array, Known | None]:
        """Return the texture under a lamp, the camera's noise, bounced light, and good parts."""
        x0, y0, x1, y1 = self._fit.maps.roi
        known = None
        if learned is not None:
            known = known_at(learned, lit.name, self._surface, self._fit.T_world_part)
        bounced: Float32Array = np.zeros(self._surface.seen.shape, dtype=np.float32)
        if known is not None:
            ratios, good = self.ratio(lit.name)
            grey = self._expected_grey(lit.name, known.mean)
            known = replace(known, mask=known.mask & good & (grey > DARKEST_GREY))
            texture = learned_texture(contrast(ratios, known.mean, known.mask), grey, known.mask)
        else:
            texture = self._own_texture(lit, brightness)
            share = np.asarray(uneven / np.maximum(lit.light.least, LIT), np.float32)
            bounced = np.where(self._surface.seen, share, np.float32(0))
        window = lit.picture[y0:y1, x0:x1].astype(np.float32)
        grey_noise = max(picture_noise(window), MIN_NOISE_GREY) / STEP_PX
        noise = np.asarray(grey_noise / np.maximum(texture.smooth, 1.0), np.float32)
        return texture, noise, bounced, known

    def _own_texture(self, lit: "_LitPicture", brightness: Brightness) -> Texture:
        """Return the texture of faces under a lamp about their own smooth brightness."""
        light, seen = lit.light, self._surface.seen
        observed = self._averaged(lit.name)
        good = ~in_penumbra(light) & ~grow(light.partly, PARTLY_NODES)
        good &= lit.valid & (light.least > LIT)
        sure = cv2.erode(good.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0)
        usable = self._smooth_faces & (sure > 0)
        usable &= observed < BURNT_GREY
        predicted = np.where(seen, brightness.predicted, np.float32(0))
        thrown = light.bounced.matt / np.maximum(0.5 * (light.least + light.most), LIT)
        return find_texture(observed, self._surface, usable, predicted, thrown)

    def _averaged(self, lamp_name: str) -> Float32Array:
        """Return a lamp's picture as the mean of each node's pixels (h, w) [grey]."""
        x0, y0, x1, y1 = self._fit.maps.roi
        window = self._pictures[lamp_name][y0:y1, x0:x1].astype(np.float32)
        even = cv2.copyMakeBorder(window, 0, -window.shape[0] % 2, 0, -window.shape[1] % 2,
                                  cv2.BORDER_REPLICATE)  # fmt: skip
        shape = self._surface.seen.shape
        return np.asarray(cv2.resize(even, shape[::-1], interpolation=cv2.INTER_AREA), np.float32)

    def _expected_grey(self, lamp_name: str, mean: Float32Array) -> Float32Array:
        """Return the brightness (h, w) of good parts with this mean logarithm of the ratio."""
        predicted = np.maximum(self._brightness(lamp_name).predicted, np.float32(0))
        return np.asarray((predicted + DARK_GREY) * np.exp(mean) - DARK_GREY, np.float32)

    def _misfit(self, lit: "_LitPicture") -> str:
        """Return the reason why a lit picture misses the pose or is not sharp; empty if neither."""
        limits, fit = self._task.limits, self._fit
        # the outline that the lit picture must agree with is itself known that well only
        play_px = SURE_SIGMAS * float(np.median(self._spread_px[self._surface.seen]))
        limits = replace(limits, max_lit_shift_px=float(np.hypot(limits.max_lit_shift_px, play_px)))
        steps = register(lit.picture, fit.edge_px, fit.edge_normals, self._expected(lit))
        # the expected picture is blurred by a good lens; the backlit one tells how good this one is
        lens = max(self._sharp.width_px - LENS_WIDTH_PX, 0.0) if self._sharp is not None else 0.0
        refusal = NOT_SHOWN
        if steps is not None:
            refusal = _refusal(steps, steps.growth_px, lens, limits)
        if refusal:
            # the outline before a dark wall, or in a bright one's glow, is no sure measure
            edges = self._edges
            steps = register_edges(lit.picture, edges.pixels, edges.normals)
            if steps is None and refusal == NOT_SHOWN:
                within_px = limits.max_lit_shift_px
                steps = confirm_edges(lit.picture, edges.pixels, edges.normals, within_px)
            if steps is not None:
                # it overrules the outline where it leaves no question, not at the limit
                strict = replace(limits, max_edge_growth_px=limits.max_edge_growth_px / 2)
                refusal = _refusal(steps, steps.width_px - SHARP_STACK_PX, lens, strict)
        return refusal

    def _expected(self, lit: "_LitPicture") -> Float32Array:
        """Return the whole predicted picture, to a grey level or ten, (height, width)."""
        step, light, picture = STEP_PX, lit.light, lit.picture
        whole = self._fit.maps
        x0, y0, x1, y1 = whole.roi
        matt = 0.5 * (light.least + light.most)
        bright = self._surface.seen & (matt > 0.3)
        observed = picture[y0:y1:step, x0:x1:step].astype(np.float32)
        gain = float(np.median(observed[bright] / matt[bright])) if bright.any() else 0.0
        full = on_each_pixel(matt, step, (y1 - y0, x1 - x0))
        out = np.full(picture.shape, lit.ground, dtype=np.float32)
        # a node may be seen where the pixel beside it is not: its neighbour's light then
        wide = cv2.dilate(full, np.ones((2 * step - 1, 2 * step - 1), np.uint8))
        shines = gain * np.where(full > 0, full, wide)
        out[y0:y1, x0:x1] = np.where(whole.mask, shines, out[y0:y1, x0:x1])
        return np.asarray(cv2.GaussianBlur(out, (0, 0), LENS_PX), dtype=np.float32)

    @property
    def _flattest(self) -> float:
        """The cosine below which the smallest defect is too narrow in the picture."""
        return float(MIN_WIDTH_PX * self._mm / self._task.limits.smallest_defect_mm)

    @cached_property
    def _at_samples(self) -> tuple[BoolArray, NDArray[np.intp], NDArray[np.intp]]:
        """Mask of the samples (n,) on the grid, and the rows and columns of these."""
        x0, y0, x1, y1 = self._fit.maps.roi
        u, v = ((self.visible.pixels - [x0, y0]) // STEP_PX).T
        height, width = -(-(y1 - y0) // STEP_PX), -(-(x1 - x0) // STEP_PX)
        inside = self.visible.free & (u >= 0) & (v >= 0) & (u < width) & (v < height)
        return inside, v[inside], u[inside]

    def _smallest(self, answer: Answers, texture: Texture) -> dict[str, Float32Array]:
        """Return the smallest width [mm] found at each sample (n,) by kind of mark, else inf."""
        inside, v, u = self._at_samples
        side = np.maximum(self._surface.node_mm, 1e-6)
        out = {}
        for kind, nodes in smallest_nodes(answer, texture, self._surface.cosine).items():
            widths = np.full(len(inside), np.inf, dtype=np.float32)
            widths[inside] = (nodes * side)[v, u]
            out[kind] = widths
        return out

    def _per_sample(
        self, outcome: Compared, answer: Answers, texture: Texture
    ) -> tuple[BoolArray, NDArray[np.uint8]]:
        """Return a mask (n,) of the samples a picture compared, and reasons for the others (n,)."""
        limits = self._task.limits
        side = np.maximum(self._surface.node_mm, 1e-6)
        width = np.asarray(limits.smallest_defect_mm / side, np.float32)
        fine = finds(answer, texture, self._surface.cosine, FindingKind.DENT.name.lower(), width)
        size = limits.smallest_defect_mm / self._mm / STEP_PX
        masks, camera = (fine, outcome.compared), self._task.camera
        shares = shares_of_face(masks, self._surface, camera, size)
        whole, light = (share >= DISC_SHARE for share in shares)
        light &= outcome.compared
        inside, v, u = self._at_samples
        coded = self._coded[v, u]
        shown = (whole[v, u] | light[v, u]) & (self._flattest < 1.0) & ~coded
        compared = self._none()
        code = np.zeros(len(inside), dtype=np.uint8)
        compared[inside] = shown
        edge = Unjudged.EDGE.number
        reason = np.where(coded, Unjudged.CODE.number, outcome.reason[v, u])
        code[inside] = np.where(shown, 0, np.where(reason == 0, edge, reason))
        return compared, code


def _away_px(edge: BoolArray) -> Float32Array:
    """Return the distance (h, w) from the nearest place of an edge, in places."""
    return np.asarray(cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, 5), np.float32)


def _error(observed: Float32Array, predicted: Float32Array) -> float:
    """Return the mean relative error of nodes (n,) of a picture against its predicted light."""
    scale = np.maximum(observed + predicted, FAINT_GREY)
    return float(np.mean(np.abs(observed - predicted) / scale))


def _refusal(
    steps: Registration, growth_px: float, lens_px: float, limits: InspectionLimits
) -> str:
    """Return the objection to a lit picture, empty if there is none.

    Parameters
    ----------
    steps : its shift against the pose, and its blur
    growth_px : how much wider its edges are than they should be
    lens_px : how much of that is the lens
    limits : what is allowed
    """
    shift = float(np.linalg.norm(steps.shift_px))
    if shift > limits.max_lit_shift_px:
        return say(
            "it is {shift:.1f} px beside the backlit one, "
            "{max_lit_shift_px:.1f} px is allowed: the part or the camera moved",
            shift=shift,
            max_lit_shift_px=limits.max_lit_shift_px,
        )
    if growth_px - lens_px > limits.max_edge_growth_px:
        return say(
            "its edges are {growth_px:.1f} px wider than they should be, "
            "{allowed_px:.1f} px is allowed: out of focus, or moved",
            growth_px=growth_px,
            allowed_px=lens_px + limits.max_edge_growth_px,
        )
    return ""


def _ground_level(picture: Grey, maps: ViewMaps, scene: ViewScene) -> float:
    """Return the brightness of the wall behind the part under a lamp, where no shadow falls."""
    clear = scene.panel & ~scene.holder_mask
    x0, y0, x1, y1 = maps.roi
    clear[y0:y1, x0:x1] = False
    values = picture[clear]
    return float(np.quantile(values[::7], 0.9)) if len(values) > 700 else 255.0
