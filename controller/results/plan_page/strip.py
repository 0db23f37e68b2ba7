"""The strip: every step in close-up, mostly as a camera of the cell sees it, and from outside."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray
from controller.cad import Solid
from controller.imaging import Camera
from controller.planning import CellLayout

from ..moments import Moment, MomentKind, Seat
from ..ray_drawing import FINER, smaller
from .bodies import PART, SceneBody, SceneMesh, moment_stage, not_round, standing_bodies
from .paint import Painter
from .render import look, png_of, shade
from .views import Eye, Slant, camera_eye, slant_over, slanting_eye, window_about

# Widths of a picture, and from how many steps on the next narrower one is used.
WIDTHS_PX = (320, 240, 180)
MANY_STEPS = (24, 48)
ASPECT = 1.25
AZIMUTH_RAD, ELEVATION_RAD = float(np.radians(-38.0)), float(np.radians(26.0))
BESIDE_RAD = tuple(float(np.radians(a)) for a in (-38.0, 52.0, 142.0, 232.0))
# Border around the part in close-up, as a share of its size.
BESIDE_ROOM = 0.8
TABLE_ROOM = 1.2
FAR_MM = 4000.0
# Opacity of links and palm where they are in front of the part.
GHOST = 0.22

NEW = (38.0, 166.0, 91.0)
AGAIN = (142.0, 208.0, 160.0)
BEFORE = (126.0, 170.0, 222.0)
OUTLINE = (214.0, 40.0, 110.0)


@dataclass(frozen=True, slots=True)
class StripFrame:
    """A step on the page.

    Attributes
    ----------
    near, outside : pictures, as files (PNG)
    near_words : viewpoint of the close-up, in words
    """

    moment: Moment
    number: int
    from_s: float
    to_s: float
    near: bytes
    near_words: str
    outside: bytes
    size: tuple[int, int]
    outside_size: tuple[int, int]
    in_sight_fraction: float
    new_fraction: float


class Strip:
    """Draws the moments of one plan.

    Parameters
    ----------
    solid : the part
    layout : the cell
    painter : colours of the part by its samples
    width_px : width of each picture
    """

    def __init__(self, solid: Solid, layout: CellLayout, painter: Painter, width_px: int) -> None:
        self._solid = solid
        self._layout = layout
        self._painter = painter
        self._size = (width_px, round(width_px / ASPECT))
        self._square = (width_px, width_px)
        self._standing = standing_bodies(layout)

    def frames(self, moments: Sequence[Moment], weights: FloatArray) -> list[StripFrame]:
        """Return all steps drawn; `weights` are the samples' shares of the surface."""
        seen = np.zeros(len(weights), dtype=bool)
        frames: list[StripFrame] = []
        from_s = 0.0
        for number, moment in enumerate(moments, start=1):
            colours = _colours(moment, seen)
            stage = moment_stage(self._layout, self._solid, moment, self._standing)
            near, words = self._near(moment, stage, colours)
            new = np.zeros_like(seen) if moment.in_sight is None else moment.in_sight & ~seen
            frames.append(
                StripFrame(
                    moment=moment,
                    number=number,
                    from_s=from_s,
                    to_s=from_s + moment.step.seconds,
                    near=png_of(near),
                    near_words=words,
                    outside=png_of(self._outside(stage, colours)),
                    size=(near.shape[1], near.shape[0]),
                    outside_size=self._square,
                    in_sight_fraction=0.0
                    if moment.in_sight is None
                    else float(weights[moment.in_sight].sum()),
                    new_fraction=float(weights[new].sum()),
                )
            )
            from_s += moment.step.seconds
            seen |= new
        return frames

    @cached_property
    def _slant(self) -> Slant:
        """A slanting view of the whole cell, the same in each step."""
        corners = np.vstack([body.vertices_mm for body in self._standing])
        return slant_over(corners, AZIMUTH_RAD, ELEVATION_RAD, 1.0, 0.01)

    @cached_property
    def _outside_eye(self) -> Eye:
        return slanting_eye(self._slant, _fine(self._square), FAR_MM)

    def _outside(self, stage: SceneMesh, colours: Float32Array) -> Float32Array:
        image = smaller(self._drawn(stage, self._outside_eye, colours))
        # the part is small here, and often behind the arm: its outline is drawn over everything
        corners = np.asarray(stage.bodies[-1].vertices_mm)
        pixels = self._slant.project(corners, self._square[0])
        hull = cv2.convexHull(np.round(16 * (pixels - 0.5)).astype(np.int32))
        cv2.polylines(image, [hull], True, OUTLINE, 1, cv2.LINE_AA, 4)
        return image

    def _near(
        self, moment: Moment, stage: SceneMesh, colours: Float32Array
    ) -> tuple[Float32Array, str]:
        if moment.seat is Seat.BESIDE:
            words = "from beside, arm transparent"
            if moment.kind is MomentKind.PLACE:
                words += "; of the trays, a good part's"
            return self._beside(moment, stage, colours), words
        camera = self._camera(moment.seat)
        corners = stage.bodies[-1].vertices_mm
        if moment.kind is MomentKind.PRESENT or not _is_in_sight(camera, corners):
            eye, words = self._full[moment.seat], moment.seat.value
        else:
            size = self._camera_size(camera)
            window = window_about(camera, corners, TABLE_ROOM, size[0] / size[1])
            eye, words = camera_eye(camera, window, _fine(size)), f"{moment.seat.value}, enlarged"
        standing = not_round(self._standing, camera.position_mm)
        stage = moment_stage(self._layout, self._solid, moment, standing)
        if moment.seat is Seat.INSPECTION or moment.kind in (MomentKind.LOOK, MomentKind.PARK):
            return smaller(self._drawn(stage, eye, colours)), words
        words = f"{words}, arm transparent"
        return self._through_links(moment, standing, stage, eye, colours), words

    def _beside(self, moment: Moment, stage: SceneMesh, colours: Float32Array) -> Float32Array:
        """Return the picture from the side that shows most of the part."""
        corners = stage.bodies[-1].vertices_mm
        bare = moment_stage(self._layout, self._solid, moment, self._standing, with_links=False)
        slants = [
            slant_over(corners, azimuth, ELEVATION_RAD, ASPECT, BESIDE_ROOM)
            for azimuth in BESIDE_RAD
        ]
        small = (self._size[0] // 4, self._size[1] // 4)
        shares = [
            int((look(bare, slanting_eye(s, small, FAR_MM)).triangle >= bare.first_of_part).sum())
            for s in slants
        ]
        eye = slanting_eye(slants[int(np.argmax(shares))], _fine(self._size), FAR_MM)
        return self._through_links(moment, self._standing, stage, eye, colours)

    def _through_links(
        self,
        moment: Moment,
        standing: Sequence[SceneBody],
        stage: SceneMesh,
        eye: Eye,
        colours: Float32Array,
    ) -> Float32Array:
        # seen from above the palm hides the part; from the side it shows how the part is held
        bare = moment_stage(
            self._layout,
            self._solid,
            moment,
            standing,
            with_links=False,
            with_palm=moment.seat is Seat.BESIDE,
        )
        behind = self._drawn(bare, eye, colours)
        front = self._drawn(stage, eye, colours)
        return smaller((1 - GHOST) * behind + GHOST * front)

    def _drawn(self, stage: SceneMesh, eye: Eye, colours: Float32Array) -> Float32Array:
        hits = look(stage, eye)
        return shade(stage, eye, hits, self._painter.paint(stage, hits, colours))

    def _camera(self, seat: Seat) -> Camera:
        return self._layout.overhead if seat is Seat.OVERHEAD else self._layout.inspection

    def _camera_size(self, camera: Camera) -> tuple[int, int]:
        return self._size[0], round(self._size[0] * camera.size_px[1] / camera.size_px[0])

    @cached_property
    def _full(self) -> dict[Seat, Eye]:
        """The rays of the cameras' whole pictures."""
        eyes = {}
        for seat in (Seat.INSPECTION, Seat.OVERHEAD):
            camera = self._camera(seat)
            window = (0.0, 0.0, float(camera.size_px[0]), float(camera.size_px[1]))
            eyes[seat] = camera_eye(camera, window, _fine(self._camera_size(camera)))
        return eyes


def width_for(count: int) -> int:
    """Return the width of the pictures for a number of steps [px]."""
    for width, most in zip(WIDTHS_PX, MANY_STEPS, strict=False):
        if count <= most:
            return width
    return WIDTHS_PX[-1]


def _fine(size: tuple[int, int]) -> tuple[int, int]:
    return FINER * size[0], FINER * size[1]


def _is_in_sight(camera: Camera, points_mm: FloatArray) -> bool:
    pixels = camera.project(points_mm)
    return bool(np.all((pixels >= 0) & (pixels <= np.array(camera.size_px) - 1)))


def _colours(moment: Moment, seen_before: BoolArray) -> Float32Array:
    """Return the colour of every sample (n, 3) at a moment."""
    colours = np.tile(np.array(PART, dtype=np.float32), (len(seen_before), 1))
    colours[seen_before] = BEFORE
    if moment.in_sight is not None:
        colours[moment.in_sight & seen_before] = AGAIN
        colours[moment.in_sight & ~seen_before] = NEW
    return colours
