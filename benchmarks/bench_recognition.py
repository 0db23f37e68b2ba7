"""How right, how exact and how quick recognition is, on pictures that this project did not make.

python benchmarks/bench_recognition.py [--json] [--set FOLDER...] [--parts PATH...] [--held-out]
    [--lights backlit front lo-backlit lo-front] [--keep FOLDER] [--checkout FOLDER] [--lamps 3]
    [--without PART...]

Drives `cellctl recognise` as its users do, a process for the pictures of one light, held to one
core. A set is a folder with pictures, truth.json, and perhaps lo/ (256 x 256) and calib/ (boards).
What counts as right: `recognition_judge`. Every fourth picture is aside: --held-out tells those
separately from the others. With `--lamps N` the front-lit pictures of a set that
`trace_pictures.py --lamps N` made are judged N together, and the truth of a scene's first picture
counts. What --without names is left out of the library, so that it is a stranger. The time of a
picture is the sum of its answers' "seconds".
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from recognition_judge import (  # noqa: E402
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
from recognition_parts import cad_files, read_mesh  # noqa: E402
from recognition_runs import (  # noqa: E402
    Run,
    calibrate,
    from_truth,
    recognise_command,
    run,
    smaller,
    stable_poses,
)
from recognition_symmetry import Surface  # noqa: E402
from recognition_tables import TARGETS, print_lights  # noqa: E402
from shared_files import SHARED  # noqa: E402  (path set above)

LIGHTS = {
    "backlit": ("hi", "back"),
    "front": ("hi", "front"),
    "lo-backlit": ("lo", "back"),
    "lo-front": ("lo", "front"),
}
LIGHTING = {"back": "backlit", "front": "front"}
OURS = "cellctl"


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

    def answers(
        self,
        who: str,
        light: str,
        images: Sequence[Path],
        parts: Sequence[Path] | None = None,
        environment: dict[str, str] | None = None,
    ) -> Run:
        size, mode = LIGHTS[light]
        camera, parts = self.pictures.cameras[size][0], list(parts or self.pictures.parts)
        if who == OURS:
            command = recognise_command(images, parts, camera, LIGHTING[mode])
            if self.lamps(light) > 1:
                command += ["--lamps", str(self.lamps(light))]
        return run(
            command,
            one_core=not self._args.all_cores,
            checkout=self.checkout if who == OURS else ROOT,
            environment=environment,
        )

    def lamps(self, light: str) -> int:
        """Return how many pictures of a light show one scene."""
        return int(self._args.lamps) if LIGHTS[light][1] == "front" else 1

    def judge(self, told: Run, images: Sequence[Path]) -> list[Verdict]:
        names = {image.name for image in images}
        answers = [read_answer(line, self._pose) for line in told.lines]
        return self._judge.judge([t for t in self.pictures.things if t.image in names], answers)

    def costs(self, told: Run, images: Sequence[Path]) -> dict[str, Any]:
        """Return what the pictures took, those with one object apart: that is the issue's."""
        by_picture: dict[str, float] = {image.name: 0.0 for image in images}
        for line in told.lines:
            by_picture[line["image"]] += float(line.get("seconds") or 0.0)
        one = [e["image"] for e in self.pictures.truth["images"] if len(e["objects"]) == 1]
        answered = {line["image"] for line in told.lines}
        alone = [by_picture[name] for name in by_picture if name in one and name in answered]
        return {
            "one_object_ms": _ms(alone),
            "picture_ms": _ms(list(by_picture.values())),
            "one_object_wall_ms": _ms([s for n, s in told.picture_s.items() if n in one]),
            "wall_s": told.wall_s,
            "start_s": told.start_s,
            "peak_mb": told.peak_mb,
            "cpu_s": told.cpu_s,
            "error": told.error,
        }

    def keep(self, who: str, light: str, told: Run) -> None:
        if self._args.keep is not None:
            self._args.keep.mkdir(parents=True, exist_ok=True)
            file = self._args.keep / f"{self.pictures.name}_{light}_{who}.jsonl"
            file.write_text("".join(json.dumps(line) + "\n" for line in told.lines))


def _ms(seconds: Sequence[float]) -> dict[str, float] | None:
    if not seconds:
        return None
    found = 1e3 * np.array(seconds)
    return {
        "median": float(np.median(found)),
        "p95": float(np.percentile(found, 95)),
        "count": len(found),
    }


