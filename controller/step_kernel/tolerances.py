"""Read the semantic tolerances of one STEP file with the STEP kernel: runs as a process.

Apart from `solid`, since reading with attributes crashes on files whose geometry is sound.
Facts: the kernel's reference pages (Open CASCADE 7.9: XCAFDoc_DimTolTool, XCAFDimTolObjects) and
cell-facts.md 4. Values of dimensions are left as the kernel gives them, which is wrong in part;
the parent mends them from the file's text.

Usage: ``python -m controller.step_kernel.tolerances FILE OUT MEMORY_BYTES CPU_S PRODUCT
NUMBER``: of one solid of a product, by the product's address as `bodies` has it; "" and 0 for the
whole file. It ends with 0 and in OUT the JSON text ``pmi`` and, for each surface that text names by
number, ``area_mm2`` and ``mean_mm``.
"""

import json
import sys
from pathlib import Path
from typing import Any, Final

from .ending import limit_resources, refuse
from .shapes import labels_of, read_document, shapes_of, xyz

NO_DIMENSION: Final = ("Location_None", "CommonLabel", "DimensionPresentation")


class Surfaces:
    """Numbers for the faces of the document, with the keys that distinguish them."""

    def __init__(self, document: Any, product: str, number: int) -> None:  # noqa: ANN401  no stubs
        from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_SOLID
        from OCP.TopExp import TopExp
        from OCP.TopTools import TopTools_IndexedDataMapOfShapeListOfShape
        from OCP.XCAFDoc import XCAFDoc_DocumentTool

        self.tool = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
        self.faces_at = TopTools_IndexedDataMapOfShapeListOfShape()
        whole = self.tool.GetOneShape()
        if product:
            whole = shapes_of(shape_at(document, product), TopAbs_SOLID).FindKey(number)
        self.faces = shapes_of(whole, TopAbs_FACE)
        TopExp.MapShapesAndAncestors_s(whole, TopAbs_EDGE, TopAbs_FACE, self.faces_at)

    def named(self, labels: Any) -> list[int]:  # noqa: ANN401
        """Return the numbers of the faces of labels; an edge represents the faces it bounds."""
        from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE
        from OCP.TopExp import TopExp_Explorer

        found: set[int] = set()
        for i in range(1, labels.Length() + 1):
            shape = self.tool.GetShape_s(labels.Value(i))
            if shape is None or shape.IsNull():
                continue
            if shape.ShapeType() == TopAbs_EDGE:
                if self.faces_at.Contains(shape):
                    found |= {self.faces.FindIndex(f) for f in self.faces_at.FindFromKey(shape)}
                continue
            walk = TopExp_Explorer(shape, TopAbs_FACE)
            while walk.More():
                found.add(self.faces.FindIndex(walk.Current()))
                walk.Next()
        return sorted(i - 1 for i in found if i > 0)

    def measures(self) -> dict[str, Any]:
        """Return area and centre of area of each face."""
        import numpy as np
        from OCP.BRepGProp import BRepGProp
        from OCP.GProp import GProp_GProps

        area, mean = [], []
        for i in range(1, self.faces.Extent() + 1):
            measured = GProp_GProps()
            BRepGProp.SurfaceProperties_s(self.faces.FindKey(i), measured)
            area.append(measured.Mass())
            mean.append(xyz(measured.CentreOfMass()))
        return {"area_mm2": np.array(area), "mean_mm": np.array(mean).reshape(-1, 3)}


def shape_at(document: Any, entry: str) -> Any:  # noqa: ANN401
    """Return the shape of a product, by its address in the document, in its own coordinates."""
    from OCP.TCollection import TCollection_AsciiString
    from OCP.TDF import TDF_Label, TDF_Tool
    from OCP.XCAFDoc import XCAFDoc_ShapeTool

    label = TDF_Label()
    TDF_Tool.Label_s(document.GetData(), TCollection_AsciiString(entry), label)
    return XCAFDoc_ShapeTool.GetShape_s(label)


def name_of(value: Any, prefix: str) -> str:  # noqa: ANN401
    """Return the end of an enumeration's name, as ``Size_Diameter``."""
    return str(value).rsplit(".", 1)[-1].removeprefix(prefix)


