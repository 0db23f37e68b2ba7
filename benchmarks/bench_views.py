"""Outlines against backlit pictures, and how long line drawings take.

python benchmarks/bench_views.py [--json] [--pictures [--overlays FOLDER] | --times [--growth-to N]]

The camera is calibrated from the chessboard pictures beside the others. Every known object of
every backlit picture is drawn at its true pose and compared with the picture, cut half-way
between the table's level there and the part's, eight samples to a pixel each way.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from shared_files import SHARED  # noqa: E402  (path set above)

from controller.cad import LineView, Solid, line_view, load_solid, outline, prepare_views  # noqa: E402
from controller.imaging import Camera  # noqa: E402

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FINE = 8  # samples to a pixel, each way
MARGIN_PX = 12  # neighbourhood of an object
LOCAL_PX = 4.0
WHITE = 255.0
MIN_UNSATURATED_PX = 3000
FALL_OFF = 0.1  # of the light at half the picture's width from its middle: the other pictures'
REPEATS = 7
TIMED = ("angle_block", "holder", "flange_xy", "featuretype", "cycloidal_gear", "nist_ftc06")


def calibrate(folder: Path) -> tuple[Camera, float]:
    """Return the camera in the world of ``calib.json``, and its reprojection error [px]."""
    board = json.loads((folder / "calib.json").read_text())
    columns, rows = board["inner_corners"]
    grid = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
    on_board = np.column_stack([grid, np.zeros(len(grid))]).astype(np.float32)
    on_board *= board["square_mm"]
    found, size = {}, (0, 0)
    for entry in board["images"]:
        picture = cv2.imread(str(folder / entry["image"]), cv2.IMREAD_GRAYSCALE)
        size = picture.shape[::-1]
        ok, corners = cv2.findChessboardCornersSB(
            picture, (columns, rows), flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
        )
        if ok:
            found[entry["image"]] = _as_told(picture, corners.reshape(rows, columns, 2))
    names = list(found)
    error, K, distortion, turns, shifts = cv2.calibrateCamera(
        [on_board] * len(names),
        [found[name].reshape(-1, 1, 2) for name in names],
        size,
        None,
        None,
        flags=cv2.CALIB_FIX_K3,
    )
    world = board["world"]
    at = names.index(world["image"])
    T_cam_board = np.eye(4)
    T_cam_board[:3, :3] = cv2.Rodrigues(turns[at])[0]
    T_cam_board[:3, 3] = shifts[at].ravel()
    angle = np.radians(world["x_axis_angle_deg"])
    T_world_board = np.eye(4)
    T_world_board[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T_world_board[:3, 3] = world["origin_mm"]
    T_world_cam = T_world_board @ np.linalg.inv(T_cam_board)
    return Camera((size[0], size[1]), K, distortion.ravel()[:5], T_world_cam), float(error)


def _as_told(picture: NDArray[np.uint8], corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return corners (rows, columns, 2) from the board's origin on, as calib.json has its frame."""
    right, down = corners[0, 1] - corners[0, 0], corners[1, 0] - corners[0, 0]
    if right[0] * down[1] - right[1] * down[0] > 0:  # Y is anticlockwise of X to the eye
        corners = corners[::-1]
    # the outer squares beside the corners of smallest X are the black ones
    near = 1.5 * corners[0, 0] - 0.5 * corners[1, 1]
    far = 1.5 * corners[0, -1] - 0.5 * corners[1, -2]
    near_level, far_level = (float(_level(picture, p)) for p in (near, far))
    return corners if near_level < far_level else corners[::-1, ::-1]


def _level(picture: NDArray[np.uint8], p: NDArray[np.float32]) -> float:
    x, y = np.round(p).astype(int)
    return float(picture[y - 2 : y + 3, x - 2 : x + 3].mean())


