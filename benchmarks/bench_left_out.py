"""Parts with one wrong feature, judged with every face left out by name: does any of them pass?

    python benchmarks/bench_left_out.py [--cases "pocket depth" ...] [--seeds 1] [--good]
           [--sets FOLDER] [--json]

Leaving a face out takes away the duty to compare it, never the power of the pictures to speak
against it. Each part has a pocket, slot, keyway, cross hole or counterbore whose depth, width or
place is off by three times the expanded uncertainty that the cell states for it. 14 views of the
emulated station, as in `bench_machined_measuring`; judged as `cellctl inspect` judges them, by
three recipes: one names no face ("none"), one every face under `not_inspected` ("all"), and one
does that and asks for no dimension without limits of its own ("lax"). Views that were not evaluated
are taken out, so that they stop no PASS. Of the good parts told is what they come to; with --good
only these are judged.
"""

import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from bench import Arguments, note, show
from bench_defects import as_mesh
from bench_machined_measuring import take_views
from inspection_scenes import Held, Station
from manifold3d import CrossSection, Manifold

from controller.config import load_recipe
from controller.config.view_set import load_view_set
from controller.inspection import Kept
from controller.stored import Judging, compiled_part, judge_views, read_pictures

Body = Manifold
HOW: Final = ("none", "all", "lax")
ROUND: Final = 96  # corners of a circle


@dataclass(frozen=True)
class Off:
    """How far one feature is off its nominal size [mm]."""

    depth: float = 0.0
    width: float = 0.0
    place: float = 0.0


def bracket(off: Off) -> Body:
    """An angle with a pocket in its foot, 5 mm deep."""
    body = box((60, 40, 12), (0, 0, 6)) + box((10, 40, 36), (-25, 0, 18))
    depth = 5.0 + off.depth
    pocket = box((22 + off.width, 16, depth + 1), (8 + off.place, 2, 12 - depth / 2 + 0.5))
    return body - pocket


def slotted(off: Off) -> Body:
    """A plate with an obround slot through it."""
    return box((60, 40, 10), (0, 0, 5)) - obround(20.0, 8.0 + off.width, 12.0, (4, off.place, 4))


def blind_slot(off: Off) -> Body:
    """A block with an obround slot of 4 mm depth."""
    depth = 4.0 + off.depth
    return box((56, 36, 16), (0, 0, 8)) - obround(18.0, 8.0, depth + 1.0, (-3, 4, 16.5 - depth / 2))


def keyed(off: Off) -> Body:
    """A hub whose bore has a keyway."""
    hub = rod(22, 20) - rod(9, 24)
    top = 11.8 + off.depth
    return hub - box((5.0 + off.width, top, 24), (off.place, top / 2, 0))


def turned_key(off: Off) -> Body:
    """The same with its keyway where no finger covers it."""
    return keyed(off).rotate((0, 0, 100))


def collar(off: Off) -> Body:
    """A collar with a cross hole in its turned face."""
    hole = rod(2.5 + off.width / 2, 30).rotate((0, 90, 0)).translate((18, 0, off.place))
    return rod(18, 24) - rod(8, 30) - hole


def counterbored(off: Off) -> Body:
    """A block with a counterbored hole."""
    depth = 6.0 + off.depth
    sink = rod(6 + off.width / 2, depth + 1).translate((5 + off.place, -3, 16.5 - depth / 2))
    return box((54, 38, 16), (0, 0, 8)) - rod(3.3, 40).translate((5, -3, 8)) - sink


def box(size: tuple[float, float, float], at: tuple[float, float, float]) -> Body:
    return Body.cube(size, True).translate(at)


def rod(radius: float, length: float) -> Body:
    return Body.cylinder(length, radius, radius, ROUND, True)


def obround(length: float, width: float, depth: float, at: tuple[float, float, float]) -> Body:
    """Return a slot's hollow: its length over its round ends, along x."""
    half = (length - width) / 2
    end = CrossSection.circle(width / 2, ROUND)
    outline = CrossSection.batch_hull([end.translate((-half, 0)), end.translate((half, 0))])
    return Body.extrude(outline, depth).translate((at[0], at[1], at[2] - depth / 2))


PARTS: Final[dict[str, Callable[[Off], Body]]] = {
    "bracket": bracket,
    "slotted plate": slotted,
    "blind slot": blind_slot,
    "keyed hub": keyed,
    "turned key": turned_key,
    "collar": collar,
    "counterbored": counterbored,
}
CASES: Final[dict[str, tuple[str, Off]]] = {
    "pocket depth": ("bracket", Off(depth=-1.0)),
    "pocket width": ("bracket", Off(width=0.5)),
    "pocket place": ("bracket", Off(place=0.5)),
    "slot width": ("slotted plate", Off(width=-0.5)),
    "slot place": ("slotted plate", Off(place=0.5)),
    "blind slot depth": ("blind slot", Off(depth=-1.0)),
    "keyway width": ("keyed hub", Off(width=0.6)),
    "keyway depth": ("keyed hub", Off(depth=-0.8)),
    "turned key width": ("turned key", Off(width=0.6)),
    "turned key depth": ("turned key", Off(depth=-0.8)),
    "cross hole place": ("collar", Off(place=0.8)),
    "cross hole diameter": ("collar", Off(width=0.6)),
    "counterbore depth": ("counterbored", Off(depth=-1.0)),
    "counterbore diameter": ("counterbored", Off(width=0.6)),
    "counterbore place": ("counterbored", Off(place=0.6)),
}


