"""The widget of the paper, rebuilt from Table 1 alone: eleven view vectors and their energies.

python benchmarks/paper_widget.py [--json] [--write] [--pictures FOLDER] [--table FOLDER]

Unknown are the distances of nine planes from the centre of mass; known are their normals and, for
each, the climb to its easiest edge. Nine equations for nine unknowns, solved without `controller`:
of planes about the origin, two touch where their poles do on the hull of the poles, and the edge
of two planes has a distance that follows from their angle. The planes become a text of a solid;
what is cut out of it inside the hull brings its centre of mass to the origin. `--write` writes
recipes/parts/paper_widget.csg.yaml, else that file is read. Then the table of docs/paper.md:
what `cellctl compile` finds, beside the paper's. `--pictures` draws the nine views.
`--table` writes a backlit picture of each and its camera, for `cellctl recognise`.
"""

from __future__ import annotations

import itertools
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench import ROOT, Arguments, show
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull
from table_pictures import overhead, picture, resting, silhouette

from controller.cad import Solid, load_solid
from controller.cad.resting import stable_poses
from controller.cad.views import line_view

Array = NDArray[np.float64]

FILE = ROOT / "recipes" / "parts" / "paper_widget.csg.yaml"
ENERGIES = np.array(
    [1.240, 1.157, 0.6486, 0.3500, 0.2018, 0.1745, 0.1642, 0.1043, 0.07001, 0.03024, 0.02620]
)
VIEWS = np.array(
    [
        *([0, 1, 0], [0, -1, 0], [-0.5547, 0, -0.8321], [1, 0, 0], [0, 0, 1]),
        *([0.5547, 0, 0.8321], [-1, 0, 0], [0.2594, -0.5718, 0.7783], [0.2594, 0.5718, 0.7783]),
        *([0.4080, -0.2945, 0.8642], [0.4080, 0.2945, 0.8642]),
    ]
)
DOWNS = -VIEWS / np.linalg.norm(VIEWS, axis=1)[:, None]
MM = 7.5  # of one unit of the table's energy: views 8 and 9 then need a lift above 0.5 mm
TOP = 9.3  # distance of the plane that cuts the acute corner off [table units]; it holds nothing
START = (3.0, 3.2, 6.8, 5.0, 4.3, 4.4, 9.6, 4.3, 4.2)
START_ELEVEN = (5.6, 5.6, 23.5, 7.7, 6.4, 6.2, 37.1, 6.3, 6.4, 6.34, 6.35)


def climbs(downs: Array, heights: Array) -> Array:
    """Return the climb of each plane (n, 3) about the origin over its easiest edge (n,).

    Negative where the foot of the origin is outside the facet: the part does not rest there.
    """
    pairs = {
        (min(pair), max(pair))
        for simplex in ConvexHull(downs / heights[:, None]).simplices.tolist()
        for pair in itertools.combinations(simplex, 2)
    }
    least = np.full(len(heights), np.inf)
    for i, j in pairs:
        cos = float(downs[i] @ downs[j])
        square = heights[i] ** 2 + heights[j] ** 2 - 2 * cos * heights[i] * heights[j]
        edge = np.sqrt(max(square, 0.0) / (1 - cos**2))
        for a, b in ((i, j), (j, i)):
            climb = edge - heights[a]
            least[a] = min(least[a], climb if heights[b] > cos * heights[a] else -climb)
    return least


def solve(count: int, start: tuple[float, ...], more: Array, more_heights: Array) -> Array:
    """Return heights (count,) of the table's first planes that have its energies.

    Parameters
    ----------
    count : how many rows of the table
    start : (count,) where to begin
    more, more_heights : (k, 3), (k,) planes that close the solid and hold nothing
    """
    downs = np.vstack([DOWNS[:count], more])

    def off(logs: Array) -> Array:
        found = climbs(downs, np.append(np.exp(logs), more_heights))[:count]
        return np.asarray(np.clip(found / ENERGIES[:count] - 1, -5, 5))

    answer = least_squares(off, np.log(start), diff_step=1e-6, xtol=1e-15, ftol=1e-15)
    return np.asarray(np.exp(answer.x))


def meet(n1: tuple[float, float], d1: float, n2: tuple[float, float], d2: float) -> Array:
    return np.asarray(np.linalg.solve(np.array([n1, n2]), np.array([d1, d2])))


