"""Helpers of all processes of the kernel for its shapes and documents."""

from typing import Any


def shapes_of(shape: Any, kind: Any) -> Any:  # noqa: ANN401  the kernel's types have no stubs
    """Return the parts of a shape of one kind, each once, numbered from 1."""
    from OCP.TopExp import TopExp
    from OCP.TopTools import TopTools_IndexedMapOfShape

    found = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, found)
    return found


def xyz(p: Any) -> tuple[float, float, float]:  # noqa: ANN401
    """Return a kernel's point or direction as numbers."""
    return p.X(), p.Y(), p.Z()


def unit_of(reader: Any) -> str:  # noqa: ANN401
    """Return the length unit of a file, in the kernel's spelling."""
    from OCP.TColStd import TColStd_SequenceOfAsciiString

    lengths, angles, solid_angles = (TColStd_SequenceOfAsciiString() for _ in range(3))
    reader.FileUnits(lengths, angles, solid_angles)
    return lengths.Value(1).ToCString() if lengths.Length() else ""


def labels_of(sequence: Any) -> list[Any]:  # noqa: ANN401
    """Return a kernel's sequence as a list."""
    return [sequence.Value(i) for i in range(1, sequence.Length() + 1)]


def read_document(path: str, *, has_tolerances: bool) -> tuple[Any, Any]:
    """Return the document of a file, and the reader that has read it.

    Parameters
    ----------
    path : path of the file
    has_tolerances : True to read dimensions, tolerances, datums and what goes with the geometry;
        False to read the product structure with its names and nothing else

    Raises
    ------
    ValueError : the kernel does not read the file
    """
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFApp import XCAFApp_Application

    kind = TCollection_ExtendedString("MDTV-XCAF")
    document = TDocStd_Document(kind)
    XCAFApp_Application.GetApplication_s().NewDocument(kind, document)
    reader = STEPCAFControl_Reader()
    if has_tolerances:
        reader.SetGDTMode(True)
    else:
        Interface_Static.SetIVal_s("read.stepcaf.subshapes.name", 1)
        for leave_out in ("Color", "Layer", "Props", "GDT", "Mat", "View"):
            getattr(reader, f"Set{leave_out}Mode")(False)
    if reader.ReadFile(path) != IFSelect_RetDone or not reader.Transfer(document):
        raise ValueError("the kernel does not read its product structure or attributes")
    return document, reader
