"""Do stated uncertainties hold on machined surfaces, and do good parts still pass?

    python benchmarks/bench_machined_measuring.py [--parts flange_xy CAD...] [--seeds 1000 1001]
           [--kinds good "filled hole"] [--surfaces machined plain] [--sets FOLDER] [--jobs 1]
           [--json]

The emulated station takes 14 views of a held part (`inspection_scenes.py`): six square to it under
ring and side lamp, eight onto its corners under the ring, each before the panel as well. The grip
and each view are off as grippers and arms are. Marks, dust and oil film are drawn by the seed. The
set is judged as `cellctl inspect` judges it, by the part's recipe where there is one.

Of good parts every look and every value is held against the CAD model, which is the truth: how many
errors are within U (k = 2), how large the largest are, and what the verdict is. Parts with a defect
(a hole filled, too small, too large, out of place; the whole 1 mm too thick) must not pass. With
--sets, pictures are kept, and a second call judges the same ones. Seeds below 1000 are there to
develop with.

The exit code is 1 where the mean error of a kind of dimension of a part, five values at least, is
more than a fifth of their mean U, where a value is off by more than 2 U, or more than 5 % are off
by more than U.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from bench import ROOT, Arguments, note, show
from bench_defects import (
    Array,
    Body,
    as_body,
    as_mesh,
    bore_length,
    bore_moved,
    bore_small,
    bores,
    filled_hole,
    rod,
    thick,
)
from inspection_scenes import (
    HOLD_DEG,
    HOLD_MM,
    VIEW_DEG,
    VIEW_MM,
    Held,
    Station,
    disturbed,
    grasps,
    looks,
    rotation,
)

from controller.cell.devices.lamps import STATION_LAMPS, STATION_PANEL
from controller.cell.services.views.part_file import box_section, camera_section, pose_rows
from controller.config import load_recipe
from controller.config.view_set import SCHEMA, SetView, ViewSetFile, load_view_set
from controller.inspection import InspectionLimits
from controller.inspection.characteristics import CharacteristicKind
from controller.setup.optics import light_of
from controller.stored import Judging, compiled_part, judge_views, read_pictures

Words = dict[str, Any]
GOOD = "good"
FAR_MM = 0.3  # an error so large is printed with its picture
BIAS = 0.2  # of the mean U, that a mean error may be
MIN_VALUES = 5  # fewer have a mean by chance
MAX_BEYOND = 0.05  # of the values that may be beyond their U, as k = 2 has it


def bore_large(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """A bore 1 mm too large in diameter."""
    face = bores(held)[int(rng.integers(len(bores(held))))]
    # out of both mouths by a little, else a skin is left over them
    length_mm = bore_length(held, face) + 0.01
    return body - rod(face.axis, face.centre_mm, face.radius_mm + 0.5, length_mm)


DEFECTS: dict[str, Callable[[Held, Body, np.random.Generator], Body]] = {
    "filled hole": filled_hole,
    "bore 2 mm too small": bore_small,
    "bore 1 mm too large": bore_large,
    "bore moved 1 mm": bore_moved,
    "1 mm too thick": thick,
}


def cad_file(name: str) -> Path:
    """Return a part's CAD file, by its name in the recipes or by its path."""
    shipped = ROOT / "recipes" / "parts" / f"{name}.stl"
    if shipped.is_file():
        return shipped
    shipped = shipped.with_suffix("").with_suffix(".csg.yaml")
    return shipped if shipped.is_file() else Path(name).resolve()


def recipe_of(part: Path) -> Path | None:
    """Return the recipe that comes with a part, None where there is none."""
    path = ROOT / "recipes" / f"{part.name.split('.')[0]}.yaml"
    return path if path.is_file() and part.is_relative_to(ROOT / "recipes") else None


def take(part: Path, kind: str, surfaces: str, seed: int, folder: Path) -> Path | None:
    """Write the pictures of a part, and its set; None where the part has no place for a defect."""
    path = folder / "SET.json"
    if path.is_file():
        return path
    held = Held.load(part)
    body = held.solid.mesh
    # the same place for a defect, the same grip and the same views, whatever the surface
    rng = np.random.default_rng(seed)
    if kind != GOOD:
        if ("bore" in kind or "hole" in kind) and not bores(held):
            return None
        body = as_mesh(DEFECTS[kind](held, as_body(body), rng))
    finish_seed = seed if surfaces == "machined" else None
    return take_views(part, held, Station(body, finish_seed=finish_seed), rng, seed, path)


