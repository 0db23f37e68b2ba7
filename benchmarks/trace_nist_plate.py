"""View sets of as-built twins of NIST's plate, path-traced; `bench_nist_plate.py` judges them.

    python benchmarks/trace_nist_plate.py SMSTESTBED FOLDER [--count 20] [--seed 1] [--until 21:40]

SMSTESTBED is a checkout of github.com/usnistgov/smstestbed, see `nist_plate`. Each of the 20 plates
that were measured there is built as it was measured, held at its rim, shown to the camera of
`trace_held`'s stations (about 0.18 mm a pixel) from both sides, square and tilted, and traced under
its three lamps. Each SET.json asks for the published characteristics that show in pictures, with
the published limits; truth.json has values and verdicts as published.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

import cv2  # noqa: E402  (threads and path come first)
import numpy as np  # noqa: E402
import trimesh  # noqa: E402
from nist_plate import SIZE_MM, Feature, Plate, read_plates, twin, write_nominal  # noqa: E402
from trace_held import (  # noqa: E402
    Specimen,
    draw_dust,
    draw_hand,
    draw_look,
    draw_sight,
    draw_station,
    is_late,
    write_atomically,
    write_pictures,
)
from trace_held_defects import Built, mesh_of  # noqa: E402
from trace_held_hold import View, hold_at, shown  # noqa: E402
from trace_held_parts import HeldPart  # noqa: E402
from trace_held_sensor import draw_sensor  # noqa: E402
from trace_scene import NoTracerError, tracer  # noqa: E402

from controller.cad import load_solid  # noqa: E402

Words = dict[str, Any]
TILTED = np.tan(np.radians(17.0))
TOWARDS = [(0.03, 0.02, 1.0), (TILTED, 0.0, 1.0), (0.0, -TILTED, 1.0), (0.02, 0.03, -1.0)]
HELD_AT_MM = np.array([84.0, 71.16, 5.0])  # on the rim, where nothing is cut


class Twin(Specimen):
    """One plate as it was measured: held, shown, traced."""

    def __init__(self, seed: int, mesh: trimesh.Trimesh, path: Path, plate: Plate) -> None:
        self.seed, self.cls, self.kind, self.held_out = seed, "good", "as_built", False
        self.rng = rng = np.random.default_rng(seed)
        self.sight, self.hand = draw_sight(rng), draw_hand(rng)
        self.station = draw_station(rng, held_out=False)
        self.sensor = draw_sensor(rng)
        self.part = HeldPart("nist_plate", (), (), path=path)
        body = twin(mesh, plate)
        self.built = Built(body, {}, {"kind": "as_built"}, body)
        self.body = mesh_of(body)
        self.grasps = [hold_at(self.body, HELD_AT_MM, np.array([0.0, -1.0, 0.0]), self.hand)]
        held = self.station["held_mm"]
        middle = self.body.bounding_box.centroid
        self.views = []
        for towards in TOWARDS:
            direction = np.array(towards) / np.linalg.norm(towards)
            self.views.append(View(0, shown(direction, middle, held, rng)))
        self.coverage = 1.0
        self.hidden: list[int] = []
        self.look, self.material = draw_look(rng, plain=False)
        self.dust = draw_dust(self.body, rng)


def asked(plate: Plate) -> list[Words]:
    """Return the published characteristics that show in pictures, as SET.json names them.

    The position of a hole is asked for as the radius of its zone. Flatness and squareness show in
    no picture; two distances from a hole to an edge are published without saying which.
    """
    out = []
    for number, result in enumerate(plate.results):
        feature = plate.features.get(result.feature)
        words: Words = {
            "id": f"{result.name} {number}", "kind": result.kind, "nominal_mm": result.nominal_mm,
            "lower": result.lower_mm, "upper": result.upper_mm,
        }  # fmt: skip
        if result.kind in ("diameter", "radius") and feature is not None:
            place = [*feature.nominal_mm.tolist(), 0.0]
            out.append(words | {"p_part_mm": place, "axis": [0.0, 0.0, 1.0]})
        elif result.kind == "position" and feature is not None:
            place = [*feature.nominal_mm.tolist(), 0.0]
            upper = result.upper_mm / 2
            out.append(words | {"p_part_mm": place, "axis": [0.0, 0.0, 1.0], "upper": upper})
        elif result.kind in ("length", "width") and feature is not None:
            out.append(words | _slot(feature, result.kind))
        elif result.kind == "length" and result.nominal_mm in SIZE_MM[:2]:
            axis = np.eye(3)[int(result.nominal_mm == SIZE_MM[1])]
            out.append(words | {"p_part_mm": (SIZE_MM / 2).tolist(), "axis": axis.tolist()})
    return out


def _slot(feature: Feature, kind: str) -> Words:
    """Return where a slot along y is measured; its length is along its own axis, that of a hole."""
    place = [*feature.nominal_mm.tolist(), SIZE_MM[2]]
    return {"p_part_mm": place, "axis": [0.0, 0.0, 1.0] if kind == "length" else [1.0, 0.0, 0.0]}


def main() -> int:
    """Parse, trace, and turn an error into one sentence."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, metavar="SMSTESTBED")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--until", help="HH:MM; no plate is begun later")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    try:
        tracer()
    except NoTracerError as error:
        print(f"trace_nist_plate: {error}", file=sys.stderr)
        return 2
    args.folder.mkdir(parents=True, exist_ok=True)
    cad = args.folder / "plate.step"
    if not cad.exists():
        write_nominal(args.data, cad)
    mesh = load_solid(cad).mesh
    truth: dict[str, Words] = {}
    for number, plate in enumerate(read_plates(args.data)[: args.count]):
        folder = args.folder / f"p{number + 1:02d}"
        words = {
            "serial": plate.serial,
            "published": [
                {"id": f"{r.name} {i}", "kind": r.kind, "value_mm": r.value_mm,
                 "verdict": r.verdict, "lower": r.lower_mm, "upper": r.upper_mm}
                for i, r in enumerate(plate.results)
            ],
        }  # fmt: skip
        truth[folder.name] = words
        if (folder / "SET.json").exists():
            continue
        if is_late(args.until):
            break
        start = time.perf_counter()
        specimen = Twin(args.seed + number, mesh, cad, plate)
        pictures, _ = specimen.trace()
        folder.mkdir(exist_ok=True)
        write_pictures(folder, pictures)
        told = specimen.set_words(os.path.relpath(cad, folder)) | {"characteristics": asked(plate)}
        write_atomically(folder / "SET.json", json.dumps(told))
        done = {name: w for name, w in truth.items() if (args.folder / name / "SET.json").exists()}
        write_atomically(args.folder / "truth.json", json.dumps(done))
        print(f"{folder.name} {plate.serial} {time.perf_counter() - start:.0f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
