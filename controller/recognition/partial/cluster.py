"""A cluster: the outline of more, or less, than one part in a picture.

Its outline is taken as it is, but for where the picture or the backlit area ends: there nothing is
known of the part. Where parts meet, the outline turns inwards: a negative turn in the paper's
boundary string (references.md P3.1).
"""

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, FloatArray, IntArray
from controller.imaging import Camera, Contour, signed_area

from ..fitting import OutlineMeasure
from ..segmentation import Region

CELL_MM = 0.7  # cell of the map of nearest outline points
MARGIN_MM = 5.0  # margin of that map round the cluster
RIM_PX = 4  # distance from the picture's end within which an outline is not the part's
CELL_PX = 3  # distance between the lines of sight by which parts are compared with the cluster
MIN_LOOP_PX = 12
# Lengths of the chords behind and ahead of a point, between which an outline turns inwards where
# parts meet. Blur rounds narrow notches; beside a corner that juts out long chords do not see them.
CHORDS_MM = (2.0, 1.0)
MIN_CHORD_PX = 4  # shorter chords turn by the stairs of pixels
MEETING_RAD = 0.35  # ten times the turn by 0.03 mm of noise, and less than a usual chamfer's

OUTSIDE, INSIDE, BEYOND = 0, 1, 2


class Cluster:
    """A region of a backlit picture whose outline holds several parts, or one that is cut.

    Parameters
    ----------
    region : as it was cut out
    camera : overhead, calibrated
    usable : (height, width) mask of the area for parts; None for everywhere
    """

    def __init__(self, region: Region, camera: Camera, usable: BoolArray | None = None) -> None:
        self.region, self.camera = region, camera
        self._hidden = _beyond(camera, usable)
        loops_px = [_directed(loop, k == 0) for k, loop in enumerate(region.loops_px)]
        self.loops_px = tuple(loop for loop in loops_px if len(loop) >= MIN_LOOP_PX)
        self.loops_mm = tuple(camera.on_plane(loop)[:, :2] for loop in self.loops_px)
        every = OutlineMeasure.of_loops(self.loops_px)
        self._own = ~self.is_beyond(every.points)
        self.points_px, self.normals_px = every.points[self._own], every.normals[self._own]

    def is_beyond(self, pixels: FloatArray) -> BoolArray:
        """Return a mask (n,) of the points (n, 2) of the picture where nothing is known."""
        height, width = self._hidden.shape
        x, y = np.round(np.nan_to_num(pixels, nan=-1.0)).astype(np.int64).T
        outside = (x < 0) | (y < 0) | (x >= width) | (y >= height)
        hidden = self._hidden[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        return np.asarray(outside | hidden)

    def is_inside(self, pixels: FloatArray) -> BoolArray:
        """Return a mask (n,) of the points (n, 2) of the picture on the cluster."""
        x0, y0, x1, y1 = self.region.box_px
        x, y = np.round(np.nan_to_num(pixels, nan=-1.0)).astype(np.int64).T
        within = (x >= x0) & (y >= y0) & (x < x1) & (y < y1)
        return np.asarray(
            within & self.region.mask[np.clip(y, y0, y1 - 1) - y0, np.clip(x, x0, x1 - 1) - x0]
        )

    def by_loop(self, which: BoolArray) -> tuple[tuple[BoolArray, ...], tuple[BoolArray, ...]]:
        """Return a mask of the parts' own points of each loop, and of those already named.

        Parameters
        ----------
        which : (m,) mask of ``points_px``
        """
        named = np.zeros(len(self._own), dtype=np.bool_)
        named[self._own] = which
        ends = np.cumsum([len(loop) for loop in self.loops_px])[:-1]
        return tuple(np.split(self._own, ends)), tuple(np.split(named, ends))

    @cached_property
    def measure(self) -> OutlineMeasure:
        """The measure to which poses are fitted."""
        return OutlineMeasure(Contour(self.points_px, self.normals_px))

    @cached_property
    def map(self) -> "NearestMap":
        """The outline in the table plane."""
        return NearestMap(self)

    @cached_property
    def meetings_px(self) -> FloatArray:
        """Points (n, 2) at which the outline turns inwards: there parts may meet."""
        found = [np.zeros((0, 2))]
        scale = self.camera.mm_per_px(np.zeros(3))
        for loop_px, loop_mm in zip(self.loops_px, self.loops_mm, strict=True):
            at = loop_mm @ np.array([1.0, 1.0j])
            for chord_mm in CHORDS_MM:
                step = max(round(chord_mm / scale), MIN_CHORD_PX)
                ahead, behind = np.roll(at, -step) - at, at - np.roll(at, step)
                # the part is to the left
                found.append(loop_px[np.angle(ahead * behind.conj()) < -MEETING_RAD])
        return np.concatenate(found)

    @cached_property
    def cells(self) -> tuple[FloatArray, IntArray, BoolArray]:
        """Lines of sight (n, 3) all over the box, row and column (n, 2), and hits (n,)."""
        x0, y0, x1, y1 = self.region.box_px
        v, u = np.mgrid[y0:y1:CELL_PX, x0:x1:CELL_PX]
        pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
        lines = self.camera.sight_lines(pixels)
        cells = np.column_stack([(v.ravel() - y0) // CELL_PX, (u.ravel() - x0) // CELL_PX])
        return lines, cells, self.region.mask[::CELL_PX, ::CELL_PX].ravel()

    def looks_up(self, cells: BoolArray, pixels: FloatArray) -> BoolArray:
        """Return a mask of the points (n, 2) at which cells (m,) are set, or those beside them."""
        height, width = self.region.mask.shape
        grid = cells.reshape(-(-height // CELL_PX), -(-width // CELL_PX)).astype(np.uint8)
        grid = np.asarray(cv2.dilate(grid, np.ones((3, 3), np.uint8)))
        at = ((pixels - self.region.box_px[:2]) // CELL_PX).astype(np.int64)
        at = np.clip(at, 0, [grid.shape[1] - 1, grid.shape[0] - 1])
        return np.asarray(grid[at[:, 1], at[:, 0]] > 0)

    def thick(self, cells: BoolArray, width_mm: float) -> BoolArray:
        """Return a mask (m,) of the cells in or beside a piece of some cells that is so wide."""
        height, width = self.region.mask.shape
        grid = cells.reshape(-(-height // CELL_PX), -(-width // CELL_PX)).astype(np.uint8)
        cell_mm = CELL_PX * self.camera.mm_per_px(np.zeros(3))
        size = 2 * max(1, round(0.5 * width_mm / cell_mm)) + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
        opened = cv2.dilate(cv2.erode(grid, disc, borderValue=0), disc)
        return np.asarray(cv2.dilate(opened, np.ones((7, 7), np.uint8)).ravel() > 0)

    def raster(self, cells: BoolArray) -> BoolArray:
        """Return cells (n,) as pixels (h, w) of the cluster's box."""
        height, width = self.region.mask.shape
        rows, columns = -(-height // CELL_PX), -(-width // CELL_PX)
        out = cells.reshape(rows, columns).repeat(CELL_PX, axis=0).repeat(CELL_PX, axis=1)
        return np.asarray(out[:height, :width])


class NearestMap:
    """Nearest outline point of any place near a cluster, with its kind."""

    def __init__(self, cluster: Cluster) -> None:
        px = cluster.points_px
        self.points = cluster.camera.on_plane(px)[:, :2]
        ahead = cluster.camera.on_plane(px + cluster.normals_px)[:, :2] - self.points
        self.normals = ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
        every = np.concatenate(cluster.loops_mm)
        self._low = every.min(axis=0) - MARGIN_MM
        size = np.ceil((every.max(axis=0) + MARGIN_MM - self._low) / CELL_MM).astype(int) + 1
        x, y = np.meshgrid(*(self._low[k] + CELL_MM * np.arange(size[k]) for k in (0, 1)))
        places = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        pixels = cluster.camera.project(places)
        state = np.where(cluster.is_inside(pixels), INSIDE, OUTSIDE).astype(np.int8)
        state[cluster.is_beyond(pixels)] = BEYOND
        self._state = state.reshape(x.shape)
        ground = np.ones(x.shape, dtype=np.uint8)
        column, row = self._cell(*self.points.T)
        ground[row, column] = 0
        _, label = cv2.distanceTransformWithLabels(
            ground, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        point_of = np.zeros(int(label.max()) + 1, dtype=np.int64)
        point_of[label[row, column]] = np.arange(len(self.points))
        self._nearest = point_of[label]

    def _cell(self, x_mm: FloatArray, y_mm: FloatArray) -> tuple[IntArray, IntArray]:
        rows, columns = self._state.shape
        column = np.round((x_mm - self._low[0]) / CELL_MM).astype(np.int64)
        row = np.round((y_mm - self._low[1]) / CELL_MM).astype(np.int64)
        return np.clip(column, 0, columns - 1), np.clip(row, 0, rows - 1)

    def look(
        self, x_mm: FloatArray, y_mm: FloatArray
    ) -> tuple[FloatArray, IntArray, NDArray[np.int8]]:
        """Return distance (...) to the nearest outline point, its index, and what is there.

        Parameters
        ----------
        x_mm, y_mm : (...) places on the table
        """
        column, row = self._cell(x_mm, y_mm)
        at = row * self._state.shape[1] + column
        nearest = self._nearest.ravel()[at]
        x, y = self.points.T
        away_x, away_y = x_mm - x[nearest], y_mm - y[nearest]
        far = np.sqrt(away_x * away_x + away_y * away_y)
        return far, nearest, self._state.ravel()[at]

    def own(self, is_open: BoolArray) -> NDArray[np.complex64]:
        """Return the normal of each cell's nearest point as a complex number.

        0 where that is not of the points asked for, and where nothing is known.

        Parameters
        ----------
        is_open : (m,) mask of the outline's points
        """
        normals = np.where(is_open, self.normals @ np.array([1.0, 1.0j]), 0.0)
        of_cells = np.asarray(normals.astype(np.complex64)[self._nearest].ravel())
        of_cells[self._state.ravel() == BEYOND] = 0.0
        return of_cells

    @cached_property
    def _places(self) -> NDArray[np.complex64]:
        """The nearest point of each cell as a complex number."""
        points = (self.points @ np.array([1.0, 1.0j])).astype(np.complex64)
        return np.asarray(points[self._nearest].ravel())

    def look_along(
        self,
        points: NDArray[np.complex64],
        normals: NDArray[np.complex64],
        own: NDArray[np.complex64],
    ) -> tuple[Float32Array, Float32Array, BoolArray]:
        """Return `look` for very many places: distances, cosines of normals, where nothing is.

        Parameters
        ----------
        points, normals : (...) on the table, as complex numbers
        own : of `own`: the normals that are compared with
        """
        rows, columns = self._state.shape
        low = np.complex64(self._low[0] + 1j * self._low[1])
        cells = ((points - low) * np.float32(1 / CELL_MM)).view(np.float32)
        cells = np.rint(cells).reshape(*points.shape, 2)
        column = np.clip(cells[..., 0], 0, columns - 1).astype(np.int32)
        row = np.clip(cells[..., 1], 0, rows - 1).astype(np.int32)
        row *= columns
        row += column
        away = np.abs(points - self._places.take(row))
        theirs = own.take(row)
        agree = theirs.real * normals.real + theirs.imag * normals.imag
        return away, agree, (self._state.ravel() == OUTSIDE).take(row)


def _directed(loop: FloatArray, is_outer: bool) -> FloatArray:
    """Return a loop with the part on the left where y runs up, on the right where it runs down."""
    return loop if (signed_area(loop) < 0) == is_outer else loop[::-1]


def _beyond(camera: Camera, usable: BoolArray | None) -> BoolArray:
    """Return a mask (height, width) of where nothing is known of an outline."""
    width, height = camera.size_px
    out = np.zeros((height, width), dtype=np.uint8)
    if usable is not None:
        out[~usable] = 1
        out = np.asarray(cv2.dilate(out, np.ones((2 * RIM_PX + 1,) * 2, np.uint8)))
    out[:RIM_PX], out[-RIM_PX:], out[:, :RIM_PX], out[:, -RIM_PX:] = 1, 1, 1, 1
    return out.astype(np.bool_)
