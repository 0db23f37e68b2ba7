"""How right, how exact and how quick recognition is, on pictures that this project did not make.

python benchmarks/bench_recognition.py [--json] [--set FOLDER...] [--parts PATH...]
    [--lights backlit front lo-backlit lo-front] [--keep FOLDER] [--checkout FOLDER] [--lamps 3]
    [--without PART...]

Drives `cellctl recognise` as its users do, a process for the pictures of one light, held to one
core. A set is a folder with pictures, truth.json, and perhaps lo/ (256 x 256) and calib/ (boards).
What counts as right: `recognition_judge`. Every fourth picture is aside, and told apart. Where a
set of parts that touch, lie on one another or leave the picture tells what of each outline is free
(`trace_pictures.py --scene`), those of which less than 70 % is are told apart, too. With `--lamps
N` the front-lit pictures of a set that `trace_pictures.py --lamps N` made are judged N together,
and the truth of a scene's first picture counts. What --without names is left out of the library, so
that it is a stranger. A false name is a known part's name for another part, for a stranger or for
nothing. The time of a picture is the sum of its answers' "seconds".
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from bench import ROOT, SHARED, Arguments, leave_out, note, show
from known_parts import cad_files, read_mesh
from recognition_judge import (
    Judge,
    Thing,
    Verdict,
    confusion,
    failures,
    figures,
    read_answer,
    read_things,
    reliability,
)
from recognition_runs import (
    Run,
    calibrate,
    from_truth,
    recognise_command,
    run,
    smaller,
    stable_poses,
)
from recognition_symmetry import Surface

LIGHTS = {
    "backlit": ("hi", "back"),
    "front": ("hi", "front"),
    "lo-backlit": ("lo", "back"),
    "lo-front": ("lo", "front"),
}
LIGHTING = {"back": "backlit", "front": "front"}
# least share of right poses: issued with the first pictures, by what they show
RIGHT_POSE = {"backlit": 0.98, "front": 0.97, "lo-backlit": 0.93, "lo-front": 0.93}
FREE = 0.7  # of its outline, from which a part is asked by name
EXACT_MM = {"back": 0.1, "front": 0.3}
FALSE = ("wrong part", "named", "spurious")


@dataclass(frozen=True, eq=False, slots=True)
class Pictures:
    """A set of pictures with what lies in them, the cameras and the parts that may turn up."""

    name: str
    folder: Path
    truth: dict[str, Any]
    things: list[Thing]
    cameras: dict[str, tuple[Path, str]]
    parts: list[Path]

    def of(self, light: str, *, kinds: tuple[str, ...] | None = None) -> list[Path]:
        """Return the pictures of a light, or those of some kinds among them."""
        size, mode = LIGHTS[light]
        folder = self.folder / "lo" if size == "lo" else self.folder
        names = [
            entry["image"]
            for entry in self.truth["images"]
            if entry["mode"] == mode and (kinds is None or entry["kind"] in kinds)
        ]
        return [folder / name for name in names if (folder / name).is_file()]


def read_set(folder: Path, args: argparse.Namespace, scratch: Path) -> Pictures:
    truth = json.loads((folder / "truth.json").read_text())
    parts = args.parts or ([folder / "parts"] if (folder / "parts").is_dir() else [])
    cameras: dict[str, tuple[Path, str]] = {}
    if args.calibration is None or args.lo_calibration is None:
        into = scratch / folder.name
        into.mkdir()
        boards = folder / "calib"
        if not (boards / "calib.json").is_file() and _is_shared_camera(truth):
            boards = SHARED / "images" / "calib"
        if (boards / "calib.json").is_file():
            cameras = calibrate(boards, into)
        else:
            cameras["hi"] = from_truth(truth, into / "hi.json")
            cameras["lo"] = smaller(*cameras["hi"], into / "lo.json")
    for size, file in (("hi", args.calibration), ("lo", args.lo_calibration)):
        if file is not None:
            cameras[size] = (file.resolve(), "file given")
    name = folder.name if folder != SHARED / "images" else "shared"
    things = read_things(truth)
    return Pictures(name, folder, truth, things, cameras, parts or [SHARED / "parts"])


def without(pictures: Pictures, names: Sequence[str]) -> Pictures:
    """Return a set of which some parts are in no library."""
    if not names:
        return pictures
    things = [replace(t, is_known=t.is_known and t.part not in names) for t in pictures.things]
    parts = [file for name, file in cad_files(pictures.parts).items() if name not in names]
    return replace(pictures, things=things, parts=parts)


def _is_shared_camera(truth: dict[str, Any]) -> bool:
    """Say whether pictures were made with the camera of the shared ones, which has boards."""
    file = SHARED / "images" / "truth.json"
    return file.is_file() and json.loads(file.read_text())["camera"] == truth["camera"]


def surfaces(parts: Sequence[Path]) -> Callable[[str], Surface]:
    """Return the surface of a part by its name, measured once."""
    files = cad_files(parts)
    known: dict[str, Surface] = {}

    def surface_of(name: str) -> Surface:
        if name not in known:
            known[name] = Surface(read_mesh(files[name]))
        return known[name]

    return surface_of


class Bench:
    """Runs recognisers over a set's pictures, one light at a time, and judges their answers."""

    def __init__(self, pictures: Pictures, args: argparse.Namespace, checkout: Path) -> None:
        self.pictures, self._args, self.checkout = pictures, args, checkout
        self._judge = Judge(surfaces(pictures.parts))
        self._poses: dict[str, list[np.ndarray]] | None = None

    def _pose(self, part: str, index: int) -> np.ndarray | None:
        if self._poses is None:
            self._poses = stable_poses(self.pictures.parts, self.checkout)
        poses = self._poses.get(part, [])
        return poses[index] if 0 <= index < len(poses) else None

    def answers(self, light: str, images: Sequence[Path]) -> Run:
        size, mode = LIGHTS[light]
        camera = self.pictures.cameras[size][0]
        command = recognise_command(images, self.pictures.parts, camera, LIGHTING[mode])
        if self.lamps(light) > 1:
            command += ["--lamps", str(self.lamps(light))]
        return run(command, one_core=not self._args.all_cores, checkout=self.checkout)

    def lamps(self, light: str) -> int:
        """Return how many pictures of a light show one scene."""
        return int(self._args.lamps) if LIGHTS[light][1] == "front" else 1

    def judge(self, told: Run, images: Sequence[Path]) -> list[Verdict]:
        names = {image.name for image in images}
        answers = [read_answer(line, self._pose) for line in told.lines]
        return self._judge.judge([t for t in self.pictures.things if t.image in names], answers)

    def milliseconds(self, told: Run, images: Sequence[Path]) -> list[float]:
        """Return what each picture took, the sum of its answers' seconds."""
        by_picture: dict[str, float] = {image.name: 0.0 for image in images}
        for line in told.lines:
            by_picture[line["image"]] += 1e3 * float(line.get("seconds") or 0.0)
        return list(by_picture.values())

    def keep(self, light: str, told: Run) -> None:
        if self._args.keep is not None:
            self._args.keep.mkdir(parents=True, exist_ok=True)
            file = self._args.keep / f"{self.pictures.name}_{light}.jsonl"
            file.write_text("".join(json.dumps(line) + "\n" for line in told.lines))


