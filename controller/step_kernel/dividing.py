"""Fineness of a solid's division: by its size, and face by face until the tolerance is met.

The kernel's own bound on the distance of triangles from a curved face does not hold: balls exceed
it by a factor of two, and some borders by thirteen; rings are divided many times finer than needed.
So faces are divided coarsely, each is measured, and those beyond the tolerance are divided again,
along the same points of their edges.
"""

from typing import Any, Final

from .measures import surface_of
from .shapes import shapes_of, xyz

# Chords of edges. Triangles inside a face may be off twice as much: 0.02 mm of a part of 50 mm is
# what outlines and sight lines need, more of a larger part. A chord of 0.05 mm is what drawn edges
# may be off, so it is kept up to half a metre.
CHORD_SHARE: Final = 1.5e-4  # of the diagonal
CHORD_MM: Final = 0.01  # least chord: a fifth of the error allowed to drawn edges
# largest chord, except for parts so large that it is less than the share above
CHORD_MM_MAX: Final = 0.05
FAR_SHARE: Final = 1e-4
STRAY: Final = (
    2.1  # of the chord: what triangles may be off a face; the kernel leaves balls at 2.07
)
TURN_SHARE: Final = 2.0  # multiple of the chords' angle that the kernel gets inside a face
# Of the chord, tried inside faces, in turn. Less than a chord would divide the edges anew, and with
# them all other faces.
LEVELS: Final = (8.0, 4.0, 2.0, 1.4, 1.0)
MEASURED_COUNT: Final = 400  # triangles of a free-form face, the largest first
INSIDE: Final = ((1 / 3, 1 / 3, 1 / 3), (0.5, 0.5, 0.0), (0.0, 0.5, 0.5), (0.5, 0.0, 0.5))
EXACT: Final = 0.1  # share of the chord to which edges count as exact
KEPT: Final = 1e-9  # the deflection that makes the kernel keep a face as it is divided


def chord_of(extent_mm: float) -> float:
    """Return the chord tolerance of edges in a solid of a given diagonal [mm]."""
    share = min(CHORD_SHARE * extent_mm, CHORD_MM_MAX)
    return max(CHORD_MM, share, FAR_SHARE * extent_mm)


def divide(solid: Any, chord_mm: float, angle_rad: float) -> None:  # noqa: ANN401  no stubs
    """Give each face of a solid its triangles, as the kernel keeps them.

    Parameters
    ----------
    solid : the kernel's ``TopoDS_Solid`` [mm]
    chord_mm : most a chord of an edge may be off; triangles inside a face `STRAY` times that
    angle_rad : most the direction may turn from one chord to the next
    """
    from OCP.BRepTools import BRepTools
    from OCP.ShapeFix import ShapeFix_ShapeTolerance
    from OCP.TopAbs import TopAbs_FACE
    from OCP.TopoDS import TopoDS

    BRepTools.Clean_s(solid)
    # the kernel divides no finer than edges are exact, and files state that of some too coarsely
    ShapeFix_ShapeTolerance().LimitTolerance(solid, 0.0, EXACT * chord_mm)
    found = shapes_of(solid, TopAbs_FACE)
    faces = [TopoDS.Face_s(found.FindKey(i)) for i in range(1, found.Extent() + 1)]
    curved = [(face, *surface_of(face)) for face in faces]
    curved = [one for one in curved if one[1] != "plane"]
    for level in LEVELS:
        _run(solid, chord_mm, angle_rad, level * chord_mm)
        straying = [one for one in curved if stray_mm(*one) > STRAY * chord_mm]
        if not straying or level == LEVELS[-1]:
            return
        for face in faces:
            _keep(face)
        for face, _, _ in straying:
            BRepTools.Clean_s(face)
        curved = straying


def _run(solid: Any, chord_mm: float, angle_rad: float, inside_mm: float) -> None:  # noqa: ANN401
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.IMeshTools import IMeshTools_Parameters

    asked = IMeshTools_Parameters()
    asked.Deflection, asked.Angle = chord_mm, angle_rad
    asked.DeflectionInterior, asked.AngleInterior = inside_mm, TURN_SHARE * angle_rad
    BRepMesh_IncrementalMesh(solid, asked)


def _keep(face: Any) -> None:  # noqa: ANN401
    from OCP.BRep import BRep_Tool
    from OCP.TopLoc import TopLoc_Location

    mesh = BRep_Tool.Triangulation_s(face, TopLoc_Location())
    if mesh is not None:
        mesh.Deflection(KEPT)


def stray_mm(face: Any, kind: str, form: Any) -> float:  # noqa: ANN401
    """Return the largest distance of a face's triangles from its surface, 0 where it has none.

    Parameters
    ----------
    face : the kernel's ``TopoDS_Face``
    kind, form : kind and form of its surface, as in `surface_of`
    """
    import numpy as np
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.TopLoc import TopLoc_Location

    place = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, place)
    if mesh is None or mesh.NbTriangles() == 0:
        return 0.0
    move = place.Transformation()
    nodes = np.array([xyz(mesh.Node(i).Transformed(move)) for i in range(1, mesh.NbNodes() + 1)])
    corners = np.array([mesh.Triangle(i).Get() for i in range(1, mesh.NbTriangles() + 1)]) - 1
    a, b, c = (nodes[corners[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    doubled = np.linalg.norm(normal, axis=1)
    points = np.array(INSIDE) @ nodes[corners]  # (t, 4, 3)
    if form is not None:
        off = np.abs(_off(kind, form, points.reshape(-1, 3)))
        return float(off.reshape(points.shape[:2])[doubled > 0].max(initial=0.0))
    if not mesh.HasUVNodes():
        return 0.0
    surface = BRepAdaptor_Surface(face, False)
    flat = np.array([(p.X(), p.Y()) for p in map(mesh.UVNode, range(1, mesh.NbNodes() + 1))])
    chosen = np.argsort(-doubled, kind="stable")[:MEASURED_COUNT]
    chosen = chosen[doubled[chosen] > 0]
    places = (np.array(INSIDE) @ flat[corners[chosen]]).reshape(-1, 2)
    on = np.array([xyz(surface.Value(u, v)) for u, v in places.tolist()]).reshape(-1, 4, 3)
    along = ((on - points[chosen]) * normal[chosen, None]).sum(axis=2) / doubled[chosen, None]
    return float(np.abs(along).max(initial=0.0))


def _off(kind: str, form: Any, points: Any) -> Any:  # noqa: ANN401
    """Return the distances of points (n, 3) from a surface of revolution."""
    import numpy as np

    arm = points - xyz(form.Location())
    if kind == "sphere":
        return np.linalg.norm(arm, axis=1) - form.Radius()
    height = arm @ xyz(form.Position().Direction())
    away = np.sqrt(np.maximum((arm**2).sum(axis=1) - height**2, 0.0))
    if kind == "torus":
        return np.hypot(away - form.MajorRadius(), height) - form.MinorRadius()
    if kind == "cylinder":
        return away - form.Radius()
    half = form.SemiAngle()  # beyond its apex a cone has a second half
    return (away - np.abs(form.RefRadius() + height * np.tan(half))) * np.cos(half)
