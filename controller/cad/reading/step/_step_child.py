"""Read one STEP file with the STEP kernel and leave what it knows in an npz: runs as a process.

Kernels crash, hang and eat memory on damaged files, so this script is started by `step`, by its
path, with limits on its memory and its time, and no part of the controller is imported here and
nothing of the kernel there. Its facts are the kernel's own reference pages (Open CASCADE 7.9:
BRepMesh, BRepAdaptor, BRepGProp).

Usage: ``python _step_child.py FILE OUT MEMORY_BYTES CPU_S CHORD_MM CHORD_SHARE ANGLE_RAD MENDED``,
where MENDED is 1 to mend the solid first, 0 to do so only if a surface cannot be tessellated.
It ends with 0 and arrays in OUT, or with 3 and a JSON object in OUT that names the error class and
the reason.
"""

import json
import resource
import sys
from contextlib import suppress
from math import sqrt
from pathlib import Path
from typing import Any, Final

REFUSED: Final = 3  # exit code
BODY: Final = ".bin"  # file of one body, in the kernel's own format; it names no unit
CANONICAL_MM: Final = 1e-3  # a spline this close to a plane or a cylinder is one, drawn clumsily
MENDED_SHARE: Final = 1e-3  # of its volume: what mending may change
KINDS: Final = ("plane", "cylinder", "cone", "sphere", "torus", "freeform")


class RefusalError(Exception):
    """The file is read, but holds no single solid."""

    def __init__(self, error: str, reason: str) -> None:
        super().__init__(reason)
        self.error = error


def limit_resources(memory_bytes: int, cpu_s: int) -> None:
    """Bound what this process may take from the machine."""
    resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, memory_bytes))
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def read_body(path: str) -> Any:  # noqa: ANN401  the kernel's types have no stubs
    """Return a solid that `_step_bodies_child` has left."""
    from OCP.BinTools import BinTools
    from OCP.TopoDS import TopoDS, TopoDS_Shape

    shape = TopoDS_Shape()
    BinTools.Read_s(shape, path)
    return TopoDS.Solid_s(shape)


def read_shape(path: str) -> tuple[Any, str]:
    """Return the single solid of a file [mm] and the length unit the file says.

    Raises
    ------
    RefusalError : no STEP file, no shape, no surface, surfaces without a solid, or several solids
    """
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TColStd import TColStd_SequenceOfAsciiString
    from OCP.TopAbs import TopAbs_FACE, TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    reader = STEPControl_Reader()
    if reader.ReadFile(path) != IFSelect_RetDone:
        raise RefusalError("UnreadableCadError", "is no STEP file the kernel can read")
    lengths, angles, solid_angles = (TColStd_SequenceOfAsciiString() for _ in range(3))
    reader.FileUnits(lengths, angles, solid_angles)
    unit = lengths.Value(1).ToCString() if lengths.Length() else ""
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
    """Return a solid with what the kernel can mend: seams, short edges, gaps, turned faces.

    Raises
    ------
    RefusalError : what comes of it is no single solid, or a solid of another volume
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


def shapes_of(shape: Any, kind: Any) -> Any:  # noqa: ANN401  the kernel's types have no stubs
    """Return the parts of a shape of one kind, each once, numbered from 1."""
    from OCP.TopExp import TopExp
    from OCP.TopTools import TopTools_IndexedMapOfShape

    found = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, found)
    return found


class Weld:
    """Numbers for mesh corners, some of which turn out to be one."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float, float]] = []
        self.parent: list[int] = []

    def add(self, point: tuple[float, float, float]) -> int:
        """Add a corner and return its number."""
        self.points.append(point)
        self.parent.append(len(self.parent))
        return len(self.parent) - 1

    def root(self, i: int) -> int:
        """Return the number of the corner that a corner has turned out to be."""
        while self.parent[i] != i:
            self.parent[i] = self.parent[self.parent[i]]
            i = self.parent[i]
        return i

    def join(self, i: int, j: int) -> None:
        """Make two corners one."""
        i, j = self.root(i), self.root(j)
        self.parent[max(i, j)] = min(i, j)


