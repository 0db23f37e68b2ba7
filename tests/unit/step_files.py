"""STEP files with known content, made by the STEP kernel for the reader's tests.

Runs as a process of its own, so that the kernel is never imported beside the tests:
``python step_files.py FOLDER``.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

needs_kernel = pytest.mark.skipif(
    importlib.util.find_spec("OCP") is None,
    reason="the STEP kernel is not installed: pip install 'cellctl[step]'",
)


KINDS = (
    "plate",
    "plate in inches",
    "plate cut up",
    "plate of splines",
    "round things",
    "needle",
    "two boxes",
    "open box",
)


def write_all(folder: Path) -> dict[str, Path]:
    """Write a file of each kind; one process for all, since it is slow to start."""
    command = [sys.executable, str(Path(__file__)), str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return {kind: folder / f"{kind}.step" for kind in KINDS}


def _plate_with_bore():  # noqa: ANN202  the kernel's types have no stubs
    """60 x 40 x 10 mm on z = 0, a bore of radius 6 through (20, 15)."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    box = BRepPrimAPI_MakeBox(60.0, 40.0, 10.0).Solid()
    axis = gp_Ax2(gp_Pnt(20, 15, -5), gp_Dir(0, 0, 1))
    return BRepAlgoAPI_Cut(box, BRepPrimAPI_MakeCylinder(axis, 6.0, 20.0).Shape()).Shape()


def _cut_up(shape):  # noqa: ANN001, ANN202
    """Return a shape with each closed surface in several faces, as some CAD systems write it."""
    from OCP.ShapeUpgrade import ShapeUpgrade_ShapeDivideClosed

    divide = ShapeUpgrade_ShapeDivideClosed(shape)
    divide.SetNbSplitPoints(3)
    divide.Perform()
    return divide.Result()


def _of_splines(shape):  # noqa: ANN001, ANN202
    """Return a shape with every surface as a spline."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_NurbsConvert

    return BRepBuilderAPI_NurbsConvert(shape, True).Shape()


def _round_things():  # noqa: ANN202
    """A cone frustum, 10 to 4 over 12 mm, with a ball of radius 6 and a ring sunk into it."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Cut, BRepAlgoAPI_Fuse
    from OCP.BRepPrimAPI import (
        BRepPrimAPI_MakeCone,
        BRepPrimAPI_MakeSphere,
        BRepPrimAPI_MakeTorus,
    )
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    cone = BRepPrimAPI_MakeCone(10.0, 4.0, 12.0).Shape()
    ball = BRepPrimAPI_MakeSphere(gp_Pnt(0, 0, 15), 6.0).Shape()
    ring = BRepPrimAPI_MakeTorus(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(0, 0, 1)), 6.0, 1.0).Shape()
    return BRepAlgoAPI_Cut(BRepAlgoAPI_Fuse(cone, ball).Shape(), ring).Shape()


def _needle():  # noqa: ANN202
    """A cone, 8 to 1e-7 over 12 mm: its upper end is as wide as the kernel is exact."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCone

    return BRepPrimAPI_MakeCone(8.0, 1e-7, 12.0).Shape()


def _two_boxes():  # noqa: ANN202
    from OCP.BRep import BRep_Builder
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt
    from OCP.TopoDS import TopoDS_Compound

    builder, both = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(both)
    builder.Add(both, BRepPrimAPI_MakeBox(10.0, 10.0, 10.0).Solid())
    builder.Add(both, BRepPrimAPI_MakeBox(gp_Pnt(20, 0, 0), 10.0, 10.0, 10.0).Solid())
    return both


def _faces(shape):  # noqa: ANN001, ANN202
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer

    found, walk = [], TopExp_Explorer(shape, TopAbs_FACE)
    while walk.More():
        found.append(walk.Current())
        walk.Next()
    return found


def _open_box():  # noqa: ANN202
    """Five faces of a box."""
    from OCP.BRep import BRep_Builder
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.TopoDS import TopoDS_Shell

    builder, shell = BRep_Builder(), TopoDS_Shell()
    builder.MakeShell(shell)
    for face in _faces(BRepPrimAPI_MakeBox(10.0, 10.0, 10.0).Shape())[:5]:
        builder.Add(shell, face)
    return shell


def write_step(shape, out: str, unit: str = "MM") -> None:  # noqa: ANN001
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    writer = STEPControl_Writer()
    Interface_Static.SetCVal_s("write.step.unit", unit)
    writer.Transfer(shape, STEPControl_AsIs)
    writer.Write(out)


def main() -> None:
    """Write all files."""
    folder = Path(sys.argv[1])
    for kind, shape in zip(
        KINDS,
        (
            _plate_with_bore(),
            _plate_with_bore(),
            _cut_up(_plate_with_bore()),
            _cut_up(_of_splines(_plate_with_bore())),
            _round_things(),
            _needle(),
            _two_boxes(),
            _open_box(),
        ),
        strict=True,
    ):
        write_step(shape, str(folder / f"{kind}.step"), "INCH" if "inches" in kind else "MM")


if __name__ == "__main__":
    main()