def is_held_out(image: str) -> bool:
    """Say whether a picture is one of those aside: every fourth, from the third on."""
    return int("".join(c for c in Path(image).stem if c.isdigit()) or 0) % 4 == 3


Place = tuple[str, float, float]


def places(truth: dict[str, Any], keys: str) -> dict[Place, Any]:
    """Return what a set tells of each object under a key, by its picture and place."""
    return {
        (entry["image"], o["x_mm"], o["y_mm"]): o[keys]
        for entry in truth["images"]
        for o in entry["objects"]
        if o.get(keys) is not None
    }


def groups(found: Sequence[Verdict], truth: dict[str, Any]) -> dict[str, list[Verdict]]:
    """Return the verdicts to be told apart: all, those aside, and by how free an outline is."""
    free, lying = places(truth, "free_share"), places(truth, "lies_on")

    def place(v: Verdict) -> Place | None:
        return None if v.thing is None else (v.thing.image, v.thing.x_mm, v.thing.y_mm)

    of_objects = [v for v in found if v.thing is not None]
    aside = [is_held_out((v.thing or v.answer).image) for v in found]  # type: ignore[union-attr]
    seen = [v for v in of_objects if free.get(place(v), 1.0) >= FREE]  # type: ignore[arg-type]
    told = {"all": list(found), "held out": [v for v, out in zip(found, aside, strict=True) if out]}
    if free:
        told |= {
            "70 % free, on the table": [v for v in seen if place(v) not in lying],
            "70 % free, on other parts": [v for v in seen if place(v) in lying],
            "less free": [v for v in of_objects if v not in seen],
        }
    return told