def tessellate(solid: Any, chord_mm: float, angle_rad: float) -> dict[str, Any]:  # noqa: ANN401
    """Return the mesh, its face numbers and the edges' runs; corners of shared edges are shared.

    Faces are meshed each for itself, along edges that are divided once. What joins them here is
    the topology, the number of a point on its edge, never a distance.

    Parameters
    ----------
    solid : the kernel's ``TopoDS_Solid`` [mm]
    chord_mm : most a chord may be off its curve
    angle_rad : most the direction may turn from one chord to the next

    Returns
    -------
    arrays by name : ``vertices_mm`` (v, 3); ``triangles`` (t, 3); ``face_of_triangle`` (t,);
        ``chain`` (c,), vertices of all edges one after the other; ``chain_start`` (e + 1,), where
        each edge begins in it; ``edge_faces`` (e, 2), -1 where three faces meet and more; those of
        `curves_of`

    Raises
    ------
    RefusalError : a face cannot be tessellated, or two faces disagree about their common edge
    """
    import numpy as np
    from OCP.BRep import BRep_Tool
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.TopAbs import (
        TopAbs_EDGE,
        TopAbs_FACE,
        TopAbs_FORWARD,
        TopAbs_REVERSED,
        TopAbs_VERTEX,
    )
    from OCP.TopExp import TopExp, TopExp_Explorer
    from OCP.TopLoc import TopLoc_Location
    from OCP.TopoDS import TopoDS

    BRepMesh_IncrementalMesh(solid, chord_mm, False, angle_rad, False)
    faces, edges = shapes_of(solid, TopAbs_FACE), shapes_of(solid, TopAbs_EDGE)
    vertices = shapes_of(solid, TopAbs_VERTEX)
    weld = Weld()
    for i in range(1, vertices.Extent() + 1):
        weld.add(xyz(BRep_Tool.Pnt_s(TopoDS.Vertex_s(vertices.FindKey(i)))))
    chains: dict[int, list[int]] = {}
    edge_faces: dict[int, list[int]] = {}
    corners: list[tuple[int, int, int]] = []
    face_of: list[int] = []
    for f in range(1, faces.Extent() + 1):
        face = TopoDS.Face_s(faces.FindKey(f))
        place = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(face, place)
        if mesh is None or mesh.NbTriangles() == 0:
            raise RefusalError("OpenCadError", f"surface {f} cannot be tessellated")
        move = place.Transformation()
        nodes = [xyz(mesh.Node(i).Transformed(move)) for i in range(1, mesh.NbNodes() + 1)]
        number: dict[int, int] = {}
        walk = TopExp_Explorer(face, TopAbs_EDGE)
        while walk.More():
            edge = TopoDS.Edge_s(walk.Current())
            walk.Next()
            line = BRep_Tool.PolygonOnTriangulation_s(edge, mesh, place)
            if line is None:
                continue
            e = edges.FindIndex(edge)
            run = [line.Node(i) - 1 for i in range(1, line.NbNodes() + 1)]
            forward = TopoDS.Edge_s(edge.Oriented(TopAbs_FORWARD))
            ends = [
                vertices.FindIndex(v) - 1
                for v in (TopExp.FirstVertex_s(forward), TopExp.LastVertex_s(forward))
            ]
            if BRep_Tool.Degenerated_s(edge):
                ids = [ends[0]] * len(run)  # a pole: one point, however often it is listed
            else:
                if e not in chains:
                    middle = [weld.add(nodes[n]) for n in run[1:-1]]
                    chains[e] = [ends[0], *middle, ends[1]]
                ids = chains[e]
                edge_faces.setdefault(e, []).append(f - 1)
            if len(ids) != len(run):
                raise RefusalError("OpenCadError", f"two surfaces disagree about edge {e}")
            for n, i in zip(run, ids, strict=True):
                if n in number:
                    weld.join(number[n], i)
                number[n] = i
        ids = [number[n] if n in number else weld.add(p) for n, p in enumerate(nodes)]
        turned = face.Orientation() == TopAbs_REVERSED
        for i in range(1, mesh.NbTriangles() + 1):
            a, b, c = mesh.Triangle(i).Get()
            corners.append(
                (ids[a - 1], ids[c - 1], ids[b - 1])
                if turned
                else (ids[a - 1], ids[b - 1], ids[c - 1])
            )
            face_of.append(f - 1)
    roots = np.array([weld.root(i) for i in range(len(weld.points))])
    used, number_of = np.unique(roots, return_inverse=True)
    triangles = number_of[np.array(corners)]
    is_sound = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    order = sorted(chains)
    runs = [number_of[chains[e]] for e in order]
    starts = np.cumsum([0, *(len(run) for run in runs)])
    sides = [(edge_faces[e] * 2)[:2] if len(edge_faces[e]) < 3 else [-1, -1] for e in order]
    return {
        "vertices_mm": np.array(weld.points)[used],
        "triangles": triangles[is_sound],
        "face_of_triangle": np.array(face_of)[is_sound],
        "chain": np.concatenate(runs) if runs else np.zeros(0, int),
        "chain_start": starts,
        "edge_faces": np.array(sides).reshape(-1, 2),
        **curves_of([edges.FindKey(e) for e in order]),
    }


