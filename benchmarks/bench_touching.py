"""How right and how exact recognition is where parts touch each other or leave the picture.

python benchmarks/bench_touching.py --set FOLDER... --parts PATH... [--lamps 3] [--checkout FOLDER]
    [--json] [--keep FOLDER]

A set is a folder of pictures that `trace_pictures.py --scene touching`, `--scene overlapping` or
`--scene leaving` made, backlit or under lamps: its truth.json has the `free_share` of each object,
what of its outline nothing covers. A part that lies on others is right if it leans as answered.
Drives `cellctl recognise` as its users do; what counts as right: `recognition_judge`, alternatives
included. Objects of which less than 70 % is free are counted apart. A false name is a known
part's name for another part, for a stranger or for nothing. With `--lamps N` the pictures of a
scene that `trace_pictures.py --lamps N` made are judged N together.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from bench_recognition import OURS, Bench, read_set  # noqa: E402  (path set above)
from recognition_judge import Verdict, failures  # noqa: E402

LIGHT = {"back": "backlit", "front": "front"}
FREE = 0.7  # of its outline, from which the issue asks for a part's name
EXACT_MM = {"backlit": 0.1, "front": 0.3}
FALSE = ("wrong part", "named", "spurious")
GOAL = 0.95

Key = tuple[str, float, float]
Shares = dict[Key, float]


def free_shares(truth: dict[str, Any]) -> Shares:
    """Return the free share of each object by its picture and place."""
    return {
        (entry["image"], o["x_mm"], o["y_mm"]): o["free_share"]
        for entry in truth["images"]
        for o in entry["objects"]
    }


def lying_ones(truth: dict[str, Any]) -> frozenset[Key]:
    """Return picture and place of the objects that lie on others."""
    return frozenset(
        (entry["image"], o["x_mm"], o["y_mm"])
        for entry in truth["images"]
        for o in entry["objects"]
        if o.get("lies_on")
    )


def described(
    found: Sequence[Verdict], shares: Shares, lying: frozenset[Key], exact_mm: float
) -> dict[str, Any]:
    """Return the figures of a set's verdicts.

    Parameters
    ----------
    found : on every object and every answer
    shares : of each object, what of its outline is free
    lying : those that lie on others
    exact_mm : how far off a position may be
    """
    known = [v for v in found if v.thing is not None and v.thing.is_known]
    strangers = [v for v in found if v.thing is not None and not v.thing.is_known]

    def key_of(v: Verdict) -> Key:
        assert v.thing is not None
        return v.thing.image, v.thing.x_mm, v.thing.y_mm

    def share_of(v: Verdict) -> float:
        return shares[key_of(v)]

    free = [v for v in known if share_of(v) >= FREE]
    return {
        "free": _part(known=free, exact_mm=exact_mm),
        "free_on_table": _part([v for v in free if key_of(v) not in lying], exact_mm),
        "free_on_others": _part([v for v in free if key_of(v) in lying], exact_mm),
        "covered": _part(known=[v for v in known if share_of(v) < FREE], exact_mm=exact_mm),
        "strangers": len(strangers),
        "strangers_named": sum(v.kind == "named" for v in strangers),
        "false_names": sum(v.kind in FALSE for v in found),
        "wrong_poses": sum(v.kind == "wrong pose" for v in found),
        "failures": [
            {**row, "free_share": shares.get((row["image"], *(row["truth_xy_mm"] or (0, 0))))}
            for row in failures(list(found))
        ],
    }


def _part(known: Sequence[Verdict], exact_mm: float) -> dict[str, Any]:
    right = [v for v in known if v.with_alternatives == "right"]
    off = [v.distance_mm for v in right if v.distance_mm is not None]
    exact = sum(mm <= exact_mm for mm in off)
    return {
        "objects": len(known),
        "right": len(right),
        "right_share": len(right) / len(known) if known else None,
        "right_and_exact": exact,
        "right_and_exact_share": exact / len(known) if known else None,
        "position_mm": sorted(off)[len(off) // 2] if off else None,
        "worst_mm": max(off) if off else None,
    }


def measure(folder: Path, args: argparse.Namespace, scratch: Path) -> dict[str, Any]:
    """Return the figures of one set, by light."""
    pictures = read_set(folder, args, scratch)
    bench = Bench(pictures, args, (args.checkout or ROOT).resolve())
    shares = free_shares(pictures.truth)
    result: dict[str, Any] = {}
    for light in LIGHT.values():
        images = pictures.of(light)
        if not images:
            continue
        told = bench.answers(OURS, light, images)
        bench.keep(OURS, light, told)
        scenes = images[:: bench.lamps(light)]
        lying, exact_mm = lying_ones(pictures.truth), EXACT_MM[light]
        result[light] = described(bench.judge(told, scenes), shares, lying, exact_mm) | {
            "scenes": len(scenes),
            "costs": bench.costs(told, scenes),
        }
    return result


def print_set(name: str, light: str, body: dict[str, Any]) -> None:
    """Print what a set came to."""
    print(f"{name}, {light}: {body['scenes']} scenes")
    groups = {
        "free": "70 % free and more",
        "free_on_table": "of these on the table",
        "free_on_others": "of these on other parts",
        "covered": "less than 70 % free",
    }
    for key, words in groups.items():
        part = body[key]
        if part["objects"]:
            print(
                f"  {words}: {part['right']} of {part['objects']} right "
                f"({100 * part['right_share']:.1f} %), {part['right_and_exact']} within "
                f"{EXACT_MM[light]} mm ({100 * part['right_and_exact_share']:.1f} %); position: "
                f"median {part['position_mm'] or 0:.3f}, worst {part['worst_mm'] or 0:.3f} mm"
            )
    print(
        f"  false names: {body['false_names']} (of {body['strangers']} strangers "
        f"{body['strangers_named']}); wrong poses: {body['wrong_poses']}"
    )
    picture = body["costs"]["picture_ms"]
    print(f"  a scene: median {picture['median']:.0f} ms, 95 % {picture['p95']:.0f} ms")
    for row in body["failures"]:
        free = row["free_share"]
        print(
            f"    {row['image']} {row['kind']}: {row['truth']} "
            f"({'' if free is None else f'{100 * free:.0f} % free'}) -> {row['answer']} "
            f"{row['reason']}"
        )


def main() -> int:
    """Measure and print; exit code 1 where the goal is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", type=Path, nargs="+", required=True, help="folders")
    parser.add_argument("--parts", type=lambda p: Path(p).resolve(), nargs="+", required=True)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--keep", type=Path, help="folder for the answers themselves")
    parser.add_argument("--calibration", type=Path, help="camera; by the set's boards otherwise")
    parser.add_argument("--lo-calibration", type=Path, default=None, help=argparse.SUPPRESS)
    parser.add_argument("--lamps", type=int, default=1, help="pictures of one scene, under lamps")
    parser.add_argument("--checkout", type=Path, help="whose cellctl is run; this one otherwise")
    parser.add_argument("--all-cores", action="store_true", help="instead of one")
    args = parser.parse_args()
    result = {}
    with tempfile.TemporaryDirectory() as scratch:
        for folder in args.set:
            result[folder.name] = measure(folder.resolve(), args, Path(scratch))
    is_met = True
    for name, lights in result.items():
        for light, body in lights.items():
            share = body["free"]["right_and_exact_share"]
            is_met &= body["false_names"] == 0 and (share is None or share >= GOAL)
            if not args.json:
                print_set(name, light, body)
    if args.json:
        print(json.dumps(result))
    return 0 if is_met else 1


if __name__ == "__main__":
    sys.exit(main())