def listed(values: Array) -> str:
    return "[" + ", ".join(f"{v + 0.0:.3f}" for v in values) + "]"


def text_of(heights: Array, lower_mm: float, upper_mm: float, aside_mm: float) -> str:
    """Return the solid as text; heights (9,) [mm]; forks' widths and an offset set its centre."""
    y_low, y_high = -heights[0], heights[1]
    thick = y_high - y_low
    slope = (2 / np.sqrt(13), 3 / np.sqrt(13))
    back = (-slope[0], -slope[1])
    top = TOP * MM
    corners = [
        meet((1, 0), heights[6], slope, heights[2]),
        meet(slope, heights[2], (0, 1), top),
        meet((0, 1), top, (-1, 0), heights[3]),
        meet((-1, 0), heights[3], back, heights[5]),
        meet(back, heights[5], (0, -1), heights[4]),
        meet((0, -1), heights[4], (1, 0), heights[6]),
    ]
    corner = corners[5]
    inner, outer, arc = -10.0, 62.0, 15.0
    above = [(heights[2] - slope[0] * x) / slope[1] + 5 for x in (outer, inner)]
    mouth = [[outer, above[0]], [inner, above[1]], [inner, -4.0], [outer, -11.0]]
    upper = aside_mm - upper_mm / 2, aside_mm + upper_mm / 2
    lean = np.degrees(np.arccos(-DOWNS[7, 2]))
    bevels = [heights[7] * DOWNS[7], heights[8] * DOWNS[8]]
    return f"""\
# The widget of the paper, rebuilt from vectors and energies of its Table 1: docs/paper.md 2.1.
# Made by benchmarks/paper_widget.py. The origin is the centre of mass.
unit: mm
density_g_cm3: 2.7
tolerance_mm: 0.02
shapes:
  profile:                        # rests for views 3 to 7
    extrude:
      outline: [{", ".join(listed(c) for c in corners)}]
      height: {thick:.3f}
    turn: {{about: x, deg: 90}}     # the outline's y becomes z
    move: [0, {y_high:.3f}, 0]        # rests for views 1 and 2
  beyond_the_arc:                 # one corner ends in an arc of {arc:.0f} mm
    difference:
      - block: {{from: {listed(np.array([corner[0] - arc, y_low - 1, corner[1] - 1]))}, \
to: {listed(np.array([corner[0] + 1, y_high + 1, corner[1] + arc]))}}}
      - cylinder: {{radius: {arc:.0f}, height: {thick + 4:.3f}}}
        turn: {{about: x, deg: 90}}
        move: {listed(np.array([corner[0] - arc, y_high + 2, corner[1] + arc]))}
  bevel_8:                        # beyond the plane it rests on for view 8
    block: {{from: [-150, -150, -100], to: [150, 150, 0]}}
    turn: {{about: [0.5718, 0.2594, 0], deg: {lean:.5f}}}
    move: {listed(bevels[0])}
  bevel_9:
    block: {{from: [-150, -150, -100], to: [150, 150, 0]}}
    turn: {{about: [-0.5718, 0.2594, 0], deg: {lean:.5f}}}
    move: {listed(bevels[1])}
  mouth:                          # from here on nothing of the hull: the centre of mass moves
    extrude:
      outline: [{", ".join(listed(np.array(c)) for c in mouth)}]
      height: {thick + 2:.3f}
    turn: {{about: x, deg: 90}}
    move: [0, {y_high + 1:.3f}, 0]
  lower_fork:
    block: {{from: [26, {-lower_mm / 2:.3f}, -40], to: [90, {lower_mm / 2:.3f}, 40]}}
  upper_fork:
    block: {{from: [-50, {upper[0]:.3f}, 28], to: [0, {upper[1]:.3f}, 90]}}
  blind_bore:                     # opens towards +y
    cylinder: {{diameter: 20, height: 13}}
    turn: {{about: x, deg: 90}}
    move: [-23.5, {y_high + 1:.3f}, 4]
part:
  difference:
    - use: profile
    - use: beyond_the_arc
    - use: bevel_8
    - use: bevel_9
    - use: mouth
    - use: lower_fork
    - use: upper_fork
    - use: blind_bore
"""


