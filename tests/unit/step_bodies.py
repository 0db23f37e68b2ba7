"""STEP files of bodies with formulas, and of bodies with a face that is damaged.

Runs as a process of its own, so that the kernel is never imported beside the tests:
``python step_bodies.py FOLDER``.
"""

from __future__ import annotations

import subprocess
import sys
from math import pi
from pathlib import Path

BALL_MM = (5.0, 25.0, 120.0)  # radii
RING_MM = (40.0, 1.5)  # radii of a thin ring, whose tube is far smaller than the ring
LUNE_MM = 25.0  # radius of a quarter of a ball, bordered from pole to pole
NAMES = (*(f"ball {r:g}" for r in BALL_MM), "ring", "rod", "frustum", "drop", "lune", "sunk")


def write_bodies(folder: Path) -> dict[str, Path]:
    """Write a file of each body; one process for all, since it is slow to start."""
    command = [sys.executable, str(Path(__file__)), str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return {name: folder / f"{name}.step" for name in NAMES}


def _drop():  # noqa: ANN202  the kernel's types have no stubs
    """A ball of radius 25 stretched by 1.6 along z, as a spline."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_GTransform
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeSphere
    from OCP.gp import gp_GTrsf, gp_Mat

    stretch = gp_GTrsf()
    stretch.SetVectorialPart(gp_Mat(1, 0, 0, 0, 1, 0, 0, 0, 1.6))
    return BRepBuilderAPI_GTransform(BRepPrimAPI_MakeSphere(25.0).Shape(), stretch, True).Shape()


def _sunk():  # noqa: ANN202
    """A plate 60 x 40 x 10 mm, with a bore of radius 4 at (20, 15), sunk to 8 over the upper 4."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCone, BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    up = gp_Dir(0, 0, 1)
    bore = BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(20, 15, -5), up), 4.0, 20.0).Shape()
    sink = BRepPrimAPI_MakeCone(gp_Ax2(gp_Pnt(20, 15, 6), up), 4.0, 8.0, 4.0).Shape()
    plate = BRepAlgoAPI_Cut(BRepPrimAPI_MakeBox(60.0, 40.0, 10.0).Solid(), bore).Shape()
    return BRepAlgoAPI_Cut(plate, sink).Shape()


def main() -> None:
    """Write all files."""
    from OCP.BRepPrimAPI import (
        BRepPrimAPI_MakeCone,
        BRepPrimAPI_MakeCylinder,
        BRepPrimAPI_MakeSphere,
        BRepPrimAPI_MakeTorus,
    )
    from step_files import write_step

    folder = Path(sys.argv[1])
    made = [BRepPrimAPI_MakeSphere(r).Shape() for r in BALL_MM]
    made += [
        BRepPrimAPI_MakeTorus(*RING_MM).Shape(),
        BRepPrimAPI_MakeCylinder(3.0, 400.0).Shape(),
        BRepPrimAPI_MakeCone(30.0, 10.0, 40.0).Shape(),
        _drop(),
        BRepPrimAPI_MakeSphere(LUNE_MM, pi / 2).Shape(),
        _sunk(),
    ]
    for name, shape in zip(NAMES, made, strict=True):
        write_step(shape, str(folder / f"{name}.step"))


if __name__ == "__main__":
    main()
