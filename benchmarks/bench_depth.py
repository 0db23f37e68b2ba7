"""Is the depth of blind holes, counterbores, slots and pockets measured within its uncertainty?

    python benchmarks/bench_depth.py [--parts drilled tray ...] [--seeds 2000 2001]
           [--surfaces machined plain] [--off 0 0.5 -0.5] [--sets FOLDER] [--json]

The emulated station takes eight views of a held part at 10 to 30 degrees to the axis of its
recesses and two along it, under ring lamp or ring and side lamp (`inspection_scenes.py`), 0.19 mm a
pixel. Grips and views are off as grippers and arms are. Every recess of a part is as deep as its
CAD model says, or 0.5 mm off; its other sizes and its place are off at random within general
tolerances. The truth is the body that was photographed. Seeds below 2000 are there to develop with.

Told are the number of depths, how many have a value, how many errors are within U (k = 2), medians
of error and U, and of wrong depths how many are called: a FAIL, or a value that no limit admits. A
good depth that fails counts against it. The exit code is 1 where less than 95 % of the errors are
within U, the median U is above 0.15 mm, a wrong depth passes or a good one fails.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import cv2
import numpy as np
from bench import Arguments, note, show
from bench_defects import as_mesh
from bench_machined_measuring import take_views
from inspection_scenes import Array, Held, Station, facing
from manifold3d import CrossSection, JoinType, Manifold

from controller.config.view_set import load_view_set
from controller.inspection import InspectionLimits, Kept
from controller.inspection.characteristics import Measured
from controller.inspection.characteristics.derive import derive
from controller.inspection.dimensions import measure
from controller.inspection.grasp_pose import PoseSettings
from controller.inspection.stages import pose_views
from controller.setup.characteristics import measuring_settings
from controller.stored import build_view_set, compiled_part, read_pictures

Body = Manifold
ROUND: Final = 96  # corners of a circle
TILTS_DEG: Final = (10.0, 13.0, 16.0, 19.0, 22.0, 25.0, 28.0, 30.0)
WRONG_MM: Final = 0.5
MAX_U_MM: Final = 0.15
MIN_INSIDE: Final = 0.95


@dataclass(frozen=True)
class Off:
    """How far the recesses of a part are off [mm]: depth, width, place (2,)."""

    depth: float = 0.0
    width: float = 0.0
    place: tuple[float, float] = (0.0, 0.0)


def hole(diameter: float, depth: float, at: tuple[float, float], top: float, off: Off) -> Body:
    """Return the hollow of a blind round hole."""
    deep = depth + off.depth
    radius = 0.5 * (diameter + off.width)
    x, y = at[0] + off.place[0], at[1] + off.place[1]
    return Body.cylinder(deep + 5, radius, radius, ROUND).translate((x, y, top - deep))


def drilled(off: Off) -> Body:
    """A block with four blind holes, one of them drilled with a tip."""
    body = Body.cube((64, 44, 22), True).translate((0, 0, 11))
    for diameter, depth, at in ((8.0, 6.0, (-20.0, 10.0)), (12.0, 10.0, (4.0, 8.0)),
                                (6.0, 4.0, (24.0, -10.0))):  # fmt: skip
        body -= hole(diameter, depth, at, 22, off)
    body -= hole(10.0, 7.0, (-14.0, -10.0), 22, off)
    tip = Body.cylinder(3.0, 0.0, 5.0 + off.width / 2, ROUND)
    x, y = -14.0 + off.place[0], -10.0 + off.place[1]
    return body - tip.translate((x, y, 22 - 7.0 - off.depth - 3.0))


def tray(off: Off) -> Body:
    """A plate with a pocket of round corners and a shallow rectangular one."""
    body = Body.cube((70, 46, 18), True).translate((0, 0, 9))
    x, y = off.place
    wide = CrossSection.square((26 + off.width - 8, 22 + off.width - 8), True)
    wide = wide.offset(4.0, JoinType.Round, 2.0, ROUND)
    body -= Body.extrude(wide, 12 + off.depth).translate((-14 + x, 2 + y, 18 - 7 - off.depth))
    small = Body.cube((14 + off.width, 18 + off.width, 20), True)
    return body - small.translate((18 + x, -4 + y, 18 - 3.5 - off.depth + 10))


def slotted(off: Off) -> Body:
    """A bar with two blind slots of round ends."""
    body = Body.cube((72, 36, 20), True).translate((0, 0, 10))
    for length, width, depth, at in (
        (22.0, 8.0, 5.0, (-16.0, 5.0)),
        (18.0, 10.0, 8.0, (17.0, -4.0)),
    ):
        half = 0.5 * (length - width)
        end = CrossSection.circle(0.5 * (width + off.width), ROUND)
        hull = CrossSection.batch_hull([end.translate((-half, 0)), end.translate((half, 0))])
        place = at[0] + off.place[0], at[1] + off.place[1], 20 - depth - off.depth
        body -= Body.extrude(hull, depth + 5).translate(place)
    return body


def sunk(off: Off) -> Body:
    """A disc with three counterbored holes."""
    body = Body.cylinder(16, 30, 30, 192)
    for turn in (20.0, 140.0, 260.0):
        x, y = 18 * np.cos(np.radians(turn)), 18 * np.sin(np.radians(turn))
        body -= Body.cylinder(40, 2.75, 2.75, ROUND, True).translate((x, y, 8))
        body -= hole(10.0, 5.5, (x, y), 16, off)
    return body


PARTS: Final[dict[str, Callable[[Off], Body]]] = {
    "drilled": drilled, "tray": tray, "slotted": slotted, "sunk": sunk
}  # fmt: skip


def ways_to_look(rng: np.random.Generator) -> Iterator[tuple[Array, bool]]:
    """Yield turns of the part: along its z twice, then tilted; every other one under both lamps."""
    along = facing(np.array([0.0, 0.0, 1.0]))
    for number, tilt in enumerate((0.0, 2.0, *TILTS_DEG)):
        turn = rng.uniform(0.0, 2 * np.pi)
        axis = np.array([np.cos(turn), np.sin(turn), 0.0]) * np.radians(tilt)
        yield along @ cv2.Rodrigues(axis)[0], number % 2 == 0


def take(name: str, off_mm: float, surfaces: str, seed: int, folder: Path) -> Path:
    """Write CAD file and pictures of a part; return its set."""
    path = folder / "SET.json"
    if path.is_file():
        return path
    folder.mkdir(parents=True, exist_ok=True)
    cad = folder / "part.stl"
    as_mesh(PARTS[name](Off())).export(cad)
    rng = np.random.default_rng(seed)
    off = Off(off_mm, rng.uniform(-0.15, 0.15), tuple(rng.uniform(-0.1, 0.1, 2)))
    body = as_mesh(PARTS[name](off))
    station = Station(body, finish_seed=seed if surfaces == "machined" else None)
    return take_views(cad, Held.load(cad), station, rng, seed, path, ways_to_look(rng))


def measured(path: Path) -> list[Measured]:
    """Return the depths of the part of a set."""
    file = load_view_set(path)
    part = compiled_part(path, file)
    views = build_view_set(file, part, read_pictures(path, file), InspectionLimits())
    deep = tuple(one for one in derive(part) if one.is_depth)
    posed = pose_views(views, PoseSettings()).known(Kept())
    return list(measure(views.part, deep, posed, measuring_settings(file.accuracy)))


def row_of(found: Measured, off_mm: float) -> dict[str, Any]:
    """Return one depth's error against the truth, with its uncertainty and its verdict."""
    value = found.measured_mm
    nominal = found.characteristic.nominal_mm
    return {
        "id": found.characteristic.id,
        "error_mm": None if value is None else value - nominal - off_mm,
        "U_mm": found.U_mm,
        "verdict": found.verdict.value,
        "reason": found.reason,
        "disputed": found.is_disputed,
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return rates over all depths."""
    known = [row for row in rows if row["error_mm"] is not None]
    error = np.array([abs(row["error_mm"]) for row in known])
    U = np.array([row["U_mm"] for row in known])
    wrong = [row for row in rows if row["off_mm"]]
    good = [row for row in rows if not row["off_mm"]]
    return {
        "depths": len(rows),
        "with_value": len(known),
        "inside_U": float((error <= U).mean()) if known else None,
        "median_error_mm": float(np.median(error)) if known else None,
        "median_U_mm": float(np.median(U)) if known else None,
        "disputed": sum(row["disputed"] for row in rows),
        "wrong": len(wrong),
        "wrong_failed": sum(row["verdict"] == "fail" for row in wrong),
        "wrong_passed": sum(row["verdict"] == "pass" for row in wrong),
        "good": len(good),
        "good_passed": sum(row["verdict"] == "pass" for row in good),
        "good_failed": sum(row["verdict"] == "fail" for row in good),
    }


def main() -> int:
    parser = Arguments(__doc__, parts=list(PARTS)[:1], seeds=[2000], surfaces=["plain"], off=[0.0])
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[2000, 2001])
    parser.add_argument("--surfaces", nargs="+", choices=("machined", "plain"),
                        default=["machined", "plain"])  # fmt: skip
    parser.add_argument("--off", nargs="+", type=float, default=[0.0, WRONG_MM, -WRONG_MM])
    parser.add_argument("--sets", type=Path, help="folder that keeps the pictures")
    args = parser.parse_args()
    rows = []
    keeper = nullcontext(args.sets) if args.sets else TemporaryDirectory(prefix="depth")
    with keeper as scratch:
        for name, surfaces, seed, off_mm in product(
            args.parts, args.surfaces, args.seeds, args.off
        ):
            folder = Path(scratch).resolve() / f"{name}-{surfaces}-{seed}-{off_mm:g}"
            for found in measured(take(name, off_mm, surfaces, seed, folder)):
                row = {"part": name, "surfaces": surfaces, "seed": seed, "off_mm": off_mm}
                rows.append(row | row_of(found, off_mm))
                note(rows[-1])
    told = summary(rows)
    show(args, rows, told)
    is_held = (
        (told["inside_U"] or 0.0) >= MIN_INSIDE
        and told["median_U_mm"] <= MAX_U_MM
        and not told["wrong_passed"]
        and not told["good_failed"]
    )
    return int(not is_held)


if __name__ == "__main__":
    sys.exit(main())