def take_views(
    part: Path,
    held: Held,
    station: Station,
    rng: np.random.Generator,
    seed: int,
    path: Path,
    ways_to_look: Iterable[tuple[Array, bool]] | None = None,
) -> Path:
    """Write the pictures of what the station holds, and the set that says it is the part.

    Parameters
    ----------
    part : the CAD file
    held : the part as its CAD file has it
    station : with the real one
    rng : draws grips and views
    seed : of the cameras' noise
    path : of the set
    ways_to_look : turns (3, 3) of the part, and whether both lamps are used; None for `looks`
    """
    folder = path.parent
    folder.mkdir(parents=True, exist_ok=True)
    centre, middle = held.solid.centroid_mm, station.layout.station_mm
    ways = grasps(held.solid)
    views: list[SetView] = []
    slips: dict[int, Array] = {}
    for number, (R, is_square) in enumerate(looks() if ways_to_look is None else ways_to_look):
        towards = np.array([0.0, -1.0, 0.0]) @ R
        which = int(np.argmin([-(towards @ way[0][:3, 0]) for way in ways]))
        if which not in slips:
            slips[which] = disturbed(np.eye(4), centre, HOLD_MM, HOLD_DEG, rng)
        T_part_tcp, opening_mm = ways[which]
        T = np.eye(4)
        T[:3, :3] = rotation(rng.normal(size=3), np.radians(rng.uniform(1.0, 6.0))) @ R
        T[:3, 3] = middle - T[:3, :3] @ centre
        true = disturbed(T @ slips[which], middle, VIEW_MM, VIEW_DEG, rng)
        T_tcp = T @ T_part_tcp
        lamps = STATION_LAMPS if is_square else STATION_LAMPS[:1]
        pictures = station.shoot(true, T_tcp, opening_mm, lamps, 100 * seed + number)
        view = f"v{number:02d}"
        task = station.task(view, T, T_tcp, opening_mm, lamps, InspectionLimits(), False)
        files = {}
        for lamp, picture in {STATION_PANEL: pictures.backlit, **pictures.lit}.items():
            files[lamp] = Path(f"{view}_{lamp}.png")
            cv2.imwrite(str(folder / files[lamp]), picture)
        boxes = tuple(map(box_section, task.holder))
        views.append(
            SetView(id=view, T_world_part=pose_rows(T), gripper_boxes=boxes, pictures=files,
                    grasp=which)
        )  # fmt: skip
    cell = station.cell
    lights = {n: light_of(cell.lamps[n], cell) for n in (STATION_PANEL, *STATION_LAMPS)}
    file = ViewSetFile(
        schema=SCHEMA, part=part, unit="mm",
        camera=camera_section(station.layout.inspection), lamps=lights, views=tuple(views),
        accuracy=cell.accuracy,
    )  # fmt: skip
    path.write_text(file.model_dump_json(by_alias=True, exclude_none=True))
    return path


def judged(part: Path, kind: str, surfaces: str, seed: int, path: Path) -> Words:
    """Return what became of a set: verdict, reasons, looks and values of good parts."""
    file = load_view_set(path)
    compiled = compiled_part(path, file)
    recipe_path = recipe_of(part)
    recipe = load_recipe(recipe_path) if recipe_path else None
    pictures = read_pictures(path, file)
    begun = time.process_time()
    got = judge_views(file, compiled, pictures, Judging(recipe, recipe_path or path, path))
    row: Words = {
        "part": part.name.split(".")[0], "kind": kind, "surfaces": surfaces, "seed": seed,
        "verdict": got.verdict.name, "measured": got.reasons and list(got.reasons)[:6],
        "compared": got.ledger.compared_fraction, "judge_s": time.process_time() - begun,
        "looks": [], "values": [],
    }  # fmt: skip
    for one in got.measured if kind == GOOD else ():
        asked = one.characteristic
        nominal = asked.nominal_mm
        unit = "rad" if asked.kind is CharacteristicKind.ANGLE else "mm"
        for look in one.looks:
            if not look.reason:
                row["looks"].append(
                    [asked.id, unit, look.view_id, look.lamp, look.measured_mm - nominal,
                     2.0 * look.u_mm]
                )  # fmt: skip
        if one.measured_mm is not None and one.U_mm is not None:
            row["values"].append(
                [asked.id, unit, one.verdict.name, one.measured_mm - nominal, one.U_mm, one.reason,
                 asked.kind.value]
            )  # fmt: skip
        else:
            row["values"].append(
                [asked.id, unit, one.verdict.name, None, None, one.reason, asked.kind.value]
            )
    return row


def run_one(case: tuple[Path, str, str, int, Path]) -> Words | None:
    """Return a row of the table, None where the part has no place for the defect."""
    part, kind, surfaces, seed, scratch = case
    folder = scratch / f"{part.name.split('.')[0]}-{kind.replace(' ', '_')}-{surfaces}-{seed}"
    path = take(part, kind, surfaces, seed, folder)
    return None if path is None else judged(part, kind, surfaces, seed, path)


def rows_of(args: argparse.Namespace, scratch: Path) -> Iterator[Words]:
    cases = [
        (cad_file(name), kind, surfaces, seed, scratch)
        for name in args.parts
        for kind in args.kinds
        for surfaces in args.surfaces
        for seed in args.seeds
    ]
    if args.jobs == 1:
        found = map(run_one, cases)
        yield from (row for row in found if row is not None)
        return
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        yield from (row for row in pool.map(run_one, cases) if row is not None)


