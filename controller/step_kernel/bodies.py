"""List the bodies of one STEP file with the STEP kernel, and leave each as a file of its own.

Runs as a process, which ends as that of `solid`: with 0 and arrays in OUT, or with 3 and a JSON
object there. Facts: the kernel's reference pages (Open CASCADE 7.9: STEPCAFControl_Reader,
XCAFDoc_ShapeTool, BinTools).

Usage: ``python -m controller.step_kernel.bodies FILE OUT MEMORY_BYTES CPU_S FOLDER NAMES``; with
NAMES 0 the product structure is left alone, since reading it crashes on files whose geometry is
sound. In OUT are ``listing`` (JSON text) and, of body i, ``points_i`` (n, 3), ``sizes_i`` (n, 2):
what stays where it is, however the body is placed: kind and size of what the point belongs to. In
FOLDER, ``i.bin`` is the body in the coordinates of its own product.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from .ending import limit_resources, refuse
from .shapes import labels_of, read_document, shapes_of, unit_of, xyz

MAX_BODY_COUNT: Final = 5000
MAX_OCCURRENCE_COUNT: Final = 100_000
SHARES: Final = (0.25, 0.5, 0.75)  # shares of an edge's length: the same points from either end


class Listing:
    """The bodies found, each once for every product it is in, and its placements."""

    def __init__(self) -> None:
        self.solids: list[Any] = []
        self.bodies: list[dict[str, Any]] = []
        self.open_products: list[str] = []
        self._of_product: dict[str, list[int]] = {}
        self.occurrence_count = 0

    def place(self, key: str, product: "StepProduct", path: list[str], move: Any) -> None:  # noqa: ANN401
        """Add one occurrence of a product.

        Parameters
        ----------
        key : address of the product
        product : its shape and name
        path : names of the products it is in, outermost first
        move : its pose in the file

        Raises
        ------
        ValueError : more bodies or occurrences than are worked on
        """
        if key not in self._of_product:
            self._of_product[key] = [self._add(each, key) for each in product.bodies()]
            if not self._of_product[key] and product.has_faces():
                self.open_products.append(product.name)
        for i in self._of_product[key]:
            self.occurrence_count += 1
            if self.occurrence_count > MAX_OCCURRENCE_COUNT:
                raise ValueError(f"more than {MAX_OCCURRENCE_COUNT} bodies placed")
            self.bodies[i]["placed"].append({"in": path, "T": rows_of(move)})

    def _add(self, found: dict[str, Any], key: str) -> int:
        if len(self.solids) >= MAX_BODY_COUNT:
            raise ValueError(f"more than {MAX_BODY_COUNT} bodies")
        self.solids.append(found.pop("solid"))
        self.bodies.append(found | {"product": key, "placed": []})
        return len(self.bodies) - 1


class StepProduct:
    """A shape of its own in the product structure."""

    def __init__(self, name: str, shape: Any, named: list[tuple[str, Any]]) -> None:  # noqa: ANN401
        self.name = name
        self._shape = shape
        self._named = named

    def bodies(self) -> Iterator[dict[str, Any]]:
        """Yield each solid, with its own name where the product holds several and names them."""
        from OCP.TopAbs import TopAbs_SOLID
        from OCP.TopoDS import TopoDS

        found = shapes_of(self._shape, TopAbs_SOLID)
        for i in range(1, found.Extent() + 1):
            solid = TopoDS.Solid_s(found.FindKey(i))
            own = [name for name, shape in self._named if name and shape.IsSame(solid)]
            name = own[0] if own and found.Extent() > 1 else self.name
            yield {"solid": solid, "name": name, "number": i, "of": found.Extent()}

    def has_faces(self) -> bool:
        """Return whether there are surfaces, which enclose nothing."""
        from OCP.TopAbs import TopAbs_FACE

        return bool(shapes_of(self._shape, TopAbs_FACE).Extent())


def rows_of(move: Any) -> list[list[float]]:  # noqa: ANN401
    """Return a kernel's placing as a pose (4, 4)."""
    trsf = move.Transformation()
    return [[trsf.Value(i, j) for j in (1, 2, 3, 4)] for i in (1, 2, 3)] + [[0.0, 0.0, 0.0, 1.0]]


def read_named(path: str) -> tuple[Listing, str]:
    """Return the bodies of a file by its product structure, and the file's length unit.

    Raises
    ------
    ValueError : the kernel does not read the file, or there are too many
    """
    from OCP.TDF import TDF_LabelSequence
    from OCP.TopLoc import TopLoc_Location
    from OCP.XCAFDoc import XCAFDoc_DocumentTool

    document, reader = read_document(path, has_tolerances=False)
    listing, free = Listing(), TDF_LabelSequence()
    XCAFDoc_DocumentTool.ShapeTool_s(document.Main()).GetFreeShapes(free)
    for label in labels_of(free):
        add_placed(label, [], TopLoc_Location(), listing)
    return listing, unit_of(reader.ChangeReader())


def add_placed(label: Any, path: list[str], move: Any, listing: Listing) -> None:  # noqa: ANN401
    """Add the objects that a label of the product structure places, in its parent's pose.

    Parameters
    ----------
    label : label of the kernel's document
    path : names of the products it is in, outermost first
    move : pose of what it is in
    listing : receives the bodies
    """
    from OCP.TDF import TDF_Label, TDF_LabelSequence
    from OCP.XCAFDoc import XCAFDoc_ShapeTool as Shapes

    if Shapes.IsReference_s(label):
        move = move.Multiplied(Shapes.GetLocation_s(label))
        product, instance = TDF_Label(), label
        Shapes.GetReferredShape_s(label, product)
    else:
        product, instance = label, label
    name = name_of(product) or name_of(instance)
    below = TDF_LabelSequence()
    if Shapes.IsAssembly_s(product):
        Shapes.GetComponents_s(product, below, False)
        for each in labels_of(below):
            add_placed(each, [*path, name], move, listing)
        return
    shape = Shapes.GetShape_s(product)
    if shape is None or shape.IsNull():
        return
    Shapes.GetSubShapes_s(product, below)
    named = [(name_of(each), Shapes.GetShape_s(each)) for each in labels_of(below)]
    listing.place(entry_of(product), StepProduct(name, shape, named), path, move)


