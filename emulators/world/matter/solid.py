"""A part as a body: exact mesh, mass, rests on a table, convex pieces for contacts.

Contacts with table, trays and fingers use V-HACD's pieces (some tenths of a mm fat, small holes
filled); rests and grasps use the exact mesh. Pieces are cached by content hash in the user's cache
directory.
"""

import hashlib
import logging
import math
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from ..layout import MM_PER_M, LayoutError
from ..poses import invert, transform, turn_z
from ..shapes import Array
from . import _decompose
from .engine import load_engine

if TYPE_CHECKING:  # slow to load, and the picture process reads no part
    import trimesh

log = logging.getLogger(__name__)

ALUMINIUM_KG_PER_MM3: Final = 2700e-9
_DECOMPOSE_TIMEOUT_S: Final = 120.0
# V-HACD puts vertices on voxel corners; those nearer to the surface than this are pulled in
_SNAP_VOXELS: Final = 2.0
# below, a facet is a strip to roll over or to topple from
MIN_TOPPLE_RAD: Final = math.radians(5.0)
MIN_SOLID_ANGLE: Final = 0.01  # no part comes to rest on a smaller facet by itself
DROP_HEIGHT_MM: Final = 2.0
# two readings of one CAD file find the same facet; neighbouring facets of a curve are further apart
MAX_REST_OFF_RAD: Final = math.radians(1.0)
ROLL_CLIMB_MM: Final = 0.3  # difference in height of rests that a part rolls over
_COPLANAR: Final = 1.0 - 0.5 * math.radians(0.3) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """A stable pose on a table.

    Attributes
    ----------
    down : (3,) outward normal of the hull facet that lies on the table, CAD frame
    R : (3, 3) CAD -> upright
    solid_angle : solid angle of the facet seen from the centre of mass, as a fraction of the sphere
    topple_rad : angle by which the part may be tilted over the nearest edge before it topples
    """

    down: Array
    R: Array
    solid_angle: float
    topple_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Solid:
    """A part as a rigid body.

    Attributes
    ----------
    vertices_mm, faces : the exact mesh, CAD frame
    hull_mm : (n, 3) corners of its convex hull
    mass_kg, centre_mm : mass and centre of the filled solid
    T_part_body : principal axes of inertia at the centre of mass; pybullet's frame of the body
    inertia_kg_m2 : (3,) about those axes
    pieces_path : Wavefront file of the convex pieces, body frame, metres
    rests : stable ones first, each kind with the larger solid angle first
    """

    name: str
    vertices_mm: Array
    faces: NDArray[np.int32]
    hull_mm: Array
    mass_kg: float
    centre_mm: Array
    T_part_body: Array
    inertia_kg_m2: Array
    pieces_path: Path
    rests: tuple[Rest, ...]

    @property
    def stable_rests(self) -> tuple[Rest, ...]:
        """The rests that neither roll nor topple at a touch."""
        return tuple(rest for rest in self.rests if _is_stable(rest))

    def likely_rest(self, choice: float) -> Rest:
        """Return a stable rest by its likelihood; ``choice`` in [0, 1) picks it."""
        rests = self.stable_rests or self.rests
        sums = np.cumsum([rest.solid_angle for rest in rests])
        return rests[min(int(np.searchsorted(sums, choice * sums[-1])), len(rests) - 1)]

    def rest_near(self, R: Array) -> Rest:
        """Return the rest nearest to an orientation, turned about the vertical as that is.

        Parameters
        ----------
        R : (3, 3) CAD -> upright

        Raises
        ------
        LayoutError : no rest is within `MAX_REST_OFF_RAD`
        """
        down = [R @ rest.down for rest in self.rests]
        off_rad = [math.acos(max(-1.0, min(1.0, -float(one[2])))) for one in down]
        best = int(np.argmin(off_rad)) if off_rad else -1
        if best < 0 or off_rad[best] > MAX_REST_OFF_RAD:
            nearest = f"; its nearest is {math.degrees(off_rad[best]):.1f} deg off" if down else ""
            raise LayoutError(f"{self.name} has no such stable pose on the emulated table{nearest}")
        return replace(self.rests[best], R=upright(down[best]) @ R)

    def curve_of(self, rest: Rest) -> tuple[Rest, ...]:
        """Return the rests that a part may roll to from one; that alone if it does not roll.

        Of facets that it topples from at a touch, those at the same height are one curve.
        """
        if _is_stable(rest):
            return (rest,)
        height_mm = self._height_mm(rest)
        return tuple(
            one
            for one in self.rests
            if not _is_stable(one) and abs(self._height_mm(one) - height_mm) < ROLL_CLIMB_MM
        )

    def rolled(self, rest: Rest, choice: float) -> Rest:
        """Return a rest that a part may have rolled to from one; ``choice`` in [0, 1) picks it."""
        curve = self.curve_of(rest)
        if len(curve) == 1:
            return rest
        chosen = curve[int(choice * len(curve))]
        return replace(chosen, R=upright(rest.R @ chosen.down) @ rest.R)

    def _height_mm(self, rest: Rest) -> float:
        """Return the height of the centre of mass in a rest."""
        return float((self.hull_mm @ rest.down).max() - self.centre_mm @ rest.down)

    def pose_at_rest(self, rest: Rest, x_mm: float, y_mm: float, theta_rad: float) -> Array:
        """Return T_world_part just above the table, the centre of mass over (x, y).

        Parameters
        ----------
        rest : the stable pose
        x_mm, y_mm : position of the centre of mass above the table
        theta_rad : turn about the vertical, after the stable pose's own orientation
        """
        T = turn_z(theta_rad)
        T[:3, :3] = T[:3, :3] @ rest.R
        T[:2, 3] = np.array((x_mm, y_mm)) - T[:2, :3] @ self.centre_mm
        T[2, 3] = DROP_HEIGHT_MM - float((self.hull_mm @ T[2, :3]).min())
        return T

    def ray_scene(self) -> Any:  # noqa: ANN401  (embreex has no types)
        """Return a fresh embree scene of the exact mesh, CAD frame [mm]."""
        return ray_scene(self.vertices_mm, self.faces)


