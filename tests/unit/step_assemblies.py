"""STEP files of several bodies with known content, made by the STEP kernel.

Runs as a process of its own, so that the kernel is never imported beside the tests:
``python step_assemblies.py FOLDER``. Lengths are in millimetres.

``rack.step``: the assembly "rack" of

- "plate" (60 x 40 x 10), once, at (100, 0, 0);
- "pin" (radius 3, length 20, axis z): twice in the assembly "pair", which is there twice, and once
  more under the name "dowel", as a product of its own, lying along x;
- a second product that is called "pin", too (radius 3, length 30);
- "left" and "right", mirror images of each other;
- "Griff \u00fc 1/2", a name with an umlaut, blanks and a slash (10 x 20 x 35);
- "skin", five faces of a box.

``blocks.step``: one product of three solids without names, two of one shape, turned.
``split/``: "rack" with a file for each product.
"""

from __future__ import annotations

import subprocess
import sys
from math import pi
from pathlib import Path

HANDLE = "Griff \u00fc 1/2"


def write_assemblies(folder: Path) -> Path:
    """Write all files; one process, since the kernel is slow to start."""
    command = [sys.executable, str(Path(__file__)), str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


def _box(x, y, z, at=(0.0, 0.0, 0.0)):  # noqa: ANN001, ANN202  the kernel's types have no stubs
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
    from OCP.gp import gp_Pnt

    return BRepPrimAPI_MakeBox(gp_Pnt(*at), x, y, z).Solid()


def _pin(length, along=(0, 0, 1)):  # noqa: ANN001, ANN202
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCylinder
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    return BRepPrimAPI_MakeCylinder(gp_Ax2(gp_Pnt(0, 0, 0), gp_Dir(*along)), 3.0, length).Solid()


def _handed(sign):  # noqa: ANN001, ANN202
    """Three boxes in steps to one side: no turn takes one to its mirror image."""
    from OCP.BRepAlgoAPI import BRepAlgoAPI_Fuse

    foot = _box(30.0, 10.0, 5.0)
    post = _box(10.0, 10.0, 20.0)
    arm = _box(10.0, 15.0, 5.0, (0.0, 10.0 if sign > 0 else -15.0, 15.0))
    return BRepAlgoAPI_Fuse(BRepAlgoAPI_Fuse(foot, post).Shape(), arm).Shape()


def _at(x, y, z, turn=0.0):  # noqa: ANN001, ANN202
    from OCP.gp import gp_Ax1, gp_Dir, gp_Pnt, gp_Trsf, gp_Vec
    from OCP.TopLoc import TopLoc_Location

    turned, moved = gp_Trsf(), gp_Trsf()
    turned.SetRotation(gp_Ax1(gp_Pnt(0, 0, 0), gp_Dir(1, 0, 0)), turn)
    moved.SetTranslation(gp_Vec(x, y, z))
    return TopLoc_Location(moved.Multiplied(turned))


def _solid_in(shape):  # noqa: ANN001, ANN202
    from OCP.TopAbs import TopAbs_SOLID
    from OCP.TopExp import TopExp_Explorer

    return TopExp_Explorer(shape, TopAbs_SOLID).Current()


def _skin():  # noqa: ANN202
    from OCP.BRep import BRep_Builder
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS_Shell

    builder, shell = BRep_Builder(), TopoDS_Shell()
    builder.MakeShell(shell)
    walk = TopExp_Explorer(_box(10.0, 10.0, 10.0), TopAbs_FACE)
    for _ in range(5):
        builder.Add(shell, walk.Current())
        walk.Next()
    return shell


def _document():  # noqa: ANN202
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFApp import XCAFApp_Application

    kind = TCollection_ExtendedString("MDTV-XCAF")
    document = TDocStd_Document(kind)
    XCAFApp_Application.GetApplication_s().NewDocument(kind, document)
    return document


def _rack():  # noqa: ANN202
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document = _document()
    tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())

    def product(name, shape=None):  # noqa: ANN001, ANN202
        label = tool.NewShape() if shape is None else tool.AddShape(shape, False)
        TDataStd_Name.Set_s(label, TCollection_ExtendedString(name, True))
        return label

    rack, pair, pin = product("rack"), product("pair"), product("pin", _pin(20.0))
    for y in (0.0, 15.0):
        tool.AddComponent(pair, pin, _at(0, y, 0))
    for z in (0.0, 50.0):
        tool.AddComponent(rack, pair, _at(0, 0, z))
    tool.AddComponent(rack, product("plate", _box(60.0, 40.0, 10.0)), _at(100, 0, 0))
    for name, shape in (
        ("pin", _pin(30.0)),
        ("dowel", _pin(20.0, (1, 0, 0))),
        ("left", _solid_in(_handed(1))),
        ("right", _solid_in(_handed(-1))),
        (HANDLE, _box(10.0, 20.0, 35.0)),
        ("skin", _skin()),
    ):
        tool.AddComponent(rack, product(name, shape), TopLoc_Location())
    tool.UpdateAssemblies()
    return document


def _blocks():  # noqa: ANN202
    from OCP.BRep import BRep_Builder
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.TopoDS import TopoDS_Compound

    builder, all_of_it = BRep_Builder(), TopoDS_Compound()
    builder.MakeCompound(all_of_it)
    turned = BRepBuilderAPI_Transform(
        _solid_in(_handed(1)), _at(70, 0, 0, pi / 3).Transformation(), True
    )
    for solid in (_solid_in(_handed(1)), _box(10.0, 10.0, 12.0, (200.0, 0, 0)), turned.Shape()):
        builder.Add(all_of_it, solid)
    return all_of_it


def main() -> None:
    """Write all files."""
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

    folder = Path(sys.argv[1])
    (folder / "split").mkdir()
    document = _rack()
    whole = STEPCAFControl_Writer()
    whole.Transfer(document, STEPControl_AsIs)
    whole.Write(str(folder / "rack.step"))
    in_files = STEPCAFControl_Writer()
    in_files.Transfer(document, STEPControl_AsIs, "part-")
    in_files.Write(str(folder / "split" / "rack.step"))
    blocks = STEPControl_Writer()
    blocks.Transfer(_blocks(), STEPControl_AsIs)
    blocks.Write(str(folder / "blocks.step"))


if __name__ == "__main__":
    main()
