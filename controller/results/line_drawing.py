"""Line views as SVG: the outline with its arcs as arcs, and the visible edges.

A view's y points up, a drawing's down: y changes its sign here, and with it every rotation.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray
from controller.cad.views import DrawnEdge, LineView, Loop, Stroke

# Width over height of every drawing and picture on the page.
ASPECT = 4 / 3
# Border on every side, as a share of the larger extent.
MARGIN = 0.06
FULL_TURN = 2 * np.pi - 1e-6
# Where on a loop its arrow is, as a share of its length.
ARROW_AT = 0.12


@dataclass(frozen=True, slots=True)
class DrawingFrame:
    """The region every view of a part is drawn in, so that all have one scale.

    Attributes
    ----------
    x, y, width, height : SVG view box [mm]
    unit : size of marks and letters [mm], a hundredth of the larger side
    bar_mm : length of the scale bar
    """

    x: float
    y: float
    width: float
    height: float
    unit: float
    bar_mm: float

    @property
    def view_box(self) -> str:
        """The viewBox attribute of an SVG element."""
        return f"{self.x:.2f} {self.y:.2f} {self.width:.2f} {self.height:.2f}"


@dataclass(frozen=True, slots=True)
class Drawing:
    """One view of a pose, ready for the page.

    Attributes
    ----------
    outline : path of all loops, for the even-odd rule
    arrows : path of the arrow heads that show the direction of the loops
    starts : start of each loop, (x, y)
    sharp, smooth, silhouette : paths of the visible edges inside the outline
    rim : path of the visible edges on the outline
    phantoms : ends of edges that pass behind another, (x, y)
    """

    outline: str
    arrows: str
    starts: tuple[tuple[float, float], ...]
    sharp: str
    smooth: str
    silhouette: str
    rim: str
    phantoms: tuple[tuple[float, float], ...]


def frame_of(views: Sequence[LineView]) -> DrawingFrame:
    """Return the region that holds every view; the centre of mass is at (0, 0) in each."""
    corners = [loop.points for view in views for loop in view.loops]
    points = np.vstack(corners) if corners else np.array([[-1.0, -1.0], [1.0, 1.0]])
    low, high = points.min(axis=0), points.max(axis=0)
    room = MARGIN * float((high - low).max())
    middle = (low + high) / 2
    width, height = (float(v) for v in high - low + 2 * room)
    height += room  # for the scale bar
    width, height = max(width, ASPECT * height), max(height, width / ASPECT)
    larger = max(width, height)
    return DrawingFrame(
        x=float(middle[0] - width / 2),
        y=float(-middle[1] + room / 2 - height / 2),
        width=width,
        height=height,
        unit=larger / 100,
        bar_mm=_round_length(larger / 5),
    )


def _round_length(length_mm: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... that is not longer."""
    decade = 10.0 ** np.floor(np.log10(length_mm))
    return float(max(step * decade for step in (1, 2, 5) if step * decade <= length_mm * 1.0001))


def draw(view: LineView, unit: float) -> Drawing:
    """Return the drawing of a view; ``unit`` is the frame's."""
    inside = [edge for edge in view.edges if not edge.on_outline]
    phantoms = [
        end
        for edge in view.edges
        for end, is_phantom in (
            (edge.points[0], edge.starts_phantom),
            (edge.points[-1], edge.ends_phantom),
        )
        if is_phantom
    ]
    return Drawing(
        outline="".join(loop_path(loop) for loop in view.loops),
        arrows="".join(_arrow(loop, unit) for loop in view.loops),
        starts=tuple((float(loop.points[0, 0]), float(-loop.points[0, 1])) for loop in view.loops),
        sharp=_edge_paths([edge for edge in inside if edge.kind == "sharp"]),
        smooth=_edge_paths([edge for edge in inside if edge.kind == "smooth"]),
        silhouette=_edge_paths([edge for edge in inside if edge.kind == "silhouette"]),
        rim=_edge_paths([edge for edge in view.edges if edge.on_outline]),
        phantoms=tuple((float(x), float(-y)) for x, y in phantoms),
    )


def loop_path(loop: Loop) -> str:
    """Return a closed loop as the ``d`` of an SVG path of lines and arcs."""
    if not loop.strokes:
        return _polyline(loop.points) + "Z"
    x, y = loop.strokes[0].start
    return f"M{x:.3f} {-y:.3f}" + "".join(_stroke(stroke) for stroke in loop.strokes) + "Z"


def _stroke(stroke: Stroke) -> str:
    if stroke.centre is None or stroke.axes is None:
        return f"L{stroke.end[0]:.3f} {-stroke.end[1]:.3f}"
    if abs(stroke.sweep_rad) >= FULL_TURN:  # SVG draws no arc that ends where it starts
        middle = 2 * stroke.centre - stroke.start
        half = stroke.sweep_rad / 2
        return _arc(stroke.axes, half, middle) + _arc(stroke.axes, half, stroke.end)
    return _arc(stroke.axes, stroke.sweep_rad, stroke.end)


def _arc(axes: FloatArray, sweep_rad: float, end: FloatArray) -> str:
    # SVG takes half axes at a right angle alone
    radii = np.linalg.norm(axes, axis=1)
    turn_deg = -float(np.degrees(np.arctan2(axes[0, 1], axes[0, 0])))
    is_anticlockwise = sweep_rad * float(axes[0, 0] * axes[1, 1] - axes[0, 1] * axes[1, 0]) > 0
    return (
        f"A{radii[0]:.3f} {radii[1]:.3f} {turn_deg:.2f} {int(abs(sweep_rad) > np.pi)} "
        f"{int(not is_anticlockwise)} {end[0]:.3f} {-end[1]:.3f}"
    )


def _polyline(points: FloatArray) -> str:
    return "M" + "L".join(f"{x:.2f} {-y:.2f}" for x, y in points)


def _edge_paths(edges: Sequence[DrawnEdge]) -> str:
    return "".join(_polyline(edge.points) for edge in edges)


def _arrow(loop: Loop, unit: float) -> str:
    """Return an arrow head on a loop; none if the loop is smaller than the head."""
    closed = np.vstack([loop.points, loop.points[:1]])
    steps = np.diff(closed, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if lengths.sum() < 30 * unit:
        return ""
    at = ARROW_AT * lengths.sum()
    ends = np.cumsum(lengths)
    side = int(np.searchsorted(ends, at))
    ahead = steps[side] / lengths[side]
    tip = closed[side + 1] - (ends[side] - at) * ahead + 1.6 * unit * ahead
    back, across = tip - 3.2 * unit * ahead, 1.3 * unit * np.array([-ahead[1], ahead[0]])
    return _polyline(np.stack([tip, back + across, back - across])) + "Z"
