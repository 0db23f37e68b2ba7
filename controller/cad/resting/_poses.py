"""Stable poses of a solid: hull facets below its centre of mass (references.md P2.1).

Each pose has two probabilities. The quasi-static one follows from geometry alone: where a part ends
that topples without a bounce. Parts that drop and bounce follow the product of that and the energy
to tip over (planning-facts.md 4: nearest to 300 drops of eight parts each). Curves lie as one
family, and strips that are an artefact of the tessellation are no pose at all.
"""

from dataclasses import dataclass, field

import numpy as np

from controller.arrays import FloatArray, Int32Array, IntArray

from ..graph import distinct
from ..solid import Solid
from ._curves import find_strips, merge_hollows
from ._families import CurvedRegions, Roll, RollingFamily
from ._hull import Hull, hull_of
from ._rings import axes_of, with_rings
from ._topple import Landscape, landscape_of

GRAVITY_M_S2 = 9.81
MARGINAL_LIFT_MM = 0.5  # planning-facts.md 4: a pose of 0.16 mm never occurred in 900 drops


@dataclass(frozen=True, eq=False, slots=True)
class StablePose:
    """A stable pose of the part.

    Attributes
    ----------
    index : rank, likeliest first
    R : (3, 3) rotation CAD -> upright, z up
    probability : quasi-static, of a part dropped at random; of a rolling family all of it
    tip_energy_mj_per_kg : work to tip it over its easiest edge, and on over what is round behind
        that edge; for a part that rolls or rocks, work to leave the curve; 0 for a ball, which
        has no other stable pose
    com_height_mm : height of the centre of mass above the table
    rolling : True where it rests on a curve and would roll on; `RollingFamily` has the rest
    drop_probability : drop probability of a part that is dropped and bounces: solid angle times tip
        energy
    stability_rank : 1 for the pose hardest to tip, as the paper's Table 1 is ranked
    topple_direction : (3,) unit, CAD frame, level in this pose: to where it tips most easily
    marginal : True where a lift of 0.5 mm tips it: predicted, but not seen in drops
    rocking : True where it rests on a curve with a lowest place, ``R``
    same_as : index of the likeliest pose a symmetry of the part makes this one; itself if none
    """

    index: int
    R: FloatArray
    probability: float
    tip_energy_mj_per_kg: float
    com_height_mm: float
    rolling: bool
    drop_probability: float = 0.0
    stability_rank: int = 0
    topple_direction: FloatArray = field(default_factory=lambda: np.zeros(3))
    marginal: bool = False
    rocking: bool = False
    same_as: int = -1

    @property
    def topple_rad(self) -> float:
        """Largest turn before the part tips over its easiest edge."""
        lift_mm = self.tip_energy_mj_per_kg / GRAVITY_M_S2
        return float(np.arccos(self.com_height_mm / (self.com_height_mm + lift_mm)))

    @property
    def first_alike(self) -> int:
        """The likeliest pose equivalent to this one by symmetry of the part; itself if none."""
        return self.index if self.same_as < 0 else self.same_as

    @property
    def is_distinct(self) -> bool:
        """True if no symmetry of the part makes it a likelier pose."""
        return self.first_alike == self.index


@dataclass(frozen=True, eq=False, slots=True)
class Resting:
    """All stable poses of a solid.

    Attributes
    ----------
    poses : likeliest first; a rolling family is one of them
    families : the rolling ones
    centre_of_mass_mm : (3,) CAD frame
    facet_downs : (n, 3) directions to the table of every hull facet that holds the centre, CAD
        frame, likeliest first: the poses before curves are told apart from planes
    facet_probabilities : (n,) probabilities of them, quasi-static; they sum to 1
    facet_pose : (n,) pose each belongs to, -1 where it is rarer than asked
    """

    poses: tuple[StablePose, ...]
    families: tuple[RollingFamily, ...]
    centre_of_mass_mm: FloatArray
    facet_downs: FloatArray
    facet_probabilities: FloatArray
    facet_pose: Int32Array


def stable_poses(
    solid: Solid, min_probability: float = 0.002, centre_of_mass_mm: FloatArray | None = None
) -> tuple[StablePose, ...]:
    """Return the stable poses of a solid, likeliest first; see `find_resting`.

    Parameters
    ----------
    solid : solid of uniform density, unless its centre of mass is given
    min_probability : quasi-static; rarer poses are left out
    centre_of_mass_mm : (3,) CAD frame; None for the centroid of the volume
    """
    return find_resting(solid, min_probability, centre_of_mass_mm).poses


