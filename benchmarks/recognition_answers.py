"""What recognition answers, picture by picture, before and after a change; what each picture takes.

python benchmarks/recognition_answers.py --set FOLDER... --parts PATH... [--lights backlit front
    lo-backlit lo-front] [--save FILE] [--compare FILE] [--repeats 1] [--profile FILE] [--json]

For changes that are to make recognition quicker and its answers no others: run it with `--save` on
the code as it is, and with `--compare` on the code as it will be. Of every object name, stable
pose, alternatives and reason have to be the same, and numbers (place, turn, score, residual,
standard deviations) within 1e-5. The camera is the one in truth.json. Milliseconds are of the
processor, the least of the repeats, so that what others do on the machine counts little; the first
picture of a light, which reads what is kept of the parts, is recognised once more.

Pictures count by what lies there: one part of the library, one stranger, several. Names
are compared with the truth, poses are not (that does `bench_recognition.py`). Exit code 1 where an
answer differs.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit"), str(ROOT / "benchmarks")]

from bench_recognition import LIGHTING, LIGHTS  # noqa: E402  (path set above)
from recognition_parts import cad_files  # noqa: E402
from recognition_runs import from_truth, smaller  # noqa: E402

from controller.cad.compiled import CompileOptions  # noqa: E402
from controller.cli.inputs.calibration_file import load_calibration  # noqa: E402
from controller.imaging import Camera  # noqa: E402
from controller.recognition import Library, Recognition, Sighting, recognise  # noqa: E402
from controller.recognition.stored import open_library  # noqa: E402

SAME = 1e-5  # millimetres, radians and shares: sums in another order differ by less


def answer(s: Sighting) -> dict[str, Any]:
    """Return what was answered about one object: words that must be the same, and numbers."""
    others = [(other.part, other.pose_index) for other in s.ambiguous_with]
    words = [s.part, s.pose_index, others, list(s.box_px), s.reason, s.touching_count, s.is_cut]
    numbers = [s.x_mm, s.y_mm, s.theta_rad, s.score, s.free_share]
    numbers += [] if s.part is None else [s.residual_px, s.sigma_mm, s.sigma_rad]
    numbers += [other.theta_rad for other in s.ambiguous_with]
    return {"words": json.loads(json.dumps(words)), "numbers": numbers}


def apart(before: list[dict[str, Any]], now: list[dict[str, Any]]) -> float:
    """Return by how much the numbers of one picture's answers differ; inf where words do."""
    if [a["words"] for a in before] != [a["words"] for a in now]:
        return float("inf")
    pairs = zip(before, now, strict=True)
    gaps = [np.subtract(a["numbers"], b["numbers"]) for a, b in pairs if len(a["numbers"])]
    return float(max((np.abs(gap).max() for gap in gaps), default=0.0))


def kind_of(entry: dict[str, Any], names: set[str]) -> str:
    """Return "known", "stranger" or "several" by what truth.json says of a picture."""
    if len(entry["objects"]) != 1:
        return "several"
    return "known" if entry["objects"][0]["part"] in names else "stranger"


def named(seen: Recognition) -> list[str]:
    """Return the names of the parts that were seen, sorted."""
    return sorted(s.part for s in seen.sightings if s.part is not None)


def measure(
    folder: Path,
    lights: list[str],
    libraries: Libraries,
    repeats: int,
    most: int | None,
    profile: cProfile.Profile | None,
) -> dict[str, dict[str, Any]]:
    """Return answers, kind and milliseconds of each picture of a set, by set, light and name."""
    truth = json.loads((folder / "truth.json").read_text())
    out: dict[str, dict[str, Any]] = {}
    for light in lights:
        size, mode = LIGHTS[light]
        camera, library = libraries.of(folder, truth, size)
        names = {one.name for one in library.entries}
        entries = [e for e in truth["images"] if e["mode"] == mode][:most]
        for number, entry in enumerate(entries):
            file = (folder / "lo" if size == "lo" else folder) / entry["image"]
            picture = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
            if picture is None:
                continue
            if number == 0:
                recognise(picture, camera, library, LIGHTING[mode])
            took = []
            for _ in range(repeats):
                if profile is not None:
                    profile.enable()
                begin = time.process_time()
                seen = recognise(picture, camera, library, LIGHTING[mode])
                took.append(time.process_time() - begin)
                if profile is not None:
                    profile.disable()
            out[f"{folder.name} {light} {entry['image']}"] = {
                "light": light,
                "kind": kind_of(entry, names),
                "right": named(seen)
                == sorted(o["part"] for o in entry["objects"] if o["part"] in names),
                "ms": 1e3 * min(took),
                "answers": [answer(s) for s in seen.sightings],
            }
    return out