def ray_scene(vertices_mm: Array, faces: NDArray[np.int32], *, robust: bool = True) -> Any:  # noqa: ANN401  (embree has no types)
    """Return an embree scene of triangles; ``robust`` keeps rays from slipping through seams.

    Parameters
    ----------
    vertices_mm : (n, 3) corners
    faces : (m, 3) numbers of the corners of each triangle
    robust : keep rays from slipping through the seams between triangles, at some cost
    """
    scene = EmbreeScene(robust=robust)
    TriangleMesh(
        scene,
        np.ascontiguousarray(vertices_mm, dtype=np.float32),
        np.ascontiguousarray(faces, dtype=np.int32),
    )
    return scene


def cache_dir() -> Path:
    """Return the folder of derived shapes: $XDG_CACHE_HOME/cellctl or ~/.cache/cellctl."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "cellctl" / "emulators"


def load_solid(
    path: Path, density_kg_per_mm3: float = ALUMINIUM_KG_PER_MM3, oversize_mm: float = 0.0
) -> Solid:
    """Return the solid of a part, read from its file.

    Parameters
    ----------
    path : path of a mesh
    density_kg_per_mm3 : density of the whole part, aluminium by default
    oversize_mm : by how much its longest edge is longer than the file has it, all else in
        proportion

    Raises
    ------
    LayoutError : no such file, not a mesh, empty, or not watertight (it then has no mass)
    """
    import trimesh

    try:
        mesh = trimesh.load_mesh(path)
    except OSError as error:
        raise LayoutError(f"{path}: {error.strerror or error}") from error
    except Exception as error:
        raise LayoutError(f"{path}: not a mesh that can be read: {error}") from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise LayoutError(f"{path}: no triangles in it")
    mesh.merge_vertices()
    if not mesh.is_watertight:
        raise LayoutError(f"{path}: not watertight, so it has no volume and no mass")
    if oversize_mm:
        mesh.apply_scale(1.0 + oversize_mm / float(mesh.extents.max()))
    return solid_of(mesh, path.stem, density_kg_per_mm3)


def solid_of(
    mesh: "trimesh.Trimesh",
    name: str,
    density_kg_per_mm3: float = ALUMINIUM_KG_PER_MM3,
    *,
    is_convex: bool = False,
) -> Solid:
    """Return the body of a watertight mesh [mm].

    Parameters
    ----------
    mesh : watertight, in the CAD frame [mm]; turned inside out in place if its volume is negative
    name : name of the part in the world
    density_kg_per_mm3 : density of the whole part, aluminium by default
    is_convex : True if it is one convex piece as it is, which need not be searched for
    """
    if mesh.volume < 0.0:
        mesh.invert()
    mass_kg = float(mesh.volume) * density_kg_per_mm3
    centre_mm = np.array(mesh.center_mass, dtype=float)
    moments, axes = np.linalg.eigh(np.asarray(mesh.moment_inertia, dtype=float))
    if np.linalg.det(axes) < 0.0:
        axes[:, 2] = -axes[:, 2]
    T_part_body = np.eye(4)
    T_part_body[:3, :3], T_part_body[:3, 3] = axes, centre_mm
    hull = mesh.convex_hull
    return Solid(
        name=name,
        vertices_mm=np.array(mesh.vertices, dtype=float),
        faces=np.array(mesh.faces, dtype=np.int32),
        hull_mm=np.array(hull.vertices, dtype=float),
        mass_kg=mass_kg,
        centre_mm=centre_mm,
        T_part_body=T_part_body,
        inertia_kg_m2=moments * density_kg_per_mm3 / MM_PER_M**2,
        pieces_path=_pieces(mesh, T_part_body, is_convex=is_convex),
        rests=_rests(hull, centre_mm),
    )


# --- rests -----------------------------------------------------------------------------------


def _rests(hull: "trimesh.Trimesh", centre_mm: Array) -> tuple[Rest, ...]:
    rests: list[Rest] = []
    normals, areas = np.asarray(hull.face_normals), np.asarray(hull.area_faces)
    triangles = np.asarray(hull.triangles)
    free = np.ones(len(normals), dtype=bool)
    for index in np.argsort(-areas):
        if not free[index]:
            continue
        same = free & (normals @ normals[index] > _COPLANAR)
        free &= ~same
        down = (normals[same] * areas[same, None]).sum(axis=0)
        down /= np.linalg.norm(down)
        points = triangles[same].reshape(-1, 3)
        margin_mm, height_mm = _margin(points, down, centre_mm)
        if margin_mm <= 0.0 or areas[same].sum() < 1e-3:
            continue
        rests.append(
            Rest(
                down=down,
                R=upright(down),
                solid_angle=_solid_angle(triangles[same] - centre_mm),
                topple_rad=math.atan2(margin_mm, height_mm),
            )
        )
    rests.sort(key=lambda rest: (not _is_stable(rest), -rest.solid_angle))
    return tuple(rests)


def _is_stable(rest: Rest) -> bool:
    return rest.topple_rad >= MIN_TOPPLE_RAD and rest.solid_angle >= MIN_SOLID_ANGLE


def _margin(points_mm: Array, down: Array, centre_mm: Array) -> tuple[float, float]:
    """Return the centre of mass's margin inside the facet's outline, and its height [mm]."""
    from shapely.geometry import MultiPoint, Polygon

    R = upright(down)
    flat = points_mm @ R.T
    centre = R @ centre_mm
    outline = MultiPoint(flat[:, :2]).convex_hull
    if not isinstance(outline, Polygon):
        return -1.0, 1.0
    corners = np.array(outline.exterior.coords)
    edge = np.roll(corners[:-1], -1, axis=0) - corners[:-1]
    to_centre = centre[:2] - corners[:-1]
    length = np.linalg.norm(edge, axis=1)
    cross = (edge[:, 0] * to_centre[:, 1] - edge[:, 1] * to_centre[:, 0]) / np.maximum(length, 1e-9)
    if not outline.exterior.is_ccw:
        cross = -cross
    return float(cross.min()), float(centre[2] - flat[:, 2].min())


def upright(down: Array) -> Array:
    """Return the smallest rotation that turns a direction to -z, (3, 3)."""
    target = np.array((0.0, 0.0, -1.0))
    v, c = np.cross(down, target), float(down @ target)
    if c < -1.0 + 1e-12:
        return np.diag((1.0, -1.0, -1.0))
    K = np.array(((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0)))
    R: Array = np.eye(3) + K + K @ K / (1.0 + c)
    return R


def _solid_angle(triangles_mm: Array) -> float:
    """Return the fraction of the sphere that triangles fill, seen from 0 (van Oosterom 1983)."""
    a, b, c = (triangles_mm[:, i] for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c)))
    flat = la * lb * lc
    flat += np.einsum("ij,ij->i", a, b) * lc
    flat += np.einsum("ij,ij->i", a, c) * lb + np.einsum("ij,ij->i", b, c) * la
    return float(np.sum(2.0 * np.arctan2(volume, flat)) / (4.0 * math.pi))


# --- convex pieces ---------------------------------------------------------------------------


def _pieces(mesh: "trimesh.Trimesh", T_part_body: Array, *, is_convex: bool) -> Path:
    digest = hashlib.sha256()
    digest.update(np.ascontiguousarray(mesh.vertices, dtype=np.float64).tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype=np.int64).tobytes())
    settings = (_decompose.RESOLUTION, _decompose.CONCAVITY, _decompose.GAMMA, _SNAP_VOXELS)
    digest.update(repr(("one piece",) if is_convex else ("pieces 2", settings)).encode())
    path = cache_dir() / f"pieces-{digest.hexdigest()[:32]}.obj"
    if path.exists():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        pieces = [np.array(mesh.vertices)] if is_convex else _decomposed(mesh, Path(folder))
        finished = Path(folder) / "finished.obj"
        _write_pieces(finished, [transform(invert(T_part_body), p) / MM_PER_M for p in pieces])
        finished.replace(path)  # a second process that decomposes the same part does no harm
    return path


def _decomposed(mesh: "trimesh.Trimesh", folder: Path) -> list[Array]:
    """Return the corners of the convex pieces of a mesh, (n, 3) each; files go to a folder."""
    from trimesh.exchange.obj import export_obj

    load_engine()  # says what is missing, where the process would only fail
    raw, mesh_path = folder / "pieces.obj", folder / "mesh.obj"
    mesh_path.write_text(export_obj(mesh, include_normals=False))
    arguments = (str(mesh_path), str(raw), str(folder / "log.txt"))
    command = (sys.executable, "-m", _decompose.__name__, *arguments)
    log.info("decomposing a part of %d triangles into convex pieces", len(mesh.faces))
    subprocess.run(command, check=True, capture_output=True, timeout=_DECOMPOSE_TIMEOUT_S)
    return [_snap(mesh, piece) for piece in read_pieces(raw)]


def read_pieces(path: Path) -> list[Array]:
    """Return the corners of each piece in a Wavefront file, (n, 3) each, in the file's unit."""
    pieces: list[list[list[float]]] = []
    for line in path.read_text().splitlines():
        if line.startswith("o "):
            pieces.append([])
        elif line.startswith("v ") and pieces:
            pieces[-1].append([float(word) for word in line.split()[1:4]])
    return [np.array(piece) for piece in pieces if len(piece) > 3]


def _snap(mesh: "trimesh.Trimesh", corners_mm: Array) -> Array:
    """Pull corners that stick out by about a voxel back onto the surface they stand for."""
    from trimesh.proximity import closest_point

    voxel_mm = float(np.prod(mesh.extents) / _decompose.RESOLUTION) ** (1.0 / 3.0)
    nearest, distance_mm, _ = closest_point(mesh, corners_mm)
    near = distance_mm < _SNAP_VOXELS * voxel_mm
    return np.where(near[:, None], nearest, corners_mm)


def _write_pieces(path: Path, pieces: list[Array]) -> None:
    from trimesh.convex import convex_hull

    lines: list[str] = []
    first = 1
    for number, corners in enumerate(pieces):
        hull = convex_hull(corners)
        lines.append(f"o piece{number}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in hull.vertices]
        lines += ["f " + " ".join(str(first + i) for i in face) for face in hull.faces]
        first += len(hull.vertices)
    path.write_text("\n".join(lines) + "\n")