def xyz(p: Any) -> tuple[float, float, float]:  # noqa: ANN401
    """Return a kernel's point or direction as numbers."""
    return p.X(), p.Y(), p.Z()


def curves_of(edges: list[Any]) -> dict[str, Any]:
    """Return what each edge is: 0 a line, 1 a circle with its axis, 2 anything else."""
    import numpy as np
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.GeomAbs import GeomAbs_Circle, GeomAbs_Line
    from OCP.TopoDS import TopoDS

    kind = np.full(len(edges), 2)
    centre, axis = np.full((len(edges), 3), np.nan), np.full((len(edges), 3), np.nan)
    radius = np.full(len(edges), np.nan)
    for i, edge in enumerate(edges):
        curve = BRepAdaptor_Curve(TopoDS.Edge_s(edge))
        if curve.GetType() == GeomAbs_Line:
            kind[i] = 0
        elif curve.GetType() == GeomAbs_Circle:
            circle = curve.Circle()
            kind[i], radius[i] = 1, circle.Radius()
            centre[i], axis[i] = xyz(circle.Location()), xyz(circle.Axis().Direction())
    return {"curve": kind, "curve_centre_mm": centre, "curve_axis": axis, "curve_radius_mm": radius}


def surfaces_of(solid: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return the exact surface of each face: kind, place, axis, radii, area, centre of area."""
    import numpy as np
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopoDS import TopoDS

    faces = shapes_of(solid, TopAbs_FACE)
    count = faces.Extent()
    kind = np.zeros(count, int)
    place, axis, mean = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    radii, area = np.zeros((count, 3)), np.zeros(count)
    for i in range(count):
        face = TopoDS.Face_s(faces.FindKey(i + 1))
        name, form = surface_of(face)
        kind[i] = KINDS.index(name)
        if form is not None:
            place[i] = xyz(form.Location())
            axis[i] = xyz(form.Position().Direction())
        if name in {"cylinder", "sphere"}:
            radii[i, 0] = form.Radius()
        elif name == "cone":
            radii[i] = form.RefRadius(), 0.0, form.SemiAngle()
        elif name == "torus":
            radii[i] = form.MajorRadius(), form.MinorRadius(), 0.0
        measured = GProp_GProps()
        BRepGProp.SurfaceProperties_s(face, measured)
        area[i], mean[i] = measured.Mass(), xyz(measured.CentreOfMass())
    return {
        "kind": kind, "place_mm": place, "axis": axis, "radii": radii,
        "area_mm2": area, "mean_mm": mean,
    }  # fmt: skip


def surface_of(face: Any) -> tuple[str, Any]:  # noqa: ANN401
    """Return a face's kind and the kernel's own surface of it, None where it is free form."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import (
        GeomAbs_Cone,
        GeomAbs_Cylinder,
        GeomAbs_Plane,
        GeomAbs_Sphere,
        GeomAbs_Torus,
    )
    from OCP.gp import gp_Cone, gp_Cylinder, gp_Pln, gp_Sphere
    from OCP.ShapeAnalysis import ShapeAnalysis_CanonicalRecognition

    surface = BRepAdaptor_Surface(face)
    named = {
        GeomAbs_Plane: ("plane", surface.Plane),
        GeomAbs_Cylinder: ("cylinder", surface.Cylinder),
        GeomAbs_Cone: ("cone", surface.Cone),
        GeomAbs_Sphere: ("sphere", surface.Sphere),
        GeomAbs_Torus: ("torus", surface.Torus),
    }.get(surface.GetType())
    if named is not None:
        return named[0], named[1]()
    seen = ShapeAnalysis_CanonicalRecognition(face)
    for name, test, form in (
        ("plane", seen.IsPlane, gp_Pln()),
        ("cylinder", seen.IsCylinder, gp_Cylinder()),
        ("sphere", seen.IsSphere, gp_Sphere()),
        ("cone", seen.IsCone, gp_Cone()),
    ):
        # on splines of some exporters the kernel's recognition itself gives up
        with suppress(Exception):
            if test(CANONICAL_MM, form):
                return name, form
    return "freeform", None