class Libraries:
    """The library of some parts for the cameras of sets, opened once for each camera."""

    def __init__(self, parts: list[Path], scratch: Path) -> None:
        self._files = [(path, CompileOptions()) for path in sorted(cad_files(parts).values())]
        self._scratch = scratch
        self._known: dict[str, tuple[Camera, Library]] = {}

    def of(self, folder: Path, truth: dict[str, Any], size: str) -> tuple[Camera, Library]:
        """Return the camera of a set's large ("hi") or small ("lo") pictures, and the library."""
        key = json.dumps([truth["camera"], size])
        if key not in self._known:
            file, how = from_truth(truth, self._scratch / f"{len(self._known)}_hi.json")
            if size == "lo":
                file, how = smaller(file, how, self._scratch / f"{len(self._known)}_lo.json")
            camera = load_calibration(file)
            self._known[key] = camera, open_library(self._files, camera)
        return self._known[key]


def summary(rows: dict[str, dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return median, 95 % and largest milliseconds by light and kind of picture."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows.values():
        groups.setdefault(f"{row['light']}, {row['kind']}", []).append(row)
    out = {}
    for name, of in sorted(groups.items()):
        ms = [row["ms"] for row in of]
        out[name] = {
            "pictures": len(of),
            "named_right": sum(row.get("right", False) for row in of),
            "median_ms": float(np.median(ms)),
            "p95_ms": float(np.percentile(ms, 95)),
            "worst_ms": max(ms),
        }
    return out


def main() -> int:
    """Measure, compare with what was saved, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", type=Path, nargs="+", required=True, help="folders of pictures")
    parser.add_argument("--parts", type=Path, nargs="+", required=True, help="CAD files")
    parser.add_argument("--lights", nargs="+", choices=tuple(LIGHTS), default=["backlit", "front"])
    parser.add_argument("--save", type=Path, help="keep the answers in this file")
    parser.add_argument("--compare", type=Path, help="with the answers kept in this file")
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--most", type=int, help="pictures of each set and light")
    parser.add_argument("--profile", type=Path, help="write cProfile's figures to this file")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    profile = cProfile.Profile() if args.profile else None
    rows: dict[str, dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        libraries = Libraries(args.parts, Path(scratch))
        for folder in args.set:
            rows |= measure(folder, args.lights, libraries, args.repeats, args.most, profile)
    if profile is not None:
        profile.dump_stats(args.profile)
    if args.save:
        args.save.write_text(json.dumps(rows, indent=1))
    before = json.loads(args.compare.read_text()) if args.compare else {}
    gaps = {
        name: apart(before[name]["answers"], rows[name]["answers"])
        for name in rows
        if name in before
    }
    differ = [name for name, gap in gaps.items() if gap > SAME]
    body = {
        "times": summary(rows),
        "before": summary({name: before[name] for name in rows if name in before}),
        "compared": len(gaps),
        "largest_difference": max((gap for gap in gaps.values() if gap <= SAME), default=0.0),
        "differ": differ,
    }
    if args.json:
        print(json.dumps(body))
        return 1 if differ else 0
    for name, row in body["times"].items():
        was = body["before"].get(name)
        ago = "" if was is None else f" (before {was['median_ms']:.0f})"
        print(
            f"{name}: {row['pictures']} pictures, {row['named_right']} with all names right, "
            f"median {row['median_ms']:.0f} ms{ago}, 95 % {row['p95_ms']:.0f} ms, "
            f"worst {row['worst_ms']:.0f} ms"
        )
    if args.compare:
        print(
            f"{body['compared']} pictures compared, {len(differ)} answered otherwise; numbers of "
            f"the others differ by {body['largest_difference']:.1e} at most"
        )
        for name in differ:
            print(f"  {name}: {gaps[name]:.2g}")
            for row in (before[name], rows[name]):
                print("   ", [(*a["words"], *np.round(a["numbers"], 4)) for a in row["answers"]])
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())