def filled(view: LineView, x0: int, y0: int, width: int, height: int) -> Bools:
    """Return the outline filled, at the centres of the fine samples of a region [px]."""
    p = np.concatenate([loop.points for loop in view.loops])
    q = np.concatenate([np.roll(loop.points, -1, axis=0) for loop in view.loops])
    # pixel (0, 0) has its centre there: fine sample j lies at (j + 0.5) / FINE - 0.5
    p, q = ((c - (x0, y0) + 0.5) * FINE - 0.5 for c in (p, q))
    low, high = np.minimum(p[:, 1], q[:, 1]), np.maximum(p[:, 1], q[:, 1])
    first = np.clip(np.ceil(low), 0, height * FINE).astype(int)
    count = np.clip(np.ceil(high), 0, height * FINE).astype(int) - first
    side = np.repeat(np.arange(len(p)), count)
    row = first[side] + np.arange(len(side)) - np.repeat(np.cumsum(count) - count, count)
    part = (row - p[side, 1]) / (q - p)[side, 1]
    column = np.ceil(p[side, 0] + part * (q - p)[side, 0])
    column = np.clip(column, 0, width * FINE).astype(int)
    turns = np.zeros((height * FINE, width * FINE + 1), dtype=np.int32)
    np.add.at(turns, (row, column), np.where(q[side, 1] > p[side, 1], 1, -1))
    return np.asarray(np.cumsum(turns, axis=1)[:, :-1] != 0)


def true_pose(solid: Solid, truth: dict[str, Any]) -> Array:
    """Return T_world_part as the pictures' README defines it."""
    c, s = np.cos(np.radians(truth["theta_deg"])), np.sin(np.radians(truth["theta_deg"]))
    upright = np.asarray(truth["stable_pose_R"])
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ upright
    lowest = float(((solid.mesh.vertices - solid.centroid_mm) @ upright[2]).min())
    T[:3, 3] = np.array([truth["x_mm"], truth["y_mm"], -lowest]) - T[:3, :3] @ solid.centroid_mm
    return T


def compare_pictures(folder: Path, overlays: Path | None) -> tuple[list[dict[str, Any]], float]:
    """Return a row for each known object in each backlit picture, and the board error [px]."""
    camera, error_px = calibrate(folder / "calib")
    truth = json.loads((folder / "truth.json").read_text())
    solids: dict[str, Any] = {}
    rows = []
    for entry in truth["images"]:
        known = [o for o in entry["objects"] if o["known"]]
        if entry["mode"] != "back" or len(known) < len(entry["objects"]):
            continue
        picture = cv2.imread(str(folder / entry["image"]), cv2.IMREAD_GRAYSCALE).astype(np.float64)
        views, masks = [], []
        for thing in known:
            if thing["part"] not in solids:
                solid = load_solid(SHARED / "parts" / f"{thing['part']}.stl")
                solids[thing["part"]] = (solid, prepare_views(solid))
            solid, prepared = solids[thing["part"]]
            pose = true_pose(solid, thing)
            view = outline(solid, pose, camera, prepared=prepared)
            views.append(view)
            masks.append(_coarse(view, picture.shape))
        table, is_measured = _table_level(picture, np.any(masks, axis=0))
        for k, (thing, view) in enumerate(zip(known, views, strict=True)):
            others = np.any(
                [m for j, m in enumerate(masks) if j != k] or [masks[k] & False], axis=0
            )
            row = _compare(picture, table, view, masks[k], others)
            name = f"{entry['image'].removesuffix('.png')}_{k}_{thing['part']}"
            if overlays is not None:
                cv2.imwrite(str(overlays / f"{name}.png"), row["overlay"])
            del row["overlay"]
            rows.append(
                {
                    "picture": entry["image"],
                    "part": thing["part"],
                    "level_measured": is_measured,
                    **row,
                }
            )
    return rows, error_px


def _coarse(view: LineView, shape: tuple[int, ...]) -> Bools:
    mask = np.zeros(shape, dtype=np.uint8)
    cv2.fillPoly(mask, [np.round(loop.points).astype(np.int32) for loop in view.loops], 1)
    return mask > 0


def _grown(mask: Bools, px: int) -> Bools:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * px + 1, 2 * px + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)