def read_plain(path: str) -> tuple[Listing, str]:
    """Return the bodies of a file without their names, placed as the file has them.

    Raises
    ------
    ValueError : the kernel does not read the file, or there are too many
    """
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopLoc import TopLoc_Location

    reader = STEPControl_Reader()
    if reader.ReadFile(path) != IFSelect_RetDone:
        raise ValueError("is no STEP file the kernel can read")
    unit = unit_of(reader)
    reader.TransferRoots()
    listing, shape = Listing(), reader.OneShape()
    if shape is not None and not shape.IsNull():
        listing.place("", StepProduct("", shape, []), [], TopLoc_Location())
    return listing, unit


def name_of(label: Any) -> str:  # noqa: ANN401
    """Return the name of a label, empty where it has none."""
    from OCP.TDataStd import TDataStd_Name

    name = TDataStd_Name()
    has_name = label.FindAttribute(TDataStd_Name.GetID_s(), name)
    return str(name.Get().ToExtString()) if has_name else ""


def entry_of(label: Any) -> str:  # noqa: ANN401
    """Return a label's address in its document."""
    from OCP.TCollection import TCollection_AsciiString
    from OCP.TDF import TDF_Tool

    entry = TCollection_AsciiString()
    TDF_Tool.Entry_s(label, entry)
    return str(entry.ToCString())


def measures_of(solid: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return size, volume, area, centre of mass and principal moments of a solid of density 1."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    box = Bnd_Box()
    BRepBndLib.AddOptimal_s(solid, box, False, False)
    low, high = xyz(box.CornerMin()), xyz(box.CornerMax())
    volume, surface = GProp_GProps(), GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, volume, 1e-6)
    BRepGProp.SurfaceProperties_s(solid, surface)
    return {
        "size_mm": [b - a for a, b in zip(low, high, strict=True)],
        "volume_mm3": volume.Mass(),
        "area_mm2": surface.Mass(),
        "centroid_mm": xyz(volume.CentreOfMass()),
        "moments_mm5": sorted(volume.PrincipalProperties().Moments()),
    }


def marks_of(solid: Any) -> tuple[Any, Any]:  # noqa: ANN401
    """Return points of the body itself, with kind and size of the element each belongs to.

    Centres of faces (kind 0, root of the area), points along edges (kind 1, their length), and
    corners (kind 2).
    """
    import numpy as np
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.BRepGProp import BRepGProp
    from OCP.GCPnts import GCPnts_AbscissaPoint
    from OCP.GProp import GProp_GProps
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_VERTEX
    from OCP.TopoDS import TopoDS

    points: list[tuple[float, float, float]] = []
    sizes: list[tuple[float, float]] = []
    faces, edges = shapes_of(solid, TopAbs_FACE), shapes_of(solid, TopAbs_EDGE)
    corners = shapes_of(solid, TopAbs_VERTEX)
    for i in range(1, faces.Extent() + 1):
        measured = GProp_GProps()
        BRepGProp.SurfaceProperties_s(faces.FindKey(i), measured)
        points.append(xyz(measured.CentreOfMass()))
        sizes.append((0.0, abs(measured.Mass()) ** 0.5))
    for i in range(1, edges.Extent() + 1):
        edge = TopoDS.Edge_s(edges.FindKey(i))
        if BRep_Tool.Degenerated_s(edge):
            continue
        curve = BRepAdaptor_Curve(edge)
        length = GCPnts_AbscissaPoint.Length_s(curve)
        for share in SHARES:
            along = GCPnts_AbscissaPoint(curve, share * length, curve.FirstParameter())
            points.append(xyz(curve.Value(along.Parameter())))
            sizes.append((1.0, length))
    for i in range(1, corners.Extent() + 1):
        points.append(xyz(BRep_Tool.Pnt_s(TopoDS.Vertex_s(corners.FindKey(i)))))
        sizes.append((2.0, 0.0))
    return np.array(points).reshape(-1, 3), np.array(sizes).reshape(-1, 2)


def main(argv: list[str]) -> int:
    """List the bodies and write them; return the exit code, 0 unless it refuses."""
    source, out, memory, cpu, folder, names = argv
    limit_resources(int(memory), int(cpu))
    import numpy as np
    from OCP.BinTools import BinTools

    arrays: dict[str, Any] = {}
    try:
        listing, unit = (read_named if int(names) else read_plain)(source)
        for i, solid in enumerate(listing.solids):
            listing.bodies[i] |= measures_of(solid)
            arrays[f"points_{i}"], arrays[f"sizes_{i}"] = marks_of(solid)
            BinTools.Write_s(solid, str(Path(folder) / f"{i}.bin"))
    except MemoryError:
        return refuse(out, "UnreadableCadError", "needs more memory than is granted")
    except Exception as error:  # noqa: BLE001  whatever the kernel throws is about this file
        return refuse(
            out, "UnreadableCadError", f"the STEP kernel gave up ({type(error).__name__}: {error})"
        )
    text = json.dumps({"unit": unit, "bodies": listing.bodies, "open": listing.open_products})
    with Path(out).open("wb") as sink:
        np.savez(sink, listing=np.array(text), **arrays)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
