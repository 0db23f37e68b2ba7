"""The effect of machined surfaces on a painted picture, lamp by lamp.

The painter has filled smooth areas from few rays. Here one more ray for each pixel on a part finds
where on which face it is; the light there with marks, over that without, is a factor on what was
painted, so that shadows and edges stay. Light from wall to wall is added. Panels change nothing:
what stands before them is dark.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ...layout import CameraLayout
from ...shapes import Array
from ..caster import Caster
from ..geometry import MACHINED_PART, Array32, Assembly, Mover, RayTable
from ..light import LIFT_MM, Index, Lamps, Mask, Reach, Spots, cast_shadows, chunks, fill
from .bounce import Nodes
from .faces import Faces, machined_faces
from .marks import Marks

_ALIKE_COS: Final = 0.9  # least cosine between the normals of neighbouring pixels on one face
_DARK: Final = 0.004  # radiance below which there is no highlight to scale
_FACTOR: Final = (0.3, 3.0)
_SOURCE_COUNT: Final = 4  # points of a lamp that light up the nodes
_APART_MM: Final = (17.3, 31.7)  # offset of its position in the tables from face to face
_CHUNK: Final = 60_000  # pixels at a time


@dataclass(frozen=True, slots=True, eq=False)
class MachinedPart:
    """The kept data of one part; `offset_mm` (2,) is its faces' first place in the tables."""

    faces: Faces
    marks: Marks
    offset_mm: Array32
    nodes: Nodes