def mass_of(solid: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return volume, area, centre of mass and inertia about it, of density 1, from the surfaces."""
    import numpy as np
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    volume, surface = GProp_GProps(), GProp_GProps()
    BRepGProp.VolumeProperties_s(solid, volume, 1e-6)
    BRepGProp.SurfaceProperties_s(solid, surface)
    inertia = volume.MatrixOfInertia()
    return {
        "volume_mm3": volume.Mass(),
        "centroid_mm": np.array(xyz(volume.CentreOfMass())),
        "inertia_mm5": np.array([[inertia.Value(i, j) for j in (1, 2, 3)] for i in (1, 2, 3)]),
        "surface_mm2": surface.Mass(),
    }


def extent_of(solid: Any) -> float:  # noqa: ANN401
    """Return the diagonal of the solid's box [mm]."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib

    box = Bnd_Box()
    BRepBndLib.Add_s(solid, box)
    return sqrt(float(box.SquareExtent()))


def main(argv: list[str]) -> int:
    """Read, measure, tessellate, write; return the exit code, 0 unless it refuses."""
    source, out, memory, cpu, chord, share, angle, mend = argv
    limit_resources(int(memory), int(cpu))
    import numpy as np

    try:
        solid, unit = (read_body(source), "") if source.endswith(BODY) else read_shape(source)
        chord_mm = max(float(chord), float(share) * extent_of(solid))
        is_mended = mend == "1"
        solid = mended(solid) if is_mended else solid
        try:
            mesh = tessellate(solid, chord_mm, float(angle))
        except RefusalError:
            if is_mended:
                raise
            is_mended, solid = True, mended(solid)
            mesh = tessellate(solid, chord_mm, float(angle))
        arrays = mesh | surfaces_of(solid) | mass_of(solid) | {"is_mended": np.array(is_mended)}
    except RefusalError as refusal:
        return refuse(out, refusal.error, str(refusal))
    except MemoryError:
        return refuse(out, "UnreadableCadError", "needs more memory than is granted")
    except Exception as error:  # noqa: BLE001  whatever the kernel throws is about this file
        name = type(error).__name__
        return refuse(out, "UnreadableCadError", f"the STEP kernel gave up ({name}: {error})")
    with Path(out).open("wb") as sink:
        np.savez(sink, unit=np.array(unit), **arrays)
    return 0


def refuse(out: str, error: str, reason: str) -> int:
    """Leave the reason where the parent looks for it; return the exit code.

    Parameters
    ----------
    out : file to write
    error : name of the class of `CadError` the parent is to raise
    reason : what is wrong, as it follows the file's name in a message
    """
    Path(out).write_text(json.dumps({"error": error, "reason": reason}))
    return REFUSED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