def read_pmi(document: Any, surfaces: Surfaces) -> dict[str, Any]:  # noqa: ANN401
    """Return the content of the document, in plain values."""
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    tool = XCAFDoc_DocumentTool.DimTolTool_s(document.Main())
    dimensions, tolerances, datums = (TDF_LabelSequence() for _ in range(3))
    tool.GetDimensionLabels(dimensions)
    tool.GetGeomToleranceLabels(tolerances)
    tool.GetDatumLabels(datums)
    every = [dimension(label, surfaces) for label in labels_of(dimensions)]
    return {
        "counts": [dimensions.Length(), tolerances.Length(), datums.Length()],
        "dimensions": [d for d in every if d["kind"] not in NO_DIMENSION],
        "tolerances": [tolerance(label, tool, surfaces) for label in labels_of(tolerances)],
        "datums": [datum(label, surfaces) for label in labels_of(datums)],
    }


def references(label: Any, surfaces: Surfaces) -> tuple[list[int], list[int]]:  # noqa: ANN401
    """Return the faces at the first and at the second end of a label's dimension."""
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_DimTolTool

    first, second = TDF_LabelSequence(), TDF_LabelSequence()
    XCAFDoc_DimTolTool.GetRefShapeLabel_s(label, first, second)
    return surfaces.named(first), surfaces.named(second)


def dimension(label: Any, surfaces: Surfaces) -> dict[str, Any]:  # noqa: ANN401
    """Return a dimension as the kernel reads it: its signs and units cannot be trusted."""
    from OCP.XCAFDoc import XCAFDoc_Dimension

    # find or create: looking the attribute up raises where the kernel keeps it lazily
    held = XCAFDoc_Dimension.Set_s(label).GetObject()
    faces, others = references(label, surfaces)
    pmi = {
        "kind": name_of(held.GetType(), "XCAFDimTolObjects_DimensionType_"),
        "value": held.GetValue(),
        "faces": faces,
        "others": others,
    }
    if held.IsDimWithRange():
        pmi["limits"] = [held.GetLowerBound(), held.GetUpperBound()]
    if held.IsDimWithPlusMinusTolerance():
        pmi["deviations"] = [held.GetLowerTolValue(), held.GetUpperTolValue()]
    return pmi


def tolerance(label: Any, tool: Any, surfaces: Surfaces) -> dict[str, Any]:  # noqa: ANN401
    """Return a geometric tolerance; the kernel has converted its value to mm.

    Parameters
    ----------
    label : label of the tolerance in the kernel's document
    tool : the document's tool for dimensions and tolerances; not asked here
    surfaces : the faces it may refer to
    """
    from OCP.TDF import TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_Datum, XCAFDoc_DimTolTool, XCAFDoc_GeomTolerance

    held = XCAFDoc_GeomTolerance.Set_s(label).GetObject()
    named = TDF_LabelSequence()
    XCAFDoc_DimTolTool.GetDatumWithObjectOfTolerLabels_s(label, named)
    letters: dict[str, int] = {}  # a datum of several targets is listed once for each
    for each in labels_of(named):
        held_datum = XCAFDoc_Datum.Set_s(each).GetObject()
        letters.setdefault(held_datum.GetName().ToCString(), held_datum.GetPosition())
    return {
        "kind": name_of(held.GetType(), "XCAFDimTolObjects_GeomToleranceType_"),
        "value_mm": held.GetValue(),
        "zone": name_of(held.GetTypeOfValue(), "XCAFDimTolObjects_GeomToleranceTypeValue_"),
        "material": name_of(
            held.GetMaterialRequirementModifier(), "XCAFDimTolObjects_GeomToleranceMatReqModif_"
        ),
        "datums": sorted(letters, key=lambda letter: letters[letter]),
        "faces": references(label, surfaces)[0],
    }


def datum(label: Any, surfaces: Surfaces) -> dict[str, Any]:  # noqa: ANN401
    """Return a datum, or one of a tolerance's references to it: the kernel lists both as one."""
    from OCP.XCAFDoc import XCAFDoc_Datum

    name = XCAFDoc_Datum.Set_s(label).GetObject().GetName()
    letter = "" if name is None else name.ToCString()
    return {"letter": letter, "faces": references(label, surfaces)[0]}


def main(argv: list[str]) -> int:
    """Read the tolerances and write them; return the exit code, 0 unless it refuses."""
    source, out, memory, cpu, product, number = argv
    limit_resources(int(memory), int(cpu))
    import numpy as np

    try:
        document, _ = read_document(source, has_tolerances=True)
        surfaces = Surfaces(document, product, int(number))
        pmi, measures = read_pmi(document, surfaces), surfaces.measures()
    except Exception as error:  # noqa: BLE001  whatever the kernel throws is about this file
        reason = f"the STEP kernel gave up ({type(error).__name__}: {error})"
        return refuse(out, "UnreadableCadError", reason)
    with Path(out).open("wb") as sink:
        np.savez(sink, pmi=np.array(json.dumps(pmi)), **measures)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