class Finish:
    """The machined surfaces that one camera sees.

    Parameters
    ----------
    seed : draws marks, dust and film of every part
    camera, rays : camera and rays of the picture
    lamps : lamps of the scene
    parts : data kept of each part, for all cameras; filled here
    """

    def __init__(
        self,
        seed: int,
        camera: CameraLayout,
        rays: RayTable,
        lamps: Lamps,
        parts: dict[str, MachinedPart],
    ) -> None:
        self._seed, self._camera, self._rays, self._lamps = seed, camera, rays, lamps
        self._reach = Reach(camera, lamps)
        self._caster = Caster(rays.origin_mm)
        self._parts = parts

    def apply(
        self,
        assembly: Assembly,
        in_play: Sequence[Mover],
        wanted: Mask,
        layers: Mapping[int, Array32],
    ) -> None:
        """Put marks and light from wall to wall into painted layers.

        Parameters
        ----------
        assembly : all triangles, in place
        in_play : the moving things among them, in the assembly's order
        wanted : (h, w) pixels that may be changed
        layers : (h, w) layers of each lit lamp, changed in place
        """
        lit = [lamp for lamp in layers if self._lamps.sources[lamp] is not None]
        movers = [
            (number, mover)
            for number, mover in enumerate(in_play)
            if mover.surface.material[0] == MACHINED_PART
        ]
        if not lit or not movers:
            return
        mask = np.zeros(wanted.shape, np.uint8)
        for _, mover in movers:
            fill(mask, self._reach.outline(mover.corners_mm))
        pixels = np.flatnonzero(mask.astype(bool) & wanted)
        hits = self._caster.meet(assembly.scene, self._rays.directions[pixels])
        is_inner = _inner(assembly, hits.triangle, pixels, wanted.shape)
        for number, mover in movers:
            triangle = hits.triangle.astype(np.intp) - assembly.first_faces[number]
            on_part = np.flatnonzero((triangle >= 0) & (triangle < len(mover.surface.faces)))
            bounced = self._bounced(assembly, mover, lit)
            for chunk in chunks(len(on_part), _CHUNK):
                met = on_part[chunk]
                inner = met[is_inner[met]]
                directions = self._rays.directions[pixels]
                spots = self._caster.spots(assembly, hits, directions, curved=True, met=inner)
                self._mark(mover, spots, triangle[inner], pixels[inner], lit, layers)
                nodes, weights = self._part(mover).nodes.weights(
                    triangle[met], hits.u[met], hits.v[met]
                )
                for lamp, light in bounced.items():
                    more = np.einsum("nk,nk->n", light[nodes], weights)
                    layers[lamp].reshape(-1)[pixels[met]] += more

    def _mark(
        self,
        mover: Mover,
        spots: Spots,
        triangle: Index,
        pixels: Index,
        lit: Sequence[int],
        layers: Mapping[int, Array32],
    ) -> None:
        """Multiply the light in pixels by the effect of the marks."""
        part = self._part(mover)
        R, t = mover.T_world[:3, :3].astype(np.float32), mover.T_world[:3, 3].astype(np.float32)
        local = (spots.points_mm - t) @ R
        face = part.faces.of_triangle[triangle]
        across, along = part.faces.across[face], part.faces.along[face]
        across_mm, along_mm = part.faces.places_mm(face, local)
        across_mm += part.offset_mm[0] + _APART_MM[0] * face
        along_mm += part.offset_mm[1] + _APART_MM[1] * face
        far_mm = np.linalg.norm(spots.points_mm - self._rays.origin_mm, axis=1)
        marked = part.marks.at(across_mm, along_mm, far_mm / self._camera.focal_px)
        normals = spots.normals + _level(across @ R.T, spots.normals) * marked.across[:, None]
        normals += _level(along @ R.T, spots.normals) * marked.along[:, None]
        normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
        plain = self._lamps.reflectance(spots.material)
        marks = marked.applied(plain)
        for lamp in lit:
            places = (lamp, None, spots.points_mm)
            before = self._lamps.of_points(*places, spots.normals, spots.views, plain)[:, 0]
            after = self._lamps.of_points(*places, normals, spots.views, marks)[:, 0]
            factor = np.where(before > _DARK, after / np.maximum(before, _DARK), 1.0)
            layers[lamp].reshape(-1)[pixels] *= np.clip(factor, *_FACTOR).astype(np.float32)

    def _bounced(self, assembly: Assembly, mover: Mover, lit: Sequence[int]) -> dict[int, Array32]:
        """Return the radiance after one bounce at each node of a part, by lamp; (n,) each."""
        nodes = self._part(mover).nodes
        if not nodes.is_concave:
            return {}
        R, t = mover.T_world[:3, :3], mover.T_world[:3, 3]
        points = (nodes.points_mm @ R.T + t).astype(np.float32)
        normals = (nodes.normals @ R.T).astype(np.float32)
        material = np.full(len(points), MACHINED_PART, np.int16)
        albedo, gloss, shine = self._lamps.reflectance(material)
        starts = points + np.float32(LIFT_MM) * normals
        number = np.arange(len(points))
        result = {}
        for lamp in lit:
            source = self._lamps.sources[lamp]
            if source is None:
                continue
            towards = source.points_mm(number % 16, number // 16 % 16, _SOURCE_COUNT)
            light = self._lamps.of_points(
                lamp, towards, points, normals, normals, (albedo, 0.0 * gloss, shine)
            )
            seen = light > 0.0
            cast_shadows(assembly.scene, starts, towards, seen, seen)
            leaving = (light * seen).mean(axis=1)
            result[lamp] = np.asarray(albedo * (nodes.seen @ leaving), np.float32)
        return result

    def _part(self, mover: Mover) -> MachinedPart:
        name = mover.surface.name
        if name not in self._parts:
            rng = np.random.default_rng([self._seed, zlib.crc32(name.encode())])
            self._parts[name] = MachinedPart(
                machined_faces(mover.surface, rng),
                Marks(rng),
                rng.uniform(0.0, 100.0, 2).astype(np.float32),
                Nodes(mover.surface),
            )
        return self._parts[name]


def _inner(
    assembly: Assembly, triangle: NDArray[np.int32], pixels: Index, shape: tuple[int, ...]
) -> Mask:
    """Return a mask of the pixels wholly on one face: their neighbours' normals are alike.

    Parameters
    ----------
    triangle : (n,) triangle that each pixel's middle shows, -1 for none
    pixels : (n,) flat numbers, row by row
    shape : (height, width) shape of the picture
    """
    seen = np.zeros((*shape, 3), np.float32)
    met = triangle >= 0
    seen.reshape(-1, 3)[pixels[met]] = assembly.flat[triangle[met]]
    inner = np.ones(shape, bool)
    across = np.einsum("ijk,ijk->ij", seen[:, 1:], seen[:, :-1]) > _ALIKE_COS
    down = np.einsum("ijk,ijk->ij", seen[1:], seen[:-1]) > _ALIKE_COS
    inner[:, 1:] &= across
    inner[:, :-1] &= across
    inner[1:] &= down
    inner[:-1] &= down
    return np.asarray(inner.reshape(-1)[pixels])


def _level(directions: Array, normals: Array32) -> Array:
    """Return directions without their component along the normals, (n, 3)."""
    level: Array = directions - normals * np.einsum("ij,ij->i", directions, normals)[:, None]
    return level