def row_of(found: Sequence[Verdict], exact_mm: float) -> dict[str, Any]:
    """Return what some verdicts come to."""
    f = figures(found)
    off = [v.distance_mm for v in found if v.with_alternatives == "right"]
    exact = sum(mm is not None and mm <= exact_mm for mm in off)
    of_mm, of_deg = f["position_mm"] or {}, f["angle_asymmetric_deg"] or {}
    return {
        "objects": f["objects"],
        "right part": f["right_part"],
        "right pose": f["right_pose"],
        "alternatives count": f["right_pose_with_alternatives"],
        f"within {exact_mm} mm": exact / f["objects"] if f["objects"] else None,
        "mm": of_mm.get("median"),
        "p95 mm": of_mm.get("p95"),
        "deg": of_deg.get("median"),
        "p95 deg": of_deg.get("p95"),
        "strangers": f["strangers"],
        "refused": f["unknown_called_unknown"],
        "false names": sum(v.kind in FALSE for v in found),
        "wrong poses": sum(v.kind == "wrong pose" for v in found),
    }


def measure(bench: Bench, args: argparse.Namespace) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Return a set's rows, one for each light and group, and what is behind them."""
    rows: list[dict[str, Any]] = []
    behind: dict[str, Any] = {}
    for light in args.lights:
        images = bench.pictures.of(light)
        if not images or LIGHTS[light][0] not in bench.pictures.cameras:
            continue
        told = bench.answers(light, images)
        bench.keep(light, told)
        scenes = images[:: bench.lamps(light)]
        found = bench.judge(told, scenes)
        took_ms = bench.milliseconds(told, scenes)
        for group, mine in groups(found, bench.pictures.truth).items():
            row = {"set": bench.pictures.name, "light": light, "group": group}
            rows.append(row | row_of(mine, EXACT_MM[LIGHTS[light][1]]))
            if group == "all":
                low, high = np.percentile(took_ms, [50, 95]).tolist()
                rows[-1] |= {"ms": low, "p95 ms": high, "peak MB": told.peak_mb}
            note(rows[-1])
        behind[f"{bench.pictures.name}, {light}"] = {
            "error": told.error,
            "confusion": confusion(found),
            "reliability": reliability(found),
            "failures": failures(found),
        }
    return rows, behind


def main() -> int:
    args = read_arguments()
    folders = args.set or [SHARED / "images"]
    for folder in folders:
        if not (folder / "truth.json").is_file():
            leave_out(f"needs pictures and their truth.json in {folder} (trace_pictures.py)")
    checkout = (args.checkout or ROOT).resolve()
    rows: list[dict[str, Any]] = []
    behind: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="bench_recognition_") as scratch_name:
        for folder in folders:
            pictures = read_set(folder.resolve(), args, Path(scratch_name))
            bench = Bench(without(pictures, args.without), args, checkout)
            told, why = measure(bench, args)
            rows += told
            behind |= why
    every = [row for row in rows if row["group"] == "all"]
    misses = [
        f"{row['set']}, {row['light']}: right pose"
        for row in every
        if row["right pose"] is not None and row["right pose"] < RIGHT_POSE[row["light"]]
    ]
    false_names = sum(row["false names"] for row in every)
    shown = behind if args.json else {key: len(of["failures"]) for key, of in behind.items()}
    show(args, rows, {"failures": shown, "below what is asked": misses, "false names": false_names})
    return int(bool(misses or false_names))


def read_arguments() -> argparse.Namespace:
    parser = Arguments(__doc__, lights=["lo-backlit"])
    parser.add_argument("--set", type=Path, nargs="+", help="folders with pictures and truth.json")
    parser.add_argument("--parts", type=lambda p: Path(p).resolve(), nargs="+", help="CAD files")
    parser.add_argument("--calibration", type=Path, help="camera; by the set's boards otherwise")
    parser.add_argument("--lo-calibration", type=Path, help="camera of the small pictures")
    parser.add_argument("--lights", nargs="+", choices=tuple(LIGHTS), default=list(LIGHTS))
    parser.add_argument("--keep", type=Path, help="folder for the answers themselves")
    parser.add_argument("--lamps", type=int, default=1, help="front-lit pictures of one scene")
    parser.add_argument("--without", nargs="+", default=[], help="parts no library has")
    parser.add_argument("--all-cores", action="store_true", help="instead of one")
    parser.add_argument("--checkout", type=Path, help="whose cellctl is run; this one otherwise")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
