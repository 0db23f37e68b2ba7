"""How near the share forecast to be compared is to what the pictures of a run then give.

    python benchmarks/bench_compared.py SET...

Each SET is a file of a good part's views as a run writes it. Its pictures are judged, then those
predicted of the same views, both without faces left out by name. Printed are both shares, the
largest difference of a face above 50 mm2, the faces that keep either from a PASS, and the CPU
seconds of prediction and judging.
"""

import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
from bench import Arguments, need_sets, note, show

from controller.config.view_set import load_view_set
from controller.inspection import (
    InspectionLimits,
    PartSettings,
    PartVerdict,
    PicturedView,
    ViewSet,
    inspect_part,
    predict_pictures,
)
from controller.stored.judging import compiled_part, read_pictures
from controller.stored.view_set import build_view_set, planned_samples

LARGE_MM2 = 50.0


def judged(views: ViewSet, settings: PartSettings) -> PartVerdict:
    return inspect_part(views, (), settings).ledger


def labels(ledger: PartVerdict) -> Mapping[int, str]:
    return {f.face_id: f.label for f in ledger.faces if f.face_id in ledger.short_faces}


def compare(path: Path) -> dict[str, Any]:
    """Return what was forecast of one set and what was found, as shares."""
    file = load_view_set(path)
    part = compiled_part(path, file)
    asked = 3.0 if file.recipe is None else file.recipe.inspection.smallest_defect_mm
    limits = InspectionLimits(smallest_defect_mm=asked)
    views = build_view_set(file, part, read_pictures(path, file), limits)
    settings = PartSettings(limits, unseen_reasons=file.unseen, planned=planned_samples(file, part))
    found = judged(views, settings)
    begin = time.process_time()
    predicted: list[PicturedView] = [
        replace(one, pictures=predict_pictures(views.part, one.task)) for one in views.views
    ]
    made = time.process_time()
    told = judged(ViewSet(views.part, views.samples, tuple(predicted)), settings)
    done = time.process_time()
    off = max(
        (abs(a.compared_fraction - b.compared_fraction), a.label)
        for a, b in zip(told.faces, found.faces, strict=True)
        if a.area_mm2 >= LARGE_MM2
    )
    before, after = labels(told).keys(), labels(found).keys()
    row = {
        "set": path.parent.name,
        "forecast": told.compared_fraction,
        "compared": found.compared_fraction,
        "face most off": off[1],
        "by": off[0],
        "short faces: in both": len(before & after),
        "forecast alone": len(before - after),
        "found alone": len(after - before),
        "predict s": made - begin,
        "judge s": done - made,
    }
    note(row)
    return row


def main() -> int:
    parser = Arguments(__doc__)
    parser.add_argument("sets", nargs="*", type=Path, metavar="SET")
    args = parser.parse_args()
    need_sets(args.sets, "a whole run of cellctl")
    cv2.setNumThreads(1)
    rows = [compare(path) for path in args.sets]
    worst = max(abs(row["forecast"] - row["compared"]) for row in rows)
    show(args, rows, {"parts": len(rows), "most off": worst})
    return 0


if __name__ == "__main__":
    sys.exit(main())