def within(pairs: list[tuple[float, float]]) -> Words:
    """Return how many errors are within U, and how large they are."""
    if not pairs:
        return {"count": 0}
    off, U = np.abs(np.array(pairs)).T
    ratio = off / U
    return {
        "count": len(pairs), "within": float((ratio <= 1).mean()),
        "beyond": int((ratio > 1).sum()), "error_median": float(np.median(off)),
        "error_largest": float(off.max()), "ratio_largest": float(ratio.max()),
        "U_median": float(np.median(U)),
    }  # fmt: skip


def biases(good: list[Words]) -> list[Words]:
    """Return the mean error of each kind of dimension, part by part, and whether it is small."""
    of: dict[tuple[str, str], list[tuple[float, float]]] = {}
    # the values of one piece share its pose: only those of several have a mean error
    of_several = {row["part"] for row in good if sum(r["part"] == row["part"] for r in good) > 1}
    for row in (row for row in good if row["part"] in of_several):
        for _, unit, _, error, U, _, kind in row["values"]:
            if unit == "mm" and error is not None and kind != CharacteristicKind.POSITION.value:
                of.setdefault((row["part"], kind), []).append((error, U))
    out = []
    for (part, kind), pairs in of.items():
        mean, U = np.mean(pairs, axis=0)
        if len(pairs) >= MIN_VALUES:
            out.append(
                {"part": part, "kind": kind, "count": len(pairs), "mean_error": float(mean),
                 "mean_U": float(U), "is_small": bool(abs(mean) <= BIAS * U)}
            )  # fmt: skip
    return out


def is_held(share: Words) -> bool:
    """Return whether values and their mean errors are as U says."""
    values = share["values"]
    return all(one["is_small"] for one in share["bias"]) and (
        not values["count"]
        or (values["within"] >= 1 - MAX_BEYOND and values["ratio_largest"] <= 2.0)
    )


def summary(rows: list[Words], surfaces: str) -> Words:
    """Return the shares for one kind of surface."""
    mine = [row for row in rows if row["surfaces"] == surfaces]
    good = [row for row in mine if row["kind"] == GOOD]
    values = [v for row in good for v in row["values"]]
    found = [v for row in good for v in row["looks"] if v[1] == "mm"]
    return {
        "surfaces": surfaces,
        "looks": within([(v[4], v[5]) for v in found]),
        "looks_lit": within([(v[4], v[5]) for v in found if v[3] != "backlit"]),
        "values": within([(v[3], v[4]) for v in values if v[1] == "mm" and v[3] is not None]),
        "bias": biases(good),
        "characteristics": dict(Counter(v[2] for v in values)),
        "good": dict(Counter(row["verdict"] for row in good)),
        "defects": {
            kind: dict(Counter(row["verdict"] for row in mine if row["kind"] == kind))
            for kind in DEFECTS
            if any(row["kind"] == kind for row in mine)
        },
        "compared": float(np.mean([row["compared"] for row in good])) if good else None,
        "judge_s": float(np.mean([row["judge_s"] for row in mine])) if mine else None,
    }


def main() -> int:
    """Print the tables."""
    parser = Arguments(__doc__, parts=["flange_xy"], seeds=[1000], kinds=[GOOD], surfaces=["plain"])
    parser.add_argument("--parts", nargs="+", default=["flange_xy"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1000, 1001])
    parser.add_argument("--kinds", nargs="+", choices=[GOOD, *DEFECTS], default=[GOOD, *DEFECTS])
    parser.add_argument("--surfaces", nargs="+", default=["machined", "plain"])
    parser.add_argument("--sets", type=Path, help="folder that keeps the pictures")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    rows = []
    keeper = nullcontext(args.sets) if args.sets else TemporaryDirectory(prefix="machined")
    with keeper as scratch:
        for row in rows_of(args, Path(scratch).resolve()):
            rows.append(row)
            note({key: value for key, value in row.items() if key not in ("looks", "values")})
    shares = [summary(rows, surfaces) for surfaces in args.surfaces]
    show(args, [told(row) for row in rows], {share["surfaces"]: share for share in shares})
    return 0 if all(map(is_held, shares)) else 1


def told(row: Words) -> Words:
    """Return one part as a table has it, with the looks and values that are beyond their U."""
    values = [v for v in row["values"] if v[3] is not None and v[1] == "mm"]
    looks = [v for v in row["looks"] if v[1] == "mm"]
    return {key: row[key] for key in ("part", "kind", "surfaces", "seed", "verdict")} | {
        "compared": row["compared"],
        "judge s": row["judge_s"],
        "looks": len(looks),
        "beyond U": sum(abs(v[4]) > v[5] for v in looks),
        "values": len(values),
        "values beyond U": [
            f"{v[0]} {v[3]:+.3f}, U {v[4]:.3f}" for v in values if abs(v[3]) > v[4]
        ],
    }


if __name__ == "__main__":
    sys.exit(main())
