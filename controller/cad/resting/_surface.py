"""Distance of a turned or mirrored part from itself: the judge of symmetries.

Points of the surface, every corner among them, are moved, and each is measured to the nearest
triangles. One way suffices for a turn that carries a closed surface near itself, but a hole the
moved part lacks would be overlooked; so the inverse is measured too.
"""

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from controller.arrays import FloatArray, IntArray

from ..large import spans
from ._curves import BULGE_CAP_MM, SMOOTH_RAD

TARGET_COUNT = 20_000  # points on the surface that lead to the nearest triangles
PROBE_COUNT = 3_000  # points that are moved and measured
FIRST_COUNT = 150  # of these points, as many as settle most wrong guesses
FEW_COUNT = 40  # of these points, as many as show that most are far from the surface
COVER = 1.5  # in mean distances of targets: hardly a point is farther from the nearest
NEAR, NEARER = 6, 40  # triangles tried for each point, and where that leaves an ambiguity
LOOSE = 10.0  # in tolerances: a guess this near is worth a small correction
CORNER_MM = 0.1  # a quarter of the spread of the distances of corners of one kind
SAME = 0.07  # norm of the difference of rotations 3 degrees apart
UNSURE_SHARE = 0.2  # share of points off the surface above which no closer look is needed


class SymmetryMesh:
    """A mesh about a centre, to test rotations and reflections for symmetry.

    Parameters
    ----------
    mesh : closed
    centre_mm : (3,) fixed point of the movements
    tolerance_mm : distance up to which shapes count as the same, beyond the sagitta of chords
        inside curves
    """

    def __init__(self, mesh: trimesh.Trimesh, centre_mm: FloatArray, tolerance_mm: float) -> None:
        self.vertices = np.asarray(mesh.vertices, dtype=np.float64) - centre_mm
        self._triangles = np.asarray(mesh.faces)
        self._normals = np.asarray(mesh.face_normals, dtype=np.float64)
        areas = np.asarray(mesh.area_faces, dtype=np.float64)
        bulge_mm = bulge_of(mesh)
        self.tolerance_mm = tolerance_mm + bulge_mm
        self.corner_mm = 4 * (CORNER_MM + bulge_mm)
        ids, targets = _spread(self.vertices, self._triangles, areas)
        self._ids, self._tree = ids, cKDTree(targets)
        self._cover_mm = COVER * float(np.sqrt(areas.sum() / TARGET_COUNT))
        # corners first in the draw, since small features have nothing else
        rng = np.random.default_rng(0)
        kinds = (len(self.vertices), len(self._triangles), len(targets))
        picks = [rng.permutation(count)[: PROBE_COUNT // 3] for count in kinds]
        middles = self.vertices[self._triangles[picks[1]]].mean(axis=1)
        probes = np.concatenate([self.vertices[picks[0]], middles, targets[picks[2]]])
        self._probes = probes[rng.permutation(len(probes))]

    def maps_to_itself(self, R: FloatArray, shift: FloatArray | None = None) -> bool:
        """Return True if an orthogonal matrix (3, 3) and a small shift carry the part to itself."""
        shift = np.zeros(3) if shift is None else shift
        return self._carries(R, shift) and self._carries(R.T, -R.T @ shift)

    def matched(self, guess: FloatArray, known: FloatArray | None = None) -> FloatArray | None:
        """Return the movement (3, 3) near a guess that carries the part onto itself, else None.

        A guess that leads to one of the movements ``known`` (k, 3, 3) is not measured. The centre
        may move by the tolerance, since triangles put it a little off a symmetric part's axis.
        """
        R, shift = np.asarray(guess, dtype=np.float64), np.zeros(3)
        if self._is_far(R):
            return None
        for count in (FIRST_COUNT, 4 * FIRST_COUNT, 4 * FIRST_COUNT):
            moved = self._probes[:count] @ R.T + shift
            off, ids, foot = self._measure(moved, NEAR)
            good = off < LOOSE * self.tolerance_mm
            if good.mean() < 1 - UNSURE_SHARE:
                return None
            n = self._normals[ids[good]]
            gap = np.einsum("ij,ij->i", foot[good] - moved[good], n)
            system = np.column_stack([np.cross(moved[good], n), n])
            # a surface that slides on itself leaves some movements free: those stay as guessed
            step, *_ = np.linalg.lstsq(system, gap, rcond=1e-3)
            turn = rotation_about(step[:3])
            R, shift = turn @ R, turn @ shift + step[3:]
        if known is not None and np.linalg.norm(known - R, axis=(1, 2)).min() < SAME:
            return None
        if np.linalg.norm(shift) > self.tolerance_mm or not self.maps_to_itself(R, shift):
            return None
        return R

    def _is_far(self, R: FloatArray) -> bool:
        """Return True if many of a few points moved by R (3, 3) are far from every target."""
        near = LOOSE * self.tolerance_mm + self._cover_mm
        moved = self._probes[:FEW_COUNT] @ R.T
        far, _ = self._tree.query(moved, distance_upper_bound=near)
        return bool(np.isinf(far).mean() > 1.5 * UNSURE_SHARE)

    def _carries(self, R: FloatArray, shift: FloatArray) -> bool:
        for part in (self._probes[:FIRST_COUNT], self._probes[FIRST_COUNT:]):
            moved = part @ R.T + shift
            off = self._measure(moved, NEAR)[0]
            ambiguity = np.flatnonzero(off > self.tolerance_mm)
            if len(ambiguity) > UNSURE_SHARE * len(part):
                return False
            if len(ambiguity):
                off = self._measure(moved[ambiguity], NEARER)[0]
                ambiguity = ambiguity[off > self.tolerance_mm]
            if not all(self._touches(point) for point in moved[ambiguity]):
                return False
        return True

    def _touches(self, point: FloatArray) -> bool:
        """Return True if a point (3,) is on the surface, by a test of every near triangle."""
        far = self.tolerance_mm
        ids = np.concatenate(
            [some.start + self._boxes_round(point, some) for some in spans(len(self._triangles))]
        )
        if not len(ids):
            return False
        corners = self.vertices[self._triangles[ids]]
        foot = trimesh.triangles.closest_point(corners, np.tile(point, (len(ids), 1)))
        return bool(np.linalg.norm(foot - point, axis=1).min() <= far)

    def _boxes_round(self, point: FloatArray, some: slice) -> IntArray:
        """Return the indices of a slice's triangles with a point (3,) in or near their box."""
        far = self.tolerance_mm
        corners = self.vertices[self._triangles[some]]
        low, high = corners.min(axis=1), corners.max(axis=1)
        return np.flatnonzero(((low - far <= point) & (point <= high + far)).all(axis=1))

    def _measure(self, points: FloatArray, count: int) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return distances (n,), nearest triangles (n,) and the points on them (n, 3)."""
        count = min(count, len(self._ids))
        _, found = self._tree.query(points, k=count)
        ids = self._ids[np.reshape(found, (len(points), count))]
        many = np.repeat(points, count, axis=0)
        foot = np.asarray(
            trimesh.triangles.closest_point(self.vertices[self._triangles[ids.ravel()]], many)
        ).reshape(len(points), count, 3)
        off = np.linalg.norm(foot - points[:, None], axis=2)
        best = np.argmin(off, axis=1)
        row = np.arange(len(points))
        return off[row, best], ids[row, best], foot[row, best]


def bulge_of(mesh: trimesh.Trimesh) -> float:
    """Return the largest gap between a curved wall and the chords of its mesh [mm]."""
    angles = np.asarray(mesh.face_adjacency_angles)
    smooth = (angles < SMOOTH_RAD) & (angles > 1e-4)
    if not smooth.any():
        return 0.0
    ends = np.asarray(mesh.vertices)[np.asarray(mesh.face_adjacency_edges)[smooth]]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    areas = np.asarray(mesh.area_faces)[np.asarray(mesh.face_adjacency)[smooth]].min(axis=1)
    width = 2 * areas / np.maximum(length, np.sqrt(areas))
    return float(min((width / 2 * np.tan(angles[smooth] / 4)).max(), BULGE_CAP_MM))


def _spread(
    vertices: FloatArray, triangles: IntArray, areas: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Return points spread over triangles, and the triangle each is on; one at least on each."""
    count = np.maximum(np.ceil(TARGET_COUNT * areas / areas.sum()), 1).astype(np.int64)
    ids = np.repeat(np.arange(len(triangles)), count)
    nth = np.arange(len(ids)) - np.repeat(np.cumsum(count) - count, count)
    # an additive recurrence with the plastic number fills a square evenly, however many points
    u, v = (nth * 0.7548776662466927 + 1 / 3) % 1, (nth * 0.5698402909980532 + 1 / 3) % 1
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    a, b, c = (vertices[triangles[ids, i]] for i in range(3))
    return ids, a + u[:, None] * (b - a) + v[:, None] * (c - a)


def rotation_about(turn: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) about a vector (3,) by its length [rad]."""
    angle = float(np.linalg.norm(turn))
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = turn / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)
