"""The mesh of a solid: faces divided each for itself, joined at the edges they share."""

from typing import Any

from .closing import close
from .dividing import divide
from .ending import RefusalError
from .measures import curves_of
from .shapes import shapes_of, xyz


class Weld:
    """Numbers for mesh corners, some of which turn out to be the same."""

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


class UndividedError(RefusalError):
    """The kernel makes no triangles of some faces."""

    def __init__(self, faces: list[Any], numbers: list[int]) -> None:
        named = ", ".join(map(str, numbers))
        which = f"surface {named}" if len(faces) == 1 else f"surfaces {named}"
        super().__init__("OpenCadError", f"{which} cannot be tessellated")
        self.faces = faces


class JoinedFaces:
    """The triangles of faces, joined along the edges that the faces share.

    Parameters
    ----------
    weld : numbers of corners, the solid's vertices first
    edges, vertices : the solid's, as the kernel numbers them, from 1

    Attributes
    ----------
    chains : corners of each edge, in its own direction
    edge_faces : faces at each edge, from 0
    corners, face_of : corners of each triangle, and its face
    """

    def __init__(self, weld: Weld, edges: Any, vertices: Any) -> None:  # noqa: ANN401
        self._weld, self._edges, self._vertices = weld, edges, vertices
        self.chains: dict[int, list[int]] = {}
        self.edge_faces: dict[int, list[int]] = {}
        self.corners: list[tuple[int, int, int]] = []
        self.face_of: list[int] = []

    def take(self, number: int, face: Any) -> bool:  # noqa: ANN401
        """Take a face's triangles; return whether it has any.

        Raises
        ------
        RefusalError : two faces disagree about their common edge
        """
        from OCP.BRep import BRep_Tool
        from OCP.TopAbs import TopAbs_EDGE, TopAbs_REVERSED
        from OCP.TopExp import TopExp_Explorer
        from OCP.TopLoc import TopLoc_Location
        from OCP.TopoDS import TopoDS

        place = TopLoc_Location()
        mesh = BRep_Tool.Triangulation_s(face, place)
        if mesh is None or mesh.NbTriangles() == 0:
            return False
        move = place.Transformation()
        nodes = [xyz(mesh.Node(i).Transformed(move)) for i in range(1, mesh.NbNodes() + 1)]
        known: dict[int, int] = {}
        walk = TopExp_Explorer(face, TopAbs_EDGE)
        while walk.More():
            edge = TopoDS.Edge_s(walk.Current())
            walk.Next()
            line = BRep_Tool.PolygonOnTriangulation_s(edge, mesh, place)
            if line is None:
                continue
            run = [line.Node(i) - 1 for i in range(1, line.NbNodes() + 1)]
            for n, i in zip(
                run, self._corners_along(edge, [nodes[n] for n in run], number), strict=True
            ):
                if n in known:
                    self._weld.join(known[n], i)
                known[n] = i
        ids = [known[n] if n in known else self._weld.add(p) for n, p in enumerate(nodes)]
        turned = face.Orientation() == TopAbs_REVERSED
        for i in range(1, mesh.NbTriangles() + 1):
            a, b, c = (ids[n - 1] for n in mesh.Triangle(i).Get())
            self.corners.append((a, c, b) if turned else (a, b, c))
            self.face_of.append(number)
        return True

    def _corners_along(
        self,
        edge: Any,  # noqa: ANN401
        points: list[tuple[float, float, float]],
        face: int,
    ) -> list[int]:
        """Return the corners of a face's points along an edge; the first face adds the middle."""
        from OCP.BRep import BRep_Tool
        from OCP.TopAbs import TopAbs_FORWARD
        from OCP.TopExp import TopExp
        from OCP.TopoDS import TopoDS

        e = self._edges.FindIndex(edge)
        forward = TopoDS.Edge_s(edge.Oriented(TopAbs_FORWARD))
        first, last = (
            self._vertices.FindIndex(v) - 1
            for v in (TopExp.FirstVertex_s(forward), TopExp.LastVertex_s(forward))
        )
        if BRep_Tool.Degenerated_s(edge):
            return [first] * len(points)  # a pole: one point, however often it is listed
        if e not in self.chains:
            self.chains[e] = [first, *(self._weld.add(p) for p in points[1:-1]), last]
        self.edge_faces.setdefault(e, []).append(face)
        if len(self.chains[e]) != len(points):
            raise RefusalError("OpenCadError", f"two surfaces disagree about edge {e}")
        return self.chains[e]