def is_held_out(image: str) -> bool:
    """Say whether a picture is one of those aside: every fourth, from the third on."""
    return int("".join(c for c in Path(image).stem if c.isdigit()) or 0) % 4 == 3


def rates(bench: Bench, args: argparse.Namespace) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a set's figures by light and method, and the verdicts behind them."""
    result: dict[str, Any] = {}
    verdicts: dict[str, dict[str, list[Verdict]]] = {}
    for light in args.lights:
        images = bench.pictures.of(light)
        if not images or LIGHTS[light][0] not in bench.pictures.cameras:
            continue
        for who in (OURS,):
            told = bench.answers(who, light, images)
            bench.keep(who, light, told)
            scenes = images[:: bench.lamps(light)]
            found = bench.judge(told, scenes)
            verdicts.setdefault(light, {})[who] = found
            result.setdefault(light, {})[who] = {
                **described(found, args.held_out),
                "pictures": len(images),
                "costs": bench.costs(told, scenes),
            }
    small = [verdicts[light] for light in ("lo-backlit", "lo-front") if light in verdicts]
    if len(small) == 2:
        both = {who: [v for of in small for v in of[who]] for who in (OURS,)}
        verdicts["lo"] = both
        result["lo"] = {who: described(found, args.held_out) for who, found in both.items()}
    return result, verdicts


def described(found: list[Verdict], with_held_out: bool) -> dict[str, Any]:
    body = {
        **figures(found),
        "confusion": confusion(found),
        "reliability": reliability(found),
        "failures": failures(found),
    }
    if with_held_out:
        aside = [is_held_out((v.thing or v.answer).image) for v in found]  # type: ignore[union-attr]
        body["held_out"] = figures([v for v, out in zip(found, aside, strict=True) if out])
        body["others"] = figures([v for v, out in zip(found, aside, strict=True) if not out])
    return body


def main() -> int:
    args = read_arguments()
    folders = args.set or [SHARED / "images"]
    for folder in folders:
        if not (folder / "truth.json").is_file():
            print(f"needs pictures and their truth.json in {folder}", file=sys.stderr)
            return 2
    checkout = (args.checkout or ROOT).resolve()
    result: dict[str, Any] = {"targets": TARGETS, "load": os.getloadavg()[0], "sets": {}}
    pooled: dict[str, dict[str, list[Verdict]]] = {}
    with tempfile.TemporaryDirectory(prefix="bench_recognition_") as scratch_name:
        for folder in folders:
            pictures = read_set(folder.resolve(), args, Path(scratch_name))
            pictures = without(pictures, args.without)
            bench = Bench(pictures, args, checkout)
            body: dict[str, Any] = {"cameras": {k: how for k, (_, how) in pictures.cameras.items()}}
            body["lights"], verdicts = rates(bench, args)
            for light, by_method in verdicts.items():
                for who, found in by_method.items():
                    pooled.setdefault(light, {}).setdefault(who, []).extend(found)
            result["sets"][pictures.name] = body
    if len(folders) > 1 and pooled:
        result["all_sets"] = {
            light: {who: described(found, args.held_out) for who, found in by_method.items()}
            for light, by_method in pooled.items()
        }
    if args.json:
        print(json.dumps(result))
        return 0
    for name, body in result["sets"].items():
        print(
            f"== {name}: camera {', '.join(f'{k} by {how}' for k, how in body['cameras'].items())}"
        )
        print_lights(body["lights"])
    if "all_sets" in result:
        print("== all sets together")
        print_lights(result["all_sets"])
    return 0


def read_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--set", type=Path, nargs="+", help="folders with pictures and truth.json")
    parser.add_argument("--parts", type=lambda p: Path(p).resolve(), nargs="+", help="CAD files")
    parser.add_argument("--calibration", type=Path, help="camera; by the set's boards otherwise")
    parser.add_argument("--lo-calibration", type=Path, help="camera of the small pictures")
    parser.add_argument("--lights", nargs="+", choices=tuple(LIGHTS), default=list(LIGHTS))
    parser.add_argument("--held-out", action="store_true", help="tell every fourth picture apart")
    parser.add_argument("--keep", type=Path, help="folder for the answers themselves")
    parser.add_argument("--lamps", type=int, default=1, help="front-lit pictures of one scene")
    parser.add_argument("--without", nargs="+", default=[], help="parts no library has")
    parser.add_argument("--all-cores", action="store_true", help="instead of one")
    parser.add_argument("--checkout", type=Path, help="whose cellctl is run; this one otherwise")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
