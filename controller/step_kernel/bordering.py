"""Faces with borders that the kernel has misread get new ones, from their edges alone.

A file has a surface and its edges in space; the kernel itself computes the course of an edge on a
surface that closes upon itself, and fails if the edge runs along a pole or where the surface meets
itself. On a ball it may then take the area outside of a border for the face.
"""

from typing import Any, Final

from .ending import RefusalError
from .shapes import shapes_of, xyz

SAMPLE_COUNT: Final = 24  # points along each edge
PRECISION_MM: Final = 1e-6
DIRECTION_COUNT: Final = 36


def rebordered(solid: Any, faces: list[Any]) -> Any:  # noqa: ANN401  the kernel's types, no stubs
    """Return a solid with faces that run along their edges anew.

    Parameters
    ----------
    solid : the kernel's ``TopoDS_Solid``
    faces : those of its faces that get a new border; balls are turned as well, so that the border
        stays clear of poles, and the smaller side of it is the face

    Raises
    ------
    RefusalError : no single solid comes of it
    """
    from OCP.BRepLib import BRepLib
    from OCP.BRepTools import BRepTools_ReShape
    from OCP.TopAbs import TopAbs_SOLID
    from OCP.TopoDS import TopoDS

    changes = BRepTools_ReShape()
    for face in faces:
        changes.Replace(face, _rebordered(face))
    solids = shapes_of(changes.Apply(solid), TopAbs_SOLID)
    if solids.Extent() != 1:
        raise RefusalError("OpenCadError", "holds no solid whose surfaces have whole borders")
    found = TopoDS.Solid_s(solids.FindKey(1))
    BRepLib.OrientClosedSolid_s(found)
    return found


def balls_of(solid: Any) -> list[Any]:  # noqa: ANN401
    """Return the faces of a solid that are pieces of balls."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Sphere
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopoDS import TopoDS

    found = shapes_of(solid, TopAbs_FACE)
    faces = [TopoDS.Face_s(found.FindKey(i)) for i in range(1, found.Extent() + 1)]
    return [face for face in faces if BRepAdaptor_Surface(face).GetType() == GeomAbs_Sphere]


def _rebordered(face: Any) -> Any:  # noqa: ANN401
    """Return a face on a surface of its own, with the same edges, used in the same directions."""
    from OCP.BRep import BRep_Builder, BRep_Tool
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.ShapeFix import ShapeFix_Face
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_FORWARD, TopAbs_WIRE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Wire

    plain = TopoDS.Face_s(face.Oriented(TopAbs_FORWARD))
    if _is_round(plain):
        return face
    builder, new = BRep_Builder(), TopoDS_Face()
    builder.MakeFace(new, _own_surface(plain), BRep_Tool.Tolerance_s(plain))
    walk = TopExp_Explorer(plain, TopAbs_WIRE)
    while walk.More():
        wire = TopoDS_Wire()
        builder.MakeWire(wire)
        along = TopExp_Explorer(walk.Current().Oriented(TopAbs_FORWARD), TopAbs_EDGE)
        while along.More():
            edge = TopoDS.Edge_s(along.Current())
            if not BRep_Tool.Degenerated_s(edge):
                builder.Add(wire, edge)
            along.Next()
        builder.Add(new, wire.Oriented(walk.Current().Orientation()))
        walk.Next()
    fix = ShapeFix_Face(new)
    fix.SetPrecision(PRECISION_MM)
    fix.Perform()
    made = shapes_of(fix.Result(), TopAbs_FACE)
    if made.Extent() != 1:
        return face
    found = TopoDS.Face_s(made.FindKey(1).Oriented(TopAbs_FORWARD))
    measured = GProp_GProps()
    BRepGProp.SurfaceProperties_s(found, measured)
    if measured.Mass() < 0:  # it lies outside of its border, so the border runs the other way
        found = _turned(found)
    found.Orientation(face.Orientation())
    return found if _runs_alike(face, found) else TopoDS.Face_s(found.Reversed())


def _is_round(face: Any) -> bool:  # noqa: ANN401
    """Return whether a face is of a ball and goes all round it: its seam belongs to its poles."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.GeomAbs import GeomAbs_Sphere
    from OCP.TopAbs import TopAbs_EDGE
    from OCP.TopoDS import TopoDS

    if BRepAdaptor_Surface(face).GetType() != GeomAbs_Sphere:
        return False
    found = shapes_of(face, TopAbs_EDGE)
    edges = [TopoDS.Edge_s(found.FindKey(i)) for i in range(1, found.Extent() + 1)]
    return any(BRep_Tool.IsClosed_s(edge, face) for edge in edges)


