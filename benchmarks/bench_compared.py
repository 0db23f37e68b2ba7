"""How near the share forecast to be compared is to what the pictures of a run then give.

    python benchmarks/bench_compared.py SET...

Each SET is a file of a good part's views as a run writes it. Its pictures are judged, then those
predicted of the same views, both without faces left out by name. Printed are both shares, the
largest difference of a face above 50 mm2, the faces that keep either from a PASS, and the CPU
seconds of prediction and judging.
"""

import argparse
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from controller.config.view_set import load_view_set  # noqa: E402  (path set above)
from controller.inspection import (  # noqa: E402
    HeldView,
    InspectionLimits,
    PartSettings,
    PartVerdict,
    ViewSet,
    inspect_part,
    predict_pictures,
)
from controller.stored.judging import compiled_part, read_pictures  # noqa: E402
from controller.stored.view_set import build_view_set, planned_samples  # noqa: E402

LARGE_MM2 = 50.0


def judged(views: ViewSet, settings: PartSettings) -> PartVerdict:
    return inspect_part(views, (), settings).ledger


def labels(ledger: PartVerdict) -> Mapping[int, str]:
    return {f.face_id: f.label for f in ledger.faces if f.face_id in ledger.short_faces}


def compare(path: Path) -> tuple[float, float]:
    """Print the line of one set; return its share compared, forecast and found."""
    file = load_view_set(path)
    part = compiled_part(path, file)
    asked = 3.0 if file.recipe is None else file.recipe.inspection.smallest_defect_mm
    limits = InspectionLimits(smallest_defect_mm=asked)
    views = build_view_set(file, part, read_pictures(path, file), limits)
    settings = PartSettings(limits, unseen_reasons=file.unseen, planned=planned_samples(file, part))
    found = judged(views, settings)
    begin = time.process_time()
    predicted: list[HeldView] = [
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
    short = f"{len(before & after)} in both, {len(before - after)}, {len(after - before)}"
    print(
        f"{path.parent.name:44} forecast {told.compared_fraction:6.1%} compared "
        f"{found.compared_fraction:6.1%}; face most off {off[1]} by {off[0]:.0%}; short faces "
        f"{short} in one alone; {made - begin:.1f} + {done - made:.1f} s",
        flush=True,
    )
    return told.compared_fraction, found.compared_fraction


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sets", nargs="+", type=Path, metavar="SET")
    cv2.setNumThreads(1)
    pairs = [compare(path) for path in parser.parse_args().sets]
    worst = max(abs(a - b) for a, b in pairs)
    print(f"{len(pairs)} parts: forecast and compared differ by {100 * worst:.1f} points at most")
    return 0


if __name__ == "__main__":
    sys.exit(main())