def tessellate(
    solid: Any,  # noqa: ANN401
    chord_mm: float,
    angle_rad: float,
    *,
    leaves_out: bool = False,
) -> dict[str, Any]:
    """Return the mesh, its face numbers and the edges' runs; corners of shared edges are shared.

    Each face is meshed by itself, along edges that are divided once. Faces are joined by topology,
    that is by the number of a point on its edge, never by distance.

    Parameters
    ----------
    solid : the kernel's ``TopoDS_Solid`` [mm]
    chord_mm : most a chord may be off its curve
    angle_rad : most the direction may turn from one chord to the next
    leaves_out : True to close the gap where a face cannot be tessellated, and go on

    Returns
    -------
    arrays by name : ``vertices_mm`` (v, 3); ``triangles`` (t, 3); ``face_of_triangle`` (t,);
        ``chain`` (c,), vertices of all edges one after the other; ``chain_start`` (e + 1,), where
        each edge begins in it; ``edge_faces`` (e, 2), -1 where three faces meet and more; those of
        `curves_of`; ``left_out`` (k,) numbers of faces that straight pieces stand in for

    Raises
    ------
    UndividedError : faces cannot be tessellated
    RefusalError : two faces disagree about their common edge; what is left out leaves no clear gap
    """
    import numpy as np
    from OCP.BRep import BRep_Tool
    from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_VERTEX
    from OCP.TopoDS import TopoDS

    divide(solid, chord_mm, angle_rad)
    faces, edges = shapes_of(solid, TopAbs_FACE), shapes_of(solid, TopAbs_EDGE)
    vertices = shapes_of(solid, TopAbs_VERTEX)
    weld = Weld()
    for i in range(1, vertices.Extent() + 1):
        weld.add(xyz(BRep_Tool.Pnt_s(TopoDS.Vertex_s(vertices.FindKey(i)))))
    joined = JoinedFaces(weld, edges, vertices)
    undivided = [
        f
        for f in range(1, faces.Extent() + 1)
        if not joined.take(f - 1, TopoDS.Face_s(faces.FindKey(f)))
    ]
    chains, edge_faces, corners = joined.chains, joined.edge_faces, joined.corners
    if undivided and not (leaves_out and corners):
        raise UndividedError([TopoDS.Face_s(faces.FindKey(f)) for f in undivided], undivided)
    roots = np.array([weld.root(i) for i in range(len(weld.points))])
    used, number_of = np.unique(roots, return_inverse=True)
    triangles = number_of[np.array(corners)]
    is_sound = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    triangles, of = triangles[is_sound], np.array(joined.face_of)[is_sound]
    vertices_mm = np.array(weld.points)[used]
    along: dict[int, set[int]] = {f - 1: set() for f in undivided}
    for f in undivided:
        own = shapes_of(faces.FindKey(f), TopAbs_EDGE)
        for e in {edges.FindIndex(own.FindKey(i)) for i in range(1, own.Extent() + 1)}:
            if e in chains:
                along[f - 1].update(number_of[chains[e]].tolist())
                edge_faces[e].append(f - 1)
    for f, closed in close(vertices_mm, triangles, along).items() if along else ():
        triangles, of = np.vstack([triangles, closed]), np.append(of, np.full(len(closed), f))
    order = sorted(chains)
    runs = [number_of[chains[e]] for e in order]
    starts = np.cumsum([0, *(len(run) for run in runs)])
    sides = [(edge_faces[e] * 2)[:2] if len(edge_faces[e]) < 3 else [-1, -1] for e in order]
    return {
        "vertices_mm": vertices_mm,
        "triangles": triangles,
        "face_of_triangle": of,
        "left_out": np.array(sorted(along), dtype=int),
        "chain": np.concatenate(runs) if runs else np.zeros(0, int),
        "chain_start": starts,
        "edge_faces": np.array(sides).reshape(-1, 2),
        **curves_of([edges.FindKey(e) for e in order]),
    }
