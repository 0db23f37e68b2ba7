"""The single solid of a STEP file, or one that the list of bodies has left."""

from typing import Any, Final

from .ending import RefusalError
from .measures import mass_of
from .shapes import shapes_of, unit_of

MENDED_SHARE: Final = 1e-3  # share of its volume by which mending may change it


def read_body(path: str) -> Any:  # noqa: ANN401  the kernel's types have no stubs
    """Return a solid that `bodies` has left."""
    from OCP.BinTools import BinTools
    from OCP.TopoDS import TopoDS, TopoDS_Shape

    shape = TopoDS_Shape()
    BinTools.Read_s(shape, path)
    return TopoDS.Solid_s(shape)


def read_shape(path: str) -> tuple[Any, str]:
    """Return the single solid of a file [mm] and the file's length unit.

    Raises
    ------
    RefusalError : no STEP file, no shape, no surface, surfaces without a solid, or several solids
    """
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_FACE, TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    reader = STEPControl_Reader()
    if reader.ReadFile(path) != IFSelect_RetDone:
        raise RefusalError("UnreadableCadError", "is no STEP file the kernel can read")
    unit = unit_of(reader)
    reader.TransferRoots()
    shape = reader.OneShape()
    if shape is None or shape.IsNull():
        raise RefusalError("EmptyCadError", "holds no shape")
    solids = shapes_of(shape, TopAbs_SOLID)
    if solids.Extent() > 1:
        raise RefusalError("ManySolidsCadError", f"holds {solids.Extent()} separate bodies")
    if solids.Extent() == 0:
        face_count = shapes_of(shape, TopAbs_FACE).Extent()
        if face_count == 0:
            raise RefusalError("EmptyCadError", "holds no surface")
        raise RefusalError("OpenCadError", f"holds {face_count} surfaces that enclose no solid")
    return TopoDS.Solid_s(solids.FindKey(1)), unit


def mended(solid: Any) -> Any:  # noqa: ANN401  the kernel's types have no stubs
    """Return a solid with the kernel's repairs: seams, short edges, gaps, turned faces.

    Raises
    ------
    RefusalError : the result is no single solid, or a solid of another volume
    """
    from OCP.ShapeFix import ShapeFix_Shape
    from OCP.TopAbs import TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    fix = ShapeFix_Shape(solid)
    fix.Perform()
    solids = shapes_of(fix.Shape(), TopAbs_SOLID)
    if solids.Extent() != 1:
        raise RefusalError("OpenCadError", "holds no solid whose surfaces can be mended")
    found = TopoDS.Solid_s(solids.FindKey(1))
    before, after = (abs(mass_of(each)["volume_mm3"]) for each in (solid, found))
    if abs(after - before) > MENDED_SHARE * before:
        raise RefusalError(
            "OpenCadError", f"holds {before:.1f} mm3, and would {after:.1f} mm3 when mended"
        )
    return found