def balanced(heights: Array, path: Path) -> None:
    """Write the solid whose centre of mass is the origin, by Newton's method over three cuts."""

    def centre(cuts: Array) -> Array:
        path.write_text(text_of(heights, *cuts.tolist()))
        return np.asarray(load_solid(path).centroid_mm)

    cuts = np.array([25.0, 25.0, 2.0])
    for _ in range(12):
        here = centre(cuts)
        if np.abs(here).max() < 5e-4:
            break
        slopes = np.column_stack([(centre(cuts + d) - here) / 0.1 for d in 0.1 * np.eye(3)])
        cuts = cuts - np.clip(np.linalg.solve(slopes, here), -4, 4)
    centre(np.round(cuts, 3))


def rows_of(solid: Solid) -> list[dict[str, Any]]:
    """Return each stable pose beside the row of the table with its rank."""
    poses = sorted(stable_poses(solid), key=lambda p: p.stability_rank)
    unit = poses[0].tip_energy_mj_per_kg / ENERGIES[0]
    return [
        {
            "view": p.stability_rank,
            "up": [round(float(v) + 0.0, 4) for v in p.R[2]],
            "paper_up": VIEWS[p.stability_rank - 1].tolist(),
            "energy": round(p.tip_energy_mj_per_kg / unit, 4),
            "paper_energy": float(ENERGIES[p.stability_rank - 1]),
            "mj_per_kg": round(p.tip_energy_mj_per_kg, 2),
        }
        for p in poses
    ]


def draw(solid: Solid, folder: Path) -> None:
    """Draw the nine views from straight above, three to a row, in the table's order."""
    size, scale = 230, 1.45
    sheet = np.full((3 * size, 3 * size), 255, np.uint8)
    for p in sorted(stable_poses(solid), key=lambda p: p.stability_rank):
        view = line_view(solid, p.R)
        row, column = divmod(p.stability_rank - 1, 3)
        lines = [e.points for e in view.edges]
        every = np.vstack(lines)
        middle = (every.min(axis=0) + every.max(axis=0)) / 2
        at = np.array([(column + 0.5) * size, (row + 0.5) * size])
        for line in lines:
            px = at + (line - middle) * [scale, -scale]
            cv2.polylines(sheet, [np.round(px * 16).astype(np.int32)], False, 0, 1, cv2.LINE_AA, 4)
        text_at = (column * size + 8, row * size + 22)
        cv2.putText(sheet, str(p.stability_rank), text_at, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 0, 1)
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(folder / "paper_widget.png"), sheet)


def photograph(solid: Solid, folder: Path) -> None:
    """Write a backlit picture of each view, by exact coverage, and the camera's file."""
    camera = overhead()
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {k: getattr(camera, k).tolist() for k in ("K", "distortion", "T_world_cam")}
    (folder / "camera.json").write_text(json.dumps({"size_px": list(camera.size_px), **arrays}))
    rng = np.random.default_rng(15)
    for p in stable_poses(solid):
        x, y, theta = rng.uniform([-15, -10, -np.pi], [15, 10, np.pi]).tolist()
        shape = silhouette(solid.mesh, resting(solid, p.R, x, y, theta), camera)
        path = folder / f"view_{p.stability_rank}.png"
        cv2.imwrite(str(path), picture([shape], seed=p.stability_rank))


def main() -> int:
    parser = Arguments(__doc__)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    cut, none = np.array([[0.0, 0.0, 1.0]]), np.zeros((0, 3))
    nine = solve(9, START, cut, np.array([TOP]))
    off_nine = climbs(np.vstack([DOWNS[:9], cut]), np.append(nine, TOP))[:9] / ENERGIES[:9] - 1
    eleven = solve(11, START_ELEVEN, none, np.zeros(0))
    off_eleven = climbs(DOWNS, eleven) / ENERGIES - 1
    if args.write:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / FILE.name
            balanced(nine * MM, path)
            FILE.write_text(path.read_text())
    solid = load_solid(FILE)
    if args.pictures:
        draw(solid, args.pictures)
    if args.table:
        photograph(solid, args.table)
    found = {
        "heights_of_nine": nine.round(4).tolist(),
        "residual_of_nine": float(np.abs(off_nine).max()),
        "heights_of_eleven": eleven.round(4).tolist(),
        "residual_of_eleven": float(np.abs(off_eleven).max()),
        "centre_mm": np.round(solid.centroid_mm, 4).tolist(),
    }
    show(args, rows_of(solid), found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
