"""Path-traced pieces in planned views: verdicts, what is compared, reasons for the rest.

    python benchmarks/bench_planned.py FOLDER... [--json]

FOLDER as `trace_planned.py` writes it. Each set is judged as the cell would judge it, by the recipe
of six lines beside it, to which `learned:` may be added; the truth is read afterwards. A defect is
found at its place where a finding is no farther from it than both are long, and 2 mm.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench import Arguments, need_sets, note, show
from trace_held import Words

from controller.cad import CadError
from controller.config import ConfigError
from controller.inspection import PartInspection
from controller.interface import judge_pictures

NEAR_MM = 2.0  # between a defect's place and a finding's, besides their sizes
LISTED = 8  # reasons


@dataclass(frozen=True)
class Outcome:
    """What was judged of a piece.

    Attributes
    ----------
    name, cls, kind : of the piece
    verdict : pass, fail or indeterminate
    compared, in_sight : shares of its surface
    at_place, elsewhere : number of findings
    not_evaluated : number of views, and of lit pictures in others, that failed their self-checks
    reasons : share of the surface by reason
    """

    name: str
    cls: str
    kind: str
    verdict: str
    compared: float
    in_sight: float
    at_place: int
    elsewhere: int
    not_evaluated: tuple[int, int]
    reasons: dict[str, float]


def outcome(folder: Path, truth: Words) -> Outcome:
    """Return what is judged of one piece."""
    recipe = folder / f"{truth['part']}.yaml"
    found = judge_pictures(folder / truth["specimen"] / "SET.json", recipe=recipe)
    near = [_is_near(one, truth) for one in found.findings]
    lit = [c for view in found.views if view.evaluated for c in view.checks if c.reason]
    return Outcome(
        name=f"{folder.name}/{truth['specimen']}",
        cls=truth["cls"],
        kind=truth["kind"],
        verdict=found.verdict.value,
        compared=found.ledger.compared_fraction,
        in_sight=found.ledger.in_sight_fraction,
        at_place=sum(near),
        elsewhere=len(near) - sum(near),
        not_evaluated=(sum(not v.evaluated for v in found.views), len(lit)),
        reasons=_reasons(found),
    )


def _is_near(finding: Any, truth: Words) -> bool:  # noqa: ANN401 - a finding of a part
    if truth["place_mm"] is None:
        return False
    off = np.linalg.norm(finding.p_part_mm - np.array(truth["place_mm"]))
    return bool(off < NEAR_MM + finding.size_mm + float(truth["size_mm"]))


def _reasons(found: PartInspection) -> dict[str, float]:
    faces = found.ledger.faces
    whole = sum(face.area_mm2 for face in faces)
    out: dict[str, float] = {}
    for face in faces:
        for reason, share in face.rest:
            out[reason] = out.get(reason, 0.0) + share * face.area_mm2 / whole
    return out


def figures(outcomes: Sequence[Outcome]) -> dict[str, object]:
    """Return what good pieces and those with a defect come to."""
    told: dict[str, object] = {}
    for cls in ("good", "defect"):
        mine = [one for one in outcomes if one.cls == cls]
        if mine:
            reasons: Counter[str] = Counter()
            for one in mine:
                reasons.update(one.reasons)
            told[cls] = dict(Counter(one.verdict for one in mine))
            told[f"{cls}: compared of what is in sight"] = sum(o.compared for o in mine) / max(
                sum(o.in_sight for o in mine), 1e-9
            )
            told[f"{cls}: shares not compared"] = {
                reason: share / len(mine) for reason, share in reasons.most_common(LISTED)
            }
    return told


def main(argv: Sequence[str] | None = None) -> int:
    """Parse, judge, and turn an error into one sentence."""
    parser = Arguments(__doc__)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    args = parser.parse_args(argv)
    need_sets(args.folders, "trace_planned.py")
    cv2.setNumThreads(1)
    outcomes = []
    try:
        for folder in args.folders:
            for truth in json.loads((folder / "truth.json").read_text())["specimens"]:
                outcomes.append(outcome(folder, truth))
                note({k: v for k, v in asdict(outcomes[-1]).items() if k != "reasons"})
    except (ConfigError, CadError, OSError, ValueError) as error:
        print(f"bench_planned: {error}", file=sys.stderr)
        return 2
    show(args, [asdict(one) for one in outcomes], figures(outcomes))
    good = [one for one in outcomes if one.cls == "good"]
    bad = [one for one in outcomes if one.cls == "defect"]
    return int(any(o.verdict == "fail" for o in good) or any(o.verdict == "pass" for o in bad))


if __name__ == "__main__":
    sys.exit(main())