def _table_level(picture: Array, parts: Bools) -> tuple[Array, bool]:
    """Return the level (height, width) of the light table, also under parts and beyond white.

    Most of these pictures are white outside the part, and half of white is less than half of the
    table's light: cut there, an edge blurred over 2 px moves by 0.15 px. What the corners leave
    unsaturated gives the true level: even but for the lens's fall-off and a tilt. Answers False
    where there is none and the level is the lowest one that would saturate all of it.
    """
    height, width = picture.shape
    free = ~_grown(parts, 30) & ~_grown(picture < 150, 30)  # of strangers too
    free &= cv2.GaussianBlur(picture, (0, 0), 2) < WHITE - 3
    v, u = np.nonzero(free)
    v_all, u_all = np.mgrid[0:height, 0:width]
    if len(v) < MIN_UNSATURATED_PX:
        worst = float(np.hypot(width, height) / width) ** 2
        fall = 1 - FALL_OFF * _radius2(u_all, v_all, width, height)
        return WHITE / (1 - FALL_OFF * worst) * fall, False
    pick = slice(None, None, max(len(v) // 20000, 1))
    u, v = u[pick], v[pick]

    def terms(x: Array, y: Array) -> Array:
        across = (np.ones(x.shape), x / width, y / height, _radius2(x, y, width, height))
        return np.stack(across, axis=-1)

    weights, *_ = np.linalg.lstsq(terms(u, v), picture[v, u], rcond=None)
    return np.asarray(terms(u_all, v_all) @ weights), True


def _radius2(u: Array, v: Array, width: int, height: int) -> Array:
    return np.asarray(((u - width / 2) ** 2 + (v - height / 2) ** 2) / (width / 2) ** 2)


def _compare(
    picture: Array, table: Array, view: LineView, mask: Bools, others: Bools
) -> dict[str, Any]:
    v, u = np.nonzero(_grown(mask, MARGIN_PX))
    x0, x1, y0, y1 = u.min(), u.max() + 1, v.min(), v.max() + 1
    region = np.s_[y0:y1, x0:x1]
    # a wall that mirrors the table is not black: the part's level is the one beside the outline
    inner = (~_grown(~mask[region], 3)).astype(np.float64)
    weight = cv2.GaussianBlur(inner, (0, 0), LOCAL_PX) + 1e-6
    part_level = cv2.GaussianBlur(picture[region] * inner, (0, 0), LOCAL_PX) / weight
    half = (table[region] + part_level) / 2
    size = ((x1 - x0) * FINE, (y1 - y0) * FINE)
    dark = cv2.resize(picture[region] - half, size, interpolation=cv2.INTER_CUBIC) < 0
    near = _grown(mask, MARGIN_PX)[region] & ~_grown(others, MARGIN_PX // 2)[region]
    counted = cv2.resize(near.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    drawn = filled(view, int(x0), int(y0), int(x1 - x0), int(y1 - y0))
    seen, drawn = dark & counted, drawn & counted

    def iou(dx: int = 0, dy: int = 0) -> float:
        moved = np.roll(drawn, (dy, dx), axis=(0, 1))
        return float((seen & moved).sum() / (seen | moved).sum())

    shifts = {(dx, dy): iou(dx, dy) for dx in range(-2, 3, 2) for dy in range(-2, 3, 2)}
    best = max(shifts, key=lambda s: shifts[s])
    border_px = view.perimeter
    overlay = cv2.cvtColor(
        cv2.resize(picture[region], size, interpolation=cv2.INTER_CUBIC)
        .clip(0, 255)
        .astype(np.uint8),
        cv2.COLOR_GRAY2BGR,
    )
    overlay[drawn & ~seen] = (0, 0, 255)  # drawn, but bright in the picture
    overlay[seen & ~drawn] = (255, 160, 0)
    return {
        "iou": iou(),
        "iou_shifted": shifts[best],
        "shift_px": [best[0] / FINE, best[1] / FINE],
        "too_wide_px": float((drawn & ~seen).sum() - (seen & ~drawn).sum()) / FINE**2 / border_px,
        "part_level": float(part_level[mask[region]].max()),
        "overlay": overlay,
    }


def time_views(growth_to: int) -> list[dict[str, Any]]:
    """Return milliseconds of the steps for the shared parts, and for one part ever finer."""
    rows = []
    for name in TIMED:
        rows.append(_timed(load_solid(SHARED / "parts" / f"{name}.stl"), REPEATS))
    solid = load_solid(SHARED / "parts" / "holder.stl")
    while 4 * len(solid.mesh.faces) <= growth_to:
        solid = _finer(solid)
        rows.append(_timed(solid, 2))
    return rows


def _timed(solid: Solid, repeats: int) -> dict[str, Any]:
    begin = time.perf_counter()
    _ = solid.boundary
    boundary_s = time.perf_counter() - begin
    begin = time.perf_counter()
    prepared = prepare_views(solid)
    prepare_s = time.perf_counter() - begin
    took: dict[str, list[float]] = {"outline": [], "view": [], "cpu": []}
    rng = np.random.default_rng(3)
    for _ in range(repeats):
        q, _r = np.linalg.qr(rng.normal(size=(3, 3)))
        turn = q * np.sign(np.linalg.det(q))
        begin = time.perf_counter()
        outline(solid, turn, prepared=prepared)
        took["outline"].append(1e3 * (time.perf_counter() - begin))
        begin, begin_cpu = time.perf_counter(), time.process_time()
        line_view(solid, turn, prepared=prepared)
        took["view"].append(1e3 * (time.perf_counter() - begin))
        took["cpu"].append(1e3 * (time.process_time() - begin_cpu))
    return {
        "part": solid.name,
        "triangles": len(solid.mesh.faces),
        "boundary_ms": round(1e3 * boundary_s, 1),
        "prepare_ms": round(1e3 * prepare_s, 1),
        "outline_ms": round(float(np.median(took["outline"])), 1),
        "view_ms": round(float(np.median(took["view"])), 1),
        "view_cpu_ms": round(float(np.median(took["cpu"])), 1),
    }


def _finer(solid: Solid) -> Solid:
    """Return the same part with every triangle in four."""
    vertices, triangles, parts = trimesh.remesh.subdivide(
        solid.mesh.vertices, solid.mesh.faces, return_index=True
    )
    face_of_triangle = np.empty(len(triangles), dtype=np.int32)
    for old, new in parts.items():
        face_of_triangle[new] = solid.face_of_triangle[old]
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    return dataclasses.replace(solid, mesh=mesh, face_of_triangle=face_of_triangle)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--pictures", action="store_true", help="only the pictures")
    parser.add_argument("--times", action="store_true", help="only the times")
    parser.add_argument("--growth-to", type=int, default=400_000, help="triangles of one part")
    parser.add_argument("--overlays", type=Path, help="folder for pictures of what differs")
    args = parser.parse_args()
    if not (SHARED / "images").is_dir():
        print(f"needs the pictures in {SHARED / 'images'}", file=sys.stderr)
        return 2
    result: dict[str, Any] = {}
    if not args.times:
        rows, error_px = compare_pictures(SHARED / "images", args.overlays)
        ious = [row["iou"] for row in rows]
        result["pictures"] = rows
        result["board_error_px"] = error_px
        result["iou_median"], result["iou_worst"] = float(np.median(ious)), min(ious)
    if not args.pictures:
        result["times"] = time_views(args.growth_to)
    if args.json:
        print(json.dumps(result))
        return 0
    if not args.times:
        print(
            "picture       part                     IoU  shifted  shift px       too wide px  part"
        )
        for row in sorted(result["pictures"], key=lambda r: r["iou"]):
            x, y = row["shift_px"]
            print(
                f"{row['picture']:13} {row['part']:22} {row['iou']:.4f}   {row['iou_shifted']:.4f}"
                f"  {x:+.2f} {y:+.2f}  {row['too_wide_px']:+12.3f}  {row['part_level']:4.0f}"
                f"{'' if row['level_measured'] else '  all white: level unknown'}"
            )
        print(
            f"{len(result['pictures'])} objects: median {result['iou_median']:.4f}, worst "
            f"{result['iou_worst']:.4f}; boards fit to {result['board_error_px']:.3f} px"
        )
    if not args.pictures:
        print("part            triangles boundary ms prepare ms outline ms view ms (of a core)")
        for row in result["times"]:
            print(
                f"{row['part']:15} {row['triangles']:9} {row['boundary_ms']:11} "
                f"{row['prepare_ms']:10} {row['outline_ms']:10} {row['view_ms']:7} "
                f"({row['view_cpu_ms']})"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