def find_resting(
    solid: Solid, min_probability: float = 0.002, centre_of_mass_mm: FloatArray | None = None
) -> Resting:
    """Return the stable poses of a solid, and the curves it rolls on.

    Parameters
    ----------
    solid : solid of uniform density, unless its centre of mass is given
    min_probability : quasi-static; rarer poses are left out
    centre_of_mass_mm : (3,) CAD frame; None for the centroid of the volume, hollows taken out

    Raises
    ------
    ValueError : the centre of mass given is outside of the part's hull
    """
    centre = np.asarray(
        solid.centroid_mm if centre_of_mass_mm is None else centre_of_mass_mm, dtype=np.float64
    )
    hull = hull_of(np.asarray(solid.mesh.vertices, dtype=np.float64), centre)
    land = landscape_of(hull)
    strips = with_rings(hull, find_strips(hull), axes_of(solid.faces, centre))
    hollow, hollow_probabilities = merge_hollows(hull, land, strips)
    bottoms, probabilities, lift, topple_edge = _hollows(hull, land, hollow, hollow_probabilities)

    weight = probabilities * np.maximum(lift, 0.0)
    drop = weight / weight.sum() if weight.sum() > 0 else probabilities
    # equal stable poses tie, whatever the noise
    probabilities, lift = np.round(probabilities, 12), np.round(lift, 9)
    order = np.lexsort((bottoms, -probabilities))
    order = order[probabilities[order] >= min_probability]
    ranks = np.empty(len(order), dtype=int)
    ranks[np.lexsort((np.arange(len(order)), -lift[order]))] = np.arange(1, len(order) + 1)

    held = np.flatnonzero(land.probabilities > 0)
    held = held[np.argsort(-land.probabilities[held], kind="stable")]
    pose_of_bottom = np.full(hull.count, -1, dtype=np.int32)
    curves = CurvedRegions(hull, strips)
    poses, families = [], []
    for index, i in enumerate(order.tolist()):
        bottom = int(bottoms[i])
        pose_of_bottom[bottom] = index
        down, roll, strip_facets = hull.normals[bottom], None, held[hollow[held] == bottom]
        if strips.is_strip[bottom]:
            roll = curves.roll_at(bottom, strip_facets[strips.is_strip[strip_facets]])
            down = down if roll is None else roll.down
        R = upright_rotation(down)
        height = float(hull.extent_mm(down[None])[0])
        poses.append(
            StablePose(
                index=index,
                R=R,
                probability=float(probabilities[i]),
                tip_energy_mj_per_kg=GRAVITY_M_S2 * float(lift[i]),
                com_height_mm=height,
                rolling=roll is not None and roll.rolls,
                drop_probability=float(drop[i]),
                stability_rank=int(ranks[index]),
                topple_direction=_topple_direction(hull, int(topple_edge[i]), down),
                marginal=bool(topple_edge[i] >= 0 and lift[i] < MARGINAL_LIFT_MM),
                rocking=roll is not None and not roll.rolls,
                same_as=index,
            )
        )
        if roll is not None and roll.rolls:
            families.append(_family(hull, land, roll, strip_facets, poses[-1], centre))
    return Resting(
        tuple(poses),
        tuple(families),
        centre,
        hull.normals[held],
        land.probabilities[held],
        pose_of_bottom[hollow[held]],
    )


def upright_rotation(down: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) CAD -> upright that turns a direction (3,) down to -z.

    Its x axis is level in the CAD frame's xy plane, so that equal directions give equal rotations.
    """
    up = -down / np.linalg.norm(down)
    x = np.array([-up[1], up[0], 0.0])
    length = float(np.linalg.norm(x))
    x = np.array([1.0, 0.0, 0.0]) if length < 1e-9 else x / length
    x = x - (x @ up) * up
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up])


def _hollows(
    hull: Hull, land: Landscape, hollow: IntArray, probabilities: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Return the hollows' bottoms (k,), probabilities, climbs to the lowest pass [mm], its edge."""
    a, b = hollow[hull.edge_facets[:, 0]], hollow[hull.edge_facets[:, 1]]
    apart = np.flatnonzero(a != b)
    bottoms = np.flatnonzero(probabilities > 0)
    edges = np.concatenate([apart, apart])
    sides = np.concatenate([a[apart], b[apart]])
    order = np.lexsort((-land.pass_mm[edges], sides))  # the lowest of each side is written last
    lowest = np.full(hull.count, -1, dtype=np.int64)
    lowest[sides[order]] = edges[order]
    edge = lowest[bottoms]
    climb = np.where(edge >= 0, land.pass_mm[edge] - hull.heights_mm[bottoms], np.inf)
    if np.isinf(climb).any():  # a ball: one hollow, nowhere to tip to
        climb = np.where(np.isinf(climb), 0.0, climb)
    return bottoms, probabilities[bottoms], np.maximum(climb, 0.0), edge


def _topple_direction(hull: Hull, edge: int, down: FloatArray) -> FloatArray:
    """Return the level direction (3,) towards an edge, zeros where there is none."""
    if edge < 0:
        return np.zeros(3)
    start, end = hull.corners_mm[hull.edge_ends[edge]]
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-12)
    out = start - (start @ along) * along
    out = out - (out @ down) * down
    length = float(np.linalg.norm(out))
    return np.asarray(out / length) if length > 1e-9 else np.zeros(3)


def _family(
    hull: Hull,
    land: Landscape,
    roll: Roll,
    strip_facets: IntArray,
    pose: StablePose,
    centre: FloatArray,
) -> RollingFamily:
    near = np.isin(hull.facet, roll.reach)
    corners = hull.corners_mm[distinct(hull.triangles[near])] - roll.centre_mm
    radius = np.linalg.norm(corners - np.outer(corners @ roll.axis, roll.axis), axis=1)
    heights = hull.heights_mm[roll.reach]
    return RollingFamily(
        pose=pose.index,
        kind=roll.kind,
        axis=roll.axis,
        centre_mm=roll.centre_mm + centre,
        radius_mm=np.array([radius.min(), radius.max()]),
        heights_mm=np.array([heights.min(), heights.max()]),
        arc_rad=roll.arc_rad,
        probability=pose.probability,
        drop_probability=pose.drop_probability,
        downs=hull.normals[strip_facets],
        probabilities=land.probabilities[strip_facets],
    )