def take(name: str, off: Off, seed: int, folder: Path) -> Path:
    """Write CAD file and pictures of a part that is off; return its set."""
    path = folder / "SET.json"
    if path.is_file():
        return path
    folder.mkdir(parents=True, exist_ok=True)
    cad = folder / "part.stl"
    as_mesh(PARTS[name](Off())).export(cad)
    station = Station(as_mesh(PARTS[name](off)))
    return take_views(cad, Held.load(cad), station, np.random.default_rng(seed), seed, path)


def judged(path: Path) -> dict[str, Any]:
    """Return what a set comes to with no face left out, and with all of them."""
    file = load_view_set(path)
    compiled = compiled_part(path, file)
    pictures = read_pictures(path, file)
    kept = Kept()
    recipe = write_recipe(path.parent / "none.yaml", "all", "")
    first = judge_views(file, compiled, pictures, Judging(load_recipe(recipe), recipe, path), kept)
    failed = {view.view_id for view in first.views if not view.evaluated}
    if failed:
        kept = Kept()
        file = file.model_copy(
            update={"views": tuple(view for view in file.views if view.id not in failed)}
        )
        pictures = {view: shots for view, shots in pictures.items() if view not in failed}
    names = "".join(f"    {face.label}: gauged by hand\n" for face in compiled.solid.faces)
    row: dict[str, Any] = {}
    every = f"  not_inspected:\n{names}"
    asked = {"none": ("all", ""), "all": ("all", every), "lax": ("stated", every)}
    for how, (required, left_out) in asked.items():
        recipe = write_recipe(path.parent / f"{how}.yaml", required, left_out)
        got = judge_views(
            file, compiled, pictures, Judging(load_recipe(recipe), recipe, path), kept
        )
        row[how] = {
            "verdict": got.verdict.value,
            "surfaces": got.ledger.verdict.value,
            "reasons": list(got.reasons),
            "findings": len(got.findings),
            "against": [
                f"{one.characteristic.label}: {one.measured_mm:.3f}, U {one.U_mm or 0:.3f}"
                for one in got.measured
                if one.measured_mm is not None and one.verdict.value == "fail"
            ],
            "short": [f.label for f in got.ledger.faces if f.face_id in got.ledger.short_faces],
        }
    return row


def write_recipe(path: Path, required: str, left_out: str) -> Path:
    """Write a recipe of the part beside it; return its path."""
    section = f"inspection:\n  min_coverage: 0.2\n  required: {required}\n{left_out}"
    path.write_text(f"name: part\npart: part.stl\nunit: mm\n{section}")
    return path


def main() -> int:
    parser = Arguments(__doc__, cases=list(CASES)[:1])
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--good", action="store_true", help="judge good parts alone")
    parser.add_argument("--sets", type=Path, help="folder that keeps the pictures")
    args = parser.parse_args()
    wrong = [] if args.good else [(case, *CASES[case]) for case in args.cases]
    good = [("good", name, Off()) for name in dict.fromkeys(CASES[c][0] for c in args.cases)]
    rows = []
    keeper = nullcontext(args.sets) if args.sets else TemporaryDirectory(prefix="left_out")
    with keeper as scratch:
        for case, name, off in (*good, *wrong):
            for seed in args.seeds:
                folder = Path(scratch).resolve() / f"{name}-{case}-{seed}".replace(" ", "_")
                row: dict[str, Any] = {"part": name, "case": case, "seed": seed}
                for how, told in judged(take(name, off, seed, folder)).items():
                    row |= {f"{how} {key}": value for key, value in told.items()}
                rows.append(row)
                note(row)
    bad = [row for row in rows if row["case"] != "good"]
    fine = [row for row in rows if row["case"] == "good"]
    summary = {
        "wrong": len(bad),
        "wrong_passed_lax": sum(row["lax verdict"] == "pass" for row in bad),
        "wrong_passed": sum(row["all verdict"] == "pass" for row in bad),
        "good_failed": sum(row[f"{how} verdict"] == "fail" for row in fine for how in HOW),
        "good_passed": sum(row["all verdict"] == "pass" for row in fine),
    }
    show(args, rows, summary)
    return int(bool(summary["wrong_passed"] or summary["good_failed"]))


if __name__ == "__main__":
    sys.exit(main())
