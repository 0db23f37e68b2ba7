"""Reasons why no view distinguishes two hypotheses."""

from __future__ import annotations

import numpy as np
import trimesh

from controller.arrays import BoolArray, FloatArray
from controller.cad import SurfaceSamples, sample_surface
from controller.imaging import RayCaster, inverse_pose, transform
from messages import joined, key, say

from ..geometry import segments_hit
from ..model import CellLayout, HeldHypothesis
from ..motion import Scene, tcp_pose

SAME_MM = 0.15  # as in cad/resting: bores are drawn this far off the axis of symmetric parts
SPACING_MM = 3.0
FLATTEST_COSINE = np.cos(np.radians(80.0))
NAMED_COUNT = 3


def why_alike(
    a: HeldHypothesis,
    b: HeldHypothesis,
    layout: CellLayout,
    q: FloatArray,
    opening_mm: float,
    margin: float,
) -> str:
    """Return one sentence: the same shape, all differences hidden, or too small to see.

    Parameters
    ----------
    a, b : the two hypotheses
    layout : the cell
    q : (k, 6) the views offered
    margin : the best of them
    opening_mm : distance between the inner sides of the fingers
    """
    samples = [sample_surface(c.solid, SPACING_MM) for c in (a, b)]
    apart = [distance_mm(x, s, y) for x, s, y in ((a, samples[0], b), (b, samples[1], a))]
    most = max(float(d.max()) for d in apart)
    if most <= SAME_MM:
        return say(
            "{name} and {other} are the same shape in the same pose, to "
            "{most:.2f} mm: no picture distinguishes them, and nothing depends "
            "on it",
            name=a.name,
            other=b.name,
            most=most,
        )
    differs = [d > max(SAME_MM, 0.5 * most) for d in apart]
    names = [
        say("{label} of {name}", label=c.solid.faces[int(f)].label, name=c.name)
        for c, s, d in zip((a, b), samples, differs, strict=True)
        for f in np.unique(s.face_ids[d])
    ]
    where = joined(", ", names[:NAMED_COUNT]) + (
        key(" and others") if len(names) > NAMED_COUNT else ""
    )
    if len(q) == 0:
        return say(
            "no view can be reached; they differ at {where}, by up to {most:.1f} mm",
            where=where,
            most=most,
        )
    seen = any(
        _shown(c, s, d, layout, row, opening_mm)
        for c, s, d in zip((a, b), samples, differs, strict=True)
        for row in q
    )
    if not seen:
        return say(
            "they differ only at {where}, by up to {most:.1f} mm, which the "
            "part or the gripper hides in all {q_count} views that can be "
            "reached; another grasp may show it",
            where=where,
            most=most,
            q_count=len(q),
        )
    return say(
        "they differ at {where}, by up to {most:.1f} mm, which is in sight "
        "but makes {margin:.0%} of the pixels it takes at most, as the "
        "part may sit in the gripper",
        where=where,
        most=most,
        margin=margin,
    )


def distance_mm(a: HeldHypothesis, samples: SurfaceSamples, b: HeldHypothesis) -> FloatArray:
    """Return the distance of each sample (n,) of one hypothesis from the surface of another [mm].

    Parameters
    ----------
    a : the hypothesis the samples are of
    samples : n, CAD frame of ``a``
    b : another one, held by the same gripper
    """
    points = transform(inverse_pose(b.T_tcp_part) @ a.T_tcp_part, samples.points_mm)
    _, distance, _ = trimesh.proximity.closest_point(b.solid.mesh, points)
    return np.asarray(distance)


def _shown(
    c: HeldHypothesis,
    samples: SurfaceSamples,
    members: BoolArray,
    layout: CellLayout,
    q: FloatArray,
    opening_mm: float,
) -> bool:
    """Return True if any of the given samples is in sight in one configuration."""
    if not members.any():
        return False
    T = tcp_pose(layout, q) @ c.T_tcp_part
    eye = transform(inverse_pose(T), layout.inspection.position_mm[None])[0]
    points, normals = samples.points_mm[members], samples.normals[members]
    ray = eye - points
    cosine = np.einsum("ij,ij->i", ray, normals) / np.linalg.norm(ray, axis=1)
    start = points + 0.02 * normals
    free = cosine > FLATTEST_COSINE
    free &= ~RayCaster(c.solid.mesh).blocked(start, ray, 1.0)
    boxes = Scene(layout, opening_mm, 0.0).arm_boxes(q)
    free &= ~segments_hit(transform(T, points), layout.inspection.position_mm, boxes)
    return bool(free.any())