def _turned(face: Any) -> Any:  # noqa: ANN401
    """Return a face with reversed borders."""
    from OCP.BRep import BRep_Builder
    from OCP.TopAbs import TopAbs_WIRE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    builder, new = BRep_Builder(), TopoDS.Face_s(face.EmptyCopied())
    walk = TopExp_Explorer(face, TopAbs_WIRE)
    while walk.More():
        builder.Add(new, walk.Current().Reversed())
        walk.Next()
    return new


def _runs_alike(face: Any, other: Any) -> bool:  # noqa: ANN401
    """Return whether two faces use their edges in the same directions."""
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_EDGE
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    used: list[list[Any]] = []
    for each in (face, other):
        edges, walk = [], TopExp_Explorer(each, TopAbs_EDGE)
        while walk.More():
            if not BRep_Tool.Degenerated_s(TopoDS.Edge_s(walk.Current())):
                edges.append(walk.Current())
            walk.Next()
        used.append(edges)
    alike = [a.Orientation() == b.Orientation() for a in used[0] for b in used[1] if a.IsSame(b)]
    return bool(2 * sum(alike) >= len(alike))


def _own_surface(face: Any) -> Any:  # noqa: ANN401
    """Return a face's surface, which no other face has; of a ball with its poles off the border."""
    import numpy as np
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
    from OCP.Geom import Geom_SphericalSurface
    from OCP.GeomAbs import GeomAbs_Sphere
    from OCP.gp import gp_Ax3, gp_Dir
    from OCP.TopAbs import TopAbs_EDGE
    from OCP.TopoDS import TopoDS

    surface = BRepAdaptor_Surface(face)
    if surface.GetType() != GeomAbs_Sphere:
        return BRep_Tool.Surface_s(face).Copy()
    ball = surface.Sphere()
    edges = shapes_of(face, TopAbs_EDGE)
    arms = []
    for edge in (TopoDS.Edge_s(edges.FindKey(i)) for i in range(1, edges.Extent() + 1)):
        if BRep_Tool.Degenerated_s(edge):
            continue
        curve = BRepAdaptor_Curve(edge)
        ends = curve.FirstParameter(), curve.LastParameter()
        arms += [xyz(curve.Value(t)) for t in np.linspace(*ends, SAMPLE_COUNT).tolist()]
    arm = np.array(arms).reshape(-1, 3) - xyz(ball.Location())
    arm /= np.linalg.norm(arm, axis=1)[:, None]
    middle = arm.mean(axis=0)
    if not len(arm) or np.linalg.norm(middle) < 1e-3:
        return BRep_Tool.Surface_s(face).Copy()
    middle /= np.linalg.norm(middle)
    aside = np.cross(middle, np.eye(3)[np.argmin(np.abs(middle))])
    aside /= np.linalg.norm(aside)
    turn = np.linspace(0, np.pi, DIRECTION_COUNT, endpoint=False)[:, None]
    poles = np.cos(turn) * aside + np.sin(turn) * np.cross(middle, aside)
    pole = poles[np.argmin(np.abs(poles @ arm.T).max(axis=1))]
    frame = gp_Ax3(ball.Location(), gp_Dir(*pole.tolist()), gp_Dir(*middle.tolist()))
    return Geom_SphericalSurface(frame, ball.Radius())
