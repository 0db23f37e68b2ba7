"""Fit the curves of controller/recognition/identification/scores.py to pictures.

python benchmarks/fit_scores.py --set FOLDER [--parts PATH...] [--set FOLDER [--parts PATH...]]...
    [--held-out FOLDER [--parts PATH...]]... [--calibration FILE] [--lo-calibration FILE]
    [--most N] [--json]

A set is a folder as `bench_recognition` reads it; --parts are those of the set named before it,
the shared ones otherwise. The sets held out are only reported. Every hypothesis of every object is
compared with what truly lay there: right is what `recognition_judge` calls the right pose, in its
place and turned as it lay. Two steps make a curve, one for a light table, one for lamps:

- A logistic curve, its signs given, over the best hypotheses, those of strangers, and wrong ones
  that fit clearly worse than the best: what evidence tells right from wrong. Where the best is
  wrong and one of the next ones right, the order went wrong, which is `log_odds`' matter: left out.
- An offset and a slope over the best hypotheses alone, which are what is answered: how much.

The scores reported are those that answers would get: shared by hypotheses that look the same.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from bench_recognition import LIGHTING, LIGHTS, Pictures, read_set, surfaces  # noqa: E402
from recognition_curves import Compared, Seen, examples, fitted, pasted  # noqa: E402
from recognition_judge import (  # noqa: E402
    Answer,
    Judge,
    Thing,
    Verdict,
    pair,
    reliability,
)
from recognition_parts import cad_files  # noqa: E402

from controller.cad.compiled import options_among  # noqa: E402
from controller.cli.inputs.calibration_file import load_calibration  # noqa: E402
from controller.recognition import Hypothesis, Library, Sighting, recognise  # noqa: E402
from controller.recognition.identification.decide import decide  # noqa: E402
from controller.recognition.identification.scores import FRONT, SILHOUETTE, Weights, probability  # noqa: E402
from controller.recognition.stored import open_library  # noqa: E402

PLACE_MM = {"hi": 1.0, "lo": 2.5}  # two of the small pictures' pixels; some five large ones
TURN_DEG = 4.0  # as recognition itself tells two turns apart
CURVES = {"back": ("SILHOUETTE", SILHOUETTE), "front": ("FRONT", FRONT)}


@dataclass(frozen=True, eq=False, slots=True)
class Gathered:
    """A set of pictures as it was recognised."""

    name: str
    is_held_out: bool
    pictures: int
    parts: int
    missed: int
    seen: list[Seen]


def gather(
    pictures: Pictures, most: int | None, *, is_held_out: bool, without: Sequence[str] = ()
) -> Gathered:
    """Recognise a set, pictures large and small, and compare each hypothesis with the truth.

    Parameters
    ----------
    most : pictures; None for all
    is_held_out : it is reported only
    without : parts that are left out of the library, so that they are strangers
    """
    files = [
        (f, options_among(f, None))
        for name, f in sorted(cad_files(pictures.parts).items())
        if name not in without
    ]
    known = [replace(t, is_known=t.is_known and t.part not in without) for t in pictures.things]
    judge = Judge(surfaces(pictures.parts))
    images = [entry["image"] for entry in pictures.truth["images"]]
    if most is not None and most < len(images):  # spread over the set
        images = [images[i] for i in np.linspace(0, len(images) - 1, most).round().astype(int)]
    chosen, tried, missed = set(images), 0, 0
    cameras = {size: load_calibration(file) for size, (file, _) in pictures.cameras.items()}
    libraries = {size: open_library(files, camera) for size, camera in cameras.items()}
    seen: list[Seen] = []
    for light, (size, mode) in LIGHTS.items():
        for path in (p for p in pictures.of(light) if p.name in chosen):
            grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            assert grey is not None, path
            lighting, library = LIGHTING[mode], libraries[size]
            found = recognise(grey, cameras[size], library, lighting)  # type: ignore[arg-type]
            things = [t for t in known if t.image == path.name]
            pairs = pair(things, [_answer(path.name, s) for s in found.sightings])
            tried, missed = tried + 1, missed + len(things) - len(pairs)
            truth = {j: things[i] for i, j, _ in pairs}
            for j, trace in enumerate(found.traces):
                if trace.hypotheses:
                    thing = truth.get(j)
                    what = f"{light} {path.name} {thing.part if thing is not None else 'nothing'}"
                    compared = compare(trace.hypotheses, thing, judge, library, PLACE_MM[size])
                    seen.append(_seen(what, mode, thing, trace.hypotheses, compared))
    name = f"{pictures.name} less {len(without)} parts" if without else pictures.name
    return Gathered(name, is_held_out, tried, len(files), missed, seen)


def halves(pictures: Pictures) -> tuple[list[str], list[str]]:
    """Return a set's parts in two halves by name; mirror images stay together."""
    names = sorted(cad_files(pictures.parts))
    families = sorted({name.removesuffix("_mirror") for name in names})
    first = set(families[: len(families) // 2])
    is_first = [name.removesuffix("_mirror") in first for name in names]
    return (
        [name for name, mine in zip(names, is_first, strict=True) if mine],
        [name for name, mine in zip(names, is_first, strict=True) if not mine],
    )


def _answer(image: str, s: Sighting) -> Answer:
    theta_deg = math.degrees(s.theta_rad)
    return Answer(image, s.part, s.R, s.x_mm, s.y_mm, theta_deg, s.score, (), math.nan, s.reason)


def compare(
    hypotheses: Sequence[Hypothesis],
    thing: Thing | None,
    judge: Judge,
    library: Library,
    place_mm: float,
) -> tuple[Compared, ...]:
    """Return the hypotheses of an object, each right or wrong.

    Parameters
    ----------
    place_mm : how far from its place a right one may be
    """
    compared = []
    for h in hypotheses:
        is_right = is_turned = False
        if thing is not None and thing.is_known:
            entry = library.entries[h.part]
            x, y = (float(v) for v in h.place_mm)
            R, theta_deg = entry.pose(h.pose).R, math.degrees(h.theta_rad)
            told = Answer(thing.image, entry.name, R, x, y, theta_deg, 0.0, (), 0.0, "")
            verdict = judge.judge([thing], [told])[0]
            if verdict.kind == "right" and (verdict.position_mm or 0.0) <= place_mm:
                is_turned = (verdict.angle_deg or 0.0) > TURN_DEG
                is_right = not is_turned
        compared.append(Compared(h.evidence, is_right, is_turned))
    return tuple(compared)


def _seen(
    what: str,
    mode: str,
    thing: Thing | None,
    hypotheses: Sequence[Hypothesis],
    compared: tuple[Compared, ...],
) -> Seen:
    # what looks the same is so whatever the score: as if the best were sure
    sure = [replace(hypotheses[0], probability=1.0), *hypotheses[1:]]
    alike = {id(h) for h in decide(sure, is_backlit=mode == "back").rivals}
    rivals = tuple(r for h, r in zip(hypotheses, compared, strict=True) if id(h) in alike)
    return Seen(what, mode, thing is not None and thing.is_known, compared, rivals)


def report(seen: Sequence[Seen], weights: Weights) -> dict[str, Any]:
    """Return how far the scores of a curve can be trusted, on objects of one kind of light."""
    scores = np.array([probability(one.compared[0].evidence, weights) for one in seen])
    right = np.array([one.compared[0].is_right for one in seen], dtype=np.bool_)
    strangers = np.array([not one.is_known for one in seen], dtype=np.bool_)
    verdicts = [
        _verdict(one, score / (1 + len(one.rivals)))
        for one, score in zip(seen, scores, strict=True)
    ]
    wrong = [
        {"what": one.what, "score": round(v.answer.score, 3), "turned": one.compared[0].is_turned}
        for one, v in zip(seen, verdicts, strict=True)
        if v.answer is not None and v.answer.score >= 0.5 and v.kind != "right"
    ]
    answered = [v for v, score in zip(verdicts, scores, strict=True) if score >= 0.5]
    return {
        "objects": len(seen),
        "right": int(right.sum()),
        "misordered": sum(one.is_misordered for one in seen),
        "told_apart_at_half": float(((scores >= 0.5) == right).mean()) if len(seen) else None,
        "best_readings": reliability(verdicts),
        "answers": reliability(answered),
        "surest_wrong": sorted(wrong, key=lambda row: -float(row["score"])),
        "strangers": sorted((round(float(s), 3) for s in scores[strangers]), reverse=True),
    }


def _verdict(one: Seen, score: float) -> Verdict:
    """Return the best hypothesis as the judge's tables take it."""
    kind = "right" if one.compared[0].is_right else "wrong pose"
    told = Answer("", "", None, 0.0, 0.0, 0.0, score, (), 0.0, "")
    loose = "right" if any(r.is_right for r in one.rivals) else kind
    return Verdict(None, told, kind, loose, None)


def told_of(sets: Sequence[Gathered]) -> dict[str, Any]:
    """Return the curves that the sets ask for, and how those in the source and these do."""
    result: dict[str, Any] = {
        "sets": {
            s.name: {
                "held_out": s.is_held_out,
                "pictures": s.pictures,
                "parts": s.parts,
                "objects": len(s.seen),
                "hypotheses": sum(len(one.compared) for one in s.seen),
                "missed": s.missed,
                "turned": sum(r.is_turned for one in s.seen for r in one.compared),
            }
            for s in sets
        },
        "curves": {},
    }
    for mode, (name, now) in CURVES.items():
        by_set = {s.name: [one for one in s.seen if one.mode == mode] for s in sets}
        fit_on = [one for s in sets if not s.is_held_out for one in by_set[s.name]]
        try:
            weights = fitted(fit_on, mode)
        except ValueError as error:
            result["curves"][name] = {"error": str(error), "now": pasted(now)}
            continue
        _, is_right, is_best = examples(fit_on)
        groups = {"all fitted": fit_on, **by_set}
        result["curves"][name] = {
            "weights": pasted(weights),
            "now": pasted(now),
            "examples": len(is_right),
            "right": int(is_right.sum()),
            "best": int(is_best.sum()),
            "reports": {
                group: {"fitted": report(ones, weights), "now": report(ones, now)}
                for group, ones in groups.items()
                if ones
            },
        }
    return result


def print_told(told: dict[str, Any]) -> None:
    for name, s in told["sets"].items():
        print(
            f"{name:12} {s['pictures']} pictures of {s['parts']} parts: {s['objects']} objects "
            f"with {s['hypotheses']} hypotheses ({s['turned']} in place but turned), "
            f"{s['missed']} missed" + ("; held out" if s["held_out"] else "")
        )
    for name, curve in told["curves"].items():
        print(f"\n{name} = {curve.get('weights', curve.get('error'))}")
        print(f"  in the source  {curve['now']}")
        if "error" in curve:
            continue
        print(
            f"  from {curve['examples']} hypotheses, {curve['right']} of them right; "
            f"{curve['best']} are the best of their objects"
        )
        for group, by in curve["reports"].items():
            held = told["sets"].get(group, {}).get("held_out")
            print(f"  -- {group}{' (held out)' if held else ''}")
            for which in ("fitted", "now"):
                _print_report(which, by[which], with_wrong=group in told["sets"])


def _print_report(which: str, r: dict[str, Any], *, with_wrong: bool) -> None:
    best, answers = r["best_readings"], r["answers"]
    print(
        f"     {which:6} {r['objects']} objects, best hypothesis right {r['right']}, misordered "
        f"{r['misordered']}; told apart at 0.5: {r['told_apart_at_half']:.3f}; expected error "
        f"{_error(best)} of best hypotheses, {_error(answers)} of answers"
    )
    if which == "fitted":
        for b in best["bins"]:
            print(
                f"            {b['from']:.2f} .. {b['to']:.2f}: {b['answers']:4}, mean score "
                f"{b['mean_score']:.3f}, right {b['right']:.3f}"
                f" ({b['right_with_alternatives']:.3f} with alternatives)"
            )
        for row in r["surest_wrong"] if with_wrong else ():
            turned = " (only its turn)" if row["turned"] else ""
            print(f"            wrong at {row['score']:.3f}: {row['what']}{turned}")
    if r["strangers"]:
        known = sum(score >= 0.5 for score in r["strangers"])
        top = " ".join(f"{score:.2f}" for score in r["strangers"][:10])
        print(f"            {len(r['strangers'])} strangers, {known} taken for known; most: {top}")


def _error(told: dict[str, Any]) -> str:
    both = (told["expected_error"], told["expected_error_with_alternatives"])
    return "-" if both[0] is None else f"{both[0]:.3f} ({both[1]:.3f})"


class _AddSet(argparse.Action):
    """Adds a set; --parts after it is its own."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        args: argparse.Namespace,
        values: Path | list[Path],
        option_string: str | None = None,
    ) -> None:
        sets = args.sets = list(args.sets or [])
        if option_string != "--parts":
            sets.append((values, option_string == "--held-out", None))
        elif not sets or sets[-1][2] is not None:
            parser.error("--parts belongs after the --set or --held-out that it is of")
        else:
            sets[-1] = (*sets[-1][:2], values)


def read_arguments(argv: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.set_defaults(sets=None)
    add: dict[str, Any] = {"action": _AddSet, "dest": "sets", "default": argparse.SUPPRESS}
    parser.add_argument("--set", type=Path, **add, help="folder to fit to; may be repeated")
    parser.add_argument("--held-out", type=Path, **add, help="folder that is only reported")
    resolved = {"type": lambda p: Path(p).resolve(), "nargs": "+"}
    parser.add_argument("--parts", **resolved, **add, help="CAD files of the set before it")
    parser.add_argument("--calibration", type=Path, help="camera; by the set's boards otherwise")
    parser.add_argument("--lo-calibration", type=Path, help="camera of the small pictures")
    parser.add_argument("--most", type=int, help="pictures of a set, spread over it")
    parser.add_argument(
        "--halves", action="store_true", help="each set with half of its parts unknown, too"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object")
    args = parser.parse_args(argv)
    if not any(not is_held_out for _, is_held_out, _ in args.sets or ()):
        parser.error("name at least one --set to fit to")
    return args


def main() -> int:
    args = read_arguments()
    names = [folder.resolve().name for folder, _, _ in args.sets]
    if len(set(names)) < len(names):
        print(f"sets are told apart by their folders' names: {', '.join(names)}", file=sys.stderr)
        return 2
    for folder, _, _ in args.sets:
        if not (folder / "truth.json").is_file():
            print(f"needs pictures and their truth.json in {folder}", file=sys.stderr)
            return 2
    cv2.setNumThreads(1)
    begin, sets = time.perf_counter(), []
    with tempfile.TemporaryDirectory(prefix="fit_scores_") as scratch:
        for number, (folder, is_held_out, parts) in enumerate(args.sets):
            asked = argparse.Namespace(
                parts=parts, calibration=args.calibration, lo_calibration=args.lo_calibration
            )
            into = Path(scratch) / str(number)
            into.mkdir()
            pictures = read_set(folder.resolve(), asked, into)
            sets.append(gather(pictures, args.most, is_held_out=is_held_out))
            for without in halves(pictures) if args.halves else ():
                half = gather(pictures, args.most, is_held_out=is_held_out, without=without)
                sets.append(replace(half, name=f"{half.name}, from {without[0]}"))
    told = told_of(sets) | {"seconds": time.perf_counter() - begin, "load": os.getloadavg()[0]}
    if args.json:
        print(json.dumps(told))
    else:
        print_told(told)
    return 0


if __name__ == "__main__":
    sys.exit(main())
