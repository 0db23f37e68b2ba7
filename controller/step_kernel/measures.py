"""Exact surfaces, curves, volume and inertia of a solid, as the kernel has them."""

from contextlib import suppress
from math import sqrt
from typing import Any, Final

from .shapes import shapes_of, xyz

CANONICAL_MM: Final = 1e-3  # a spline this close to a plane or a cylinder is one, drawn clumsily
COARSE: Final = 0.01  # share of the size
KINDS: Final = ("plane", "cylinder", "cone", "sphere", "torus", "freeform")


def curves_of(edges: list[Any]) -> dict[str, Any]:
    """Return the type of each edge: 0 a line, 1 a circle with its axis, 2 anything else."""
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
    """Return the diagonal of the solid's box [mm], to `COARSE`.

    A spline's own box is that of its poles, up to half as long again; so it is divided coarsely.
    """
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib
    from OCP.BRepMesh import BRepMesh_IncrementalMesh

    loose, box = Bnd_Box(), Bnd_Box()
    BRepBndLib.Add_s(solid, loose, False)
    BRepMesh_IncrementalMesh(solid, COARSE * sqrt(float(loose.SquareExtent())), False, 1.0, False)
    BRepBndLib.Add_s(solid, box, True)
    return sqrt(float(box.SquareExtent()))
