"""How finely STEP solids are divided: triangles, and how far they are off their surfaces.

python benchmarks/bench_step_division.py FILE... [--json]

Each file of one solid is divided as it stands, in a process of its own, in which the STEP kernel
may crash. Off is measured at the middle of each triangle and of its sides, in space where the
surface has a formula, along the triangle's normal at the 400 largest triangles of a spline.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
ANGLE_RAD = 0.3  # of controller.cad.reading.step.files


def child(file: str) -> dict[str, Any]:
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopoDS import TopoDS

    from controller.step_kernel.dividing import chord_of, stray_mm
    from controller.step_kernel.files import read_shape
    from controller.step_kernel.measures import extent_of, surface_of
    from controller.step_kernel.mesh import tessellate
    from controller.step_kernel.shapes import shapes_of

    solid, _ = read_shape(file)
    extent_mm = extent_of(solid)
    chord_mm = chord_of(extent_mm)
    triangles = tessellate(solid, chord_mm, ANGLE_RAD)["triangles"]
    found = shapes_of(solid, TopAbs_FACE)
    faces = [TopoDS.Face_s(found.FindKey(i)) for i in range(1, found.Extent() + 1)]
    kinds = [surface_of(face) for face in faces]
    off = [
        stray_mm(face, *kind) for face, kind in zip(faces, kinds, strict=True) if kind[0] != "plane"
    ]
    return {
        "file": Path(file).name,
        "diagonal_mm": round(extent_mm, 1),
        "faces": len(faces),
        "triangles": len(triangles),
        "chord_mm": round(chord_mm, 4),
        "off_mm": round(max(off, default=0.0), 4),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        print("\n" + json.dumps(child(args.files[0])))  # the kernel writes lines without an end
        return 0
    rows = []
    for file in args.files:
        done = subprocess.run(
            [sys.executable, __file__, "--child", file],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            reason = (done.stderr.splitlines() or ["it crashed"])[-1]
            rows.append({"file": Path(file).name, "failed": reason})
        else:
            rows.append(json.loads(done.stdout.splitlines()[-1]))
        if not args.json:
            print("  ".join(f"{name} {value}" for name, value in rows[-1].items()), flush=True)
    if args.json:
        print(json.dumps({"files": rows}))
    return int(any("failed" in row for row in rows))


if __name__ == "__main__":
    sys.exit(main())
