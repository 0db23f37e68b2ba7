"""Where a parallel jaw can hold a part: seeds from opposed faces and walls, one evaluator for all.

Seeds come from exactly opposed planar faces (their overlap as polygons) and from rays through the
walls (curved, drafted, between a bore and a rim). Every seed is judged alike: rays from both pads
inwards give the true contact, its area and offset, the jaw opening and the centring shift
(planning.md 2.2). Clearance of the open hand and of its way in is checked on the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import fcl
import numpy as np
import shapely

from controller.cad import RayCaster, Solid, SurfaceSamples

from ..boxes import BoolArray
from ..errors import NotGraspableError
from ..grip import Grip, GripRules, Holder
from ..layout import Box, FloatArray, Jaw

OPPOSED_COS = np.cos(np.radians(2.0))


@dataclass(frozen=True, slots=True, eq=False)
class Seeds:
    """Where to try: between two walls, the jaws closing along an axis."""

    middle: FloatArray  # (n, 3)
    axis: FloatArray  # (n, 3) the jaws' axis
    gap: FloatArray  # (n,)


def synthesise_grips(
    solid: Solid,
    seeds: Seeds,
    caster: RayCaster,
    jaw: Jaw,
    holder: Holder,
    downs: FloatArray,
    rules: GripRules,
) -> tuple[Grip, ...]:
    """Return every grip of one jaw on the part that holds and is clear of the part.

    Parameters
    ----------
    seeds : of `find_seeds`
    downs : (k, 3) which way is down, in the part frame, in each stable pose

    Raises
    ------
    NotGraspableError : no two walls can be held
    """
    widest = jaw.max_mm - rules.jaw_reserve_mm
    if len(seeds.gap) == 0:
        raise NotGraspableError(
            f"{solid.name}: no two opposed walls at most {widest:.0f} mm apart; "
            "fit a wider jaw or other fingers"
        )
    T, gap = _candidates(solid, seeds, jaw, downs, rules)
    found = _contacts(solid, caster, T, gap, jaw, rules)
    clear = _clearances(solid, found, jaw, rules)
    grips: list[Grip] = []
    for k in np.flatnonzero(clear):
        area, load = float(found.area[k]), float(found.load[k])
        score = min(1.0, area / 120.0) * (1.0 - load) * (1.0 - found.offset[k] / 12.0)
        grips.append(
            Grip(
                f"{holder[0].upper()}{len(grips)}",
                found.T[k],
                float(found.opening[k]),
                _pre_open(float(found.opening[k]), jaw, rules),
                area,
                load,
                float(score),
                holder,
            )
        )
    if not grips:
        raise NotGraspableError(
            f"{solid.name}: {len(T)} grips of the {holder} tried, none touches enough wall on both "
            f"sides ({rules.min_contact_mm2:.0f} mm2) clear of the part; fit other fingers"
        )
    return tuple(grips)


def _pre_open(opening_mm: float, jaw: Jaw, rules: GripRules) -> float:
    return min(jaw.max_mm, opening_mm + 2 * rules.clearance_mm)


def find_seeds(
    solid: Solid, samples: SurfaceSamples, caster: RayCaster, widest_mm: float, rules: GripRules
) -> Seeds:
    """Return where to try jaws of up to a width: the same for both holders."""
    planes = _plane_seeds(solid, widest_mm)
    walls = _wall_seeds(solid, samples, caster, widest_mm, rules)
    found = []
    for seeds in (planes, walls):
        # a grip seen from the other side is the same grip
        sign = np.where((seeds.axis @ np.array([0.9511, 0.2839, 0.1213])) < 0, -1.0, 1.0)
        features = np.hstack(
            [seeds.middle / 15.0, seeds.axis * sign[:, None], seeds.gap[:, None] / 20.0]
        )
        chosen = farthest(features, rules.seeds_n)
        found.append(Seeds(seeds.middle[chosen], seeds.axis[chosen], seeds.gap[chosen]))
    return Seeds(
        np.vstack([f.middle for f in found]),
        np.vstack([f.axis for f in found]),
        np.concatenate([f.gap for f in found]),
    )


def _plane_seeds(solid: Solid, widest_mm: float) -> Seeds:
    """Return seeds in the overlap of exactly opposed planar faces."""
    planes = [f for f in solid.faces if f.kind == "plane" and f.area_mm2 > 40.0]
    middle, axis, gaps = [], [], []
    corners = np.asarray(solid.mesh.triangles)
    shapes: dict[tuple[int, tuple[float, ...]], shapely.Geometry] = {}
    for i, a in enumerate(planes):
        for b in planes[i + 1 :]:
            gap = float((a.centre_mm - b.centre_mm) @ a.normal)
            if a.normal @ b.normal > -OPPOSED_COS or not 1.0 < gap <= widest_mm:
                continue
            # one frame for both senses of a direction, so that outlines are drawn once
            towards = np.round(a.normal, 6)
            first = towards[np.flatnonzero(np.abs(towards) > 1e-6)[0]]
            u, v = _across(towards * np.sign(first))
            flat = np.column_stack([u, v])
            key = tuple(np.round(flat, 6).ravel().tolist())
            for f in (a, b):
                if (f.id, key) not in shapes:
                    triangles = shapely.polygons(corners[solid.face_of_triangle == f.id] @ flat)
                    outline = shapely.coverage_union_all(triangles[shapely.area(triangles) > 1e-9])
                    shapes[f.id, key] = shapely.make_valid(outline)
            common = shapely.intersection(shapes[a.id, key], shapes[b.id, key])
            if common.area < 20.0:
                continue
            height = float((a.centre_mm + b.centre_mm) @ a.normal) / 2
            for x, y in _inside(common):
                middle.append(x * u + y * v + height * a.normal)
                axis.append(a.normal)
                gaps.append(gap)
    return Seeds(
        np.reshape(middle, (-1, 3)), np.reshape(axis, (-1, 3)), np.array(gaps, dtype=float)
    )


def _inside(shape: shapely.Geometry, step_mm: float = 12.0, most: int = 24) -> list[FloatArray]:
    """Return points of a polygon: one surely inside, its centroid, and a grid."""
    x0, y0, x1, y1 = shape.bounds
    step = max(step_mm, float(np.sqrt(shape.area / most)))
    xs = np.arange(x0 + step / 2, x1, step)
    ys = np.arange(y0 + step / 2, y1, step)
    grid = np.array(np.meshgrid(xs, ys)).reshape(2, -1).T
    sure, centroid = shape.representative_point(), shape.centroid
    points = np.vstack([[sure.x, sure.y], [centroid.x, centroid.y], grid])
    keep = shapely.contains_xy(shape, points[:, 0], points[:, 1])
    keep[0] = True
    return list(points[keep])


def _wall_seeds(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    widest_mm: float,
    rules: GripRules,
) -> Seeds:
    """Return seeds across walls: to the next way out of the material, and to the far side."""
    p, n = samples.points_mm, samples.normals
    face_normals = np.asarray(solid.mesh.face_normals)
    cone = np.cos(np.arctan(rules.friction))
    triangle, depth = caster.first_hit(p - 0.02 * n, -n)
    through = (triangle >= 0) & (depth > 0.5) & (depth <= widest_mm)
    through &= np.einsum("ij,ij->i", face_normals[triangle], -n) >= cone
    outside = widest_mm + 1.0
    triangle, depth = caster.first_hit(p - outside * n, n)
    across = (triangle >= 0) & (depth > 1.0) & (depth < outside - 0.5)
    across &= np.einsum("ij,ij->i", face_normals[triangle], -n) >= cone
    middle, axis, gap = [], [], []
    for ok, far in ((through, None), (across, outside - depth)):
        width = caster.first_hit(p[ok] - 0.02 * n[ok], -n[ok])[1] if far is None else far[ok]
        middle.append(p[ok] - n[ok] * width[:, None] / 2)
        axis.append(n[ok])
        gap.append(width)
    return Seeds(np.vstack(middle), np.vstack(axis), np.concatenate(gap))


def farthest(features: FloatArray, count: int, start: int = 0) -> list[int]:
    """Return up to `count` indices spread over the features (n, d), greedily the farthest next."""
    if len(features) == 0:
        return []
    chosen = [start]
    distance = np.linalg.norm(features - features[start], axis=1)
    while len(chosen) < min(count, len(features)):
        k = int(np.argmax(distance))
        if distance[k] < 1e-6:
            break
        chosen.append(k)
        distance = np.minimum(distance, np.linalg.norm(features - features[k], axis=1))
    return chosen


def _across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two unit vectors square to the axis and each other, along part axes if possible."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    u = helper - axis * (helper @ axis)
    u = u / np.linalg.norm(u)
    return u, np.cross(axis, u)


def _candidates(
    solid: Solid, seeds: Seeds, jaw: Jaw, downs: FloatArray, rules: GripRules
) -> tuple[FloatArray, FloatArray]:
    """Return tip poses (n, 4, 4) round each seed, at a few depths, and the nominal gaps (n,)."""
    hull = np.asarray(solid.mesh.convex_hull.vertices)
    turn = np.arange(rules.spin_n) * 2 * np.pi / rules.spin_n
    poses, gaps = [], []
    for middle, axis, gap in zip(seeds.middle, seeds.axis, seeds.gap, strict=True):
        u, v = _across(axis)
        square = downs[np.abs(downs @ axis) < 0.02]
        square = square - np.outer(square @ axis, axis)
        square /= np.linalg.norm(square, axis=1, keepdims=True)
        approach = np.vstack([np.outer(np.cos(turn), u) + np.outer(np.sin(turn), v), square])
        ahead = ((hull - middle) @ approach.T).max(axis=0)
        deep = np.repeat(jaw.pad_centre_mm, len(approach))
        # flat parts on the table: as deep as the tips get without touching it
        table = (ahead > 3.0) & (ahead - 3.0 < jaw.pad_centre_mm)
        approach = np.vstack([approach, approach, approach[table]])
        depth = np.concatenate([deep, deep - 7.0, ahead[table] - 3.0])
        T = np.zeros((len(approach), 4, 4))
        T[:, 3, 3] = 1.0
        T[:, :3, 0], T[:, :3, 1] = approach, axis
        T[:, :3, 2] = np.cross(approach, np.broadcast_to(axis, approach.shape))
        T[:, :3, 3] = middle + approach * depth[:, None]
        poses.append(T)
        gaps.append(np.repeat(gap, len(T)))
    return np.concatenate(poses), np.concatenate(gaps)


@dataclass(slots=True)
class _Found:
    T: FloatArray
    opening: FloatArray
    area: FloatArray
    load: FloatArray
    offset: FloatArray


def _contacts(
    solid: Solid, caster: RayCaster, T: FloatArray, gap: FloatArray, jaw: Jaw, rules: GripRules
) -> _Found:
    """Close the pads on the mesh, ray by ray, and keep the candidates that hold."""
    step = rules.ray_step_mm
    nx = max(2, round(jaw.pad_length_mm / step))
    nz = max(2, round(jaw.finger_width_mm / step) + 1)
    x = -(np.arange(nx) + 0.5) * jaw.pad_length_mm / nx
    # out to the pads' edges, which are what touches the wall of a bore
    z = np.linspace(-0.5, 0.5, nz) * jaw.finger_width_mm
    grid = np.array(np.meshgrid(x, z, indexing="ij")).reshape(2, -1).T
    cell = jaw.pad_length_mm * jaw.finger_width_mm / len(grid)
    face_normals = np.asarray(solid.mesh.face_normals)
    inner = np.array([f.concave for f in solid.faces])[solid.face_of_triangle]
    steepest = np.where(inner, 1.0, rules.wall_share) * rules.friction
    cone = np.cos(np.arctan(steepest))
    start = gap / 2 + rules.clearance_mm
    n = len(T)
    side_at, area, centroid, radius, spread = [], [], [], [], []
    good = np.ones(n, dtype=bool)
    for side in (1.0, -1.0):
        local = np.zeros((n, len(grid), 3))
        local[:, :, 0], local[:, :, 2] = grid[:, 0], grid[:, 1]
        local[:, :, 1] = side * start[:, None]
        origin = np.einsum("nij,nkj->nki", T[:, :3, :3], local) + T[:, None, :3, 3]
        inward = np.broadcast_to(-side * T[:, None, :3, 1], origin.shape)
        triangle, distance = caster.first_hit(origin.reshape(-1, 3), inward.reshape(-1, 3))
        triangle = triangle.reshape(n, -1)
        distance = distance.reshape(n, -1)
        facing = np.einsum("nki,nki->nk", face_normals[triangle], inward)
        good &= ~np.any((triangle >= 0) & (facing > 0), axis=1)  # the pad starts inside material
        first = distance.min(axis=1)
        good &= np.isfinite(first)
        first = np.where(np.isfinite(first), first, 0.0)
        touch = (distance <= (first + rules.compliance_mm)[:, None]) & (-facing >= cone[triangle])
        count = np.maximum(touch.sum(axis=1), 1)
        middle = np.einsum("nk,kj->nj", touch, grid) / count[:, None]
        off = np.linalg.norm(grid[None] - middle[:, None], axis=2) * touch
        side_at.append(start - first)
        area.append(touch.sum(axis=1) * cell)
        centroid.append(middle)
        radius.append(off.sum(axis=1) / count)
        spread.append(np.sqrt(np.einsum("nk,nk->n", off, off) / count))
    opening = side_at[0] + side_at[1]
    smaller = np.minimum(area[0], area[1])
    offset = np.linalg.norm(centroid[0] - centroid[1], axis=1)
    good &= (smaller >= rules.min_contact_mm2) & (offset <= rules.max_offset_mm)
    good &= (opening > 1.0) & (opening <= jaw.max_mm - rules.jaw_reserve_mm)

    T = T.copy()
    T[:, :3, 3] += T[:, :3, 1] * ((side_at[0] - side_at[1]) / 2)[:, None]
    held = (centroid[0] + centroid[1]) / 2
    at = T[:, :3, 3] + T[:, :3, 0] * held[:, :1] + T[:, :3, 2] * held[:, 1:]
    arm_mm = np.linalg.norm(np.cross(solid.centroid_mm - at, T[:, :3, 1]), axis=1)
    weight_n = solid.volume_mm3 * rules.density_kg_mm3 * 9.81
    force = rules.force_n
    slide = weight_n / (2 * rules.friction * force)
    r = np.maximum((radius[0] + radius[1]) / 2, 1.0)
    twist = weight_n * arm_mm / (2 * rules.friction * force * r)
    tilt = weight_n * arm_mm / (2 * force * np.maximum((spread[0] + spread[1]) / 2, 1.0))
    load = np.maximum(np.hypot(slide, twist), tilt)
    good &= load <= rules.max_load
    keep = np.flatnonzero(good)
    return _Found(T[keep], opening[keep], smaller[keep], load[keep], offset[keep])


def _clearances(solid: Solid, found: _Found, jaw: Jaw, rules: GripRules) -> BoolArray:
    """Tell which hands, open, come straight in and close without touching the part elsewhere."""
    model = fcl.BVHModel()
    mesh = solid.mesh
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    model.endModel()
    part = fcl.CollisionObject(model)
    request = fcl.CollisionRequest()
    clear = np.zeros(len(found.T), dtype=bool)
    for k, T in enumerate(found.T):
        opening = float(found.opening[k])
        wide = _pre_open(opening, jaw, rules)
        boxes = [_swept(b, rules.approach_mm) for b in jaw.body]
        boxes += list(jaw.fingers(wide, behind_mm=rules.approach_mm))
        boxes += list(jaw.fingers(opening + 2 * rules.compliance_mm))
        clear[k] = not any(_touches(part, b.placed(T), request) for b in boxes)
    return clear


def _swept(box: Box, behind_mm: float) -> Box:
    T = box.T.copy()
    T[0, 3] -= behind_mm / 2
    return Box(T, box.half_mm + np.array([behind_mm / 2, 0.0, 0.0]))


def _touches(part: fcl.CollisionObject, box: Box, request: fcl.CollisionRequest) -> bool:
    solid_box = fcl.CollisionObject(
        fcl.Box(*(2 * box.half_mm)), fcl.Transform(box.T[:3, :3], box.T[:3, 3])
    )
    return bool(fcl.collide(part, solid_box, request, fcl.CollisionResult()))
