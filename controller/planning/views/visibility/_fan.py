"""Fans of lines round each normal, for spots that no even grid of directions shows.

The directions that show a spot often form a narrow wedge that opens at the steepest incidence
allowed, between two directions of a grid three degrees wide.
"""

from __future__ import annotations

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import RayCaster

from ._rules import VisibilityRules
from ._visible import free_pairs

# Angles inside the incidence limit; several are close to it, because there the wedge opens.
INSIDE_RAD = np.radians([0.2, 1.5, 4.0, 8.0, 14.0, 22.0, 32.0])
ROUND_COUNT = 96  # lines round the normal in each fan
RAY_COUNT = 2_000_000  # budget of rays, which limits the spots searched
CHUNK = 400_000  # rays at once


def closest_free(
    solid: Solid,
    samples: SurfaceSamples,
    caster: RayCaster,
    rules: VisibilityRules,
    member: IntArray,
) -> tuple[FloatArray, BoolArray]:
    """Return a direction (k, 3) along the squarest free line of each spot, and a mask of success.

    Parameters
    ----------
    solid : the part
    samples : samples of its surface
    caster : rays against its mesh
    rules : camera distance, and the largest incidence that counts
    member : (k,) numbers of the samples looked at
    """
    tilts = rules.max_incidence_rad - INSIDE_RAD[rules.max_incidence_rad > INSIDE_RAD]
    turns = 2 * np.pi * np.arange(ROUND_COUNT) / ROUND_COUNT
    tilt, turn = (a.ravel() for a in np.meshgrid(tilts, turns, indexing="ij"))
    fan = np.column_stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
    vectors = np.zeros((len(member), 3))
    found = np.zeros(len(member), dtype=bool)
    step = max(1, CHUNK // max(len(fan), 1))
    for begin in range(0, min(len(member), RAY_COUNT // max(len(fan), 1)), step):
        rows = np.arange(begin, min(begin + step, len(member)))
        points, normals = samples.points_mm[member[rows]], samples.normals[member[rows]]
        u = np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)])
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        frames = np.stack([u, np.cross(normals, u), normals], axis=2)
        along = np.einsum("kij,fj->kfi", frames, fan).reshape(-1, 3)
        of = np.repeat(np.arange(len(rows)), len(fan))
        eyes = eyes_along(solid, points[of], along, rules)
        free = free_pairs(samples, caster, member[rows][of], eyes).reshape(len(rows), -1)
        # the fans begin at the limit: the last one that is free is the squarest
        last = free.shape[1] - 1 - np.argmax(free[:, ::-1], axis=1)
        found[rows] = free.any(axis=1)
        eye = eyes.reshape(len(rows), -1, 3)[np.arange(len(rows)), last]
        vectors[rows] = (eye - solid.centroid_mm) / rules.distance_mm
    return vectors, found


def eyes_along(
    solid: Solid, points: FloatArray, along: FloatArray, rules: VisibilityRules
) -> FloatArray:
    """Return the points (n, 3) where lines meet the sphere of camera positions.

    Parameters
    ----------
    solid : the part, its centre of mass in the middle of the sphere
    points : (n, 3) start of the lines, CAD frame [mm]
    along : (n, 3) unit, the directions of the lines
    rules : camera distance
    """
    offset = points - solid.centroid_mm
    half = np.einsum("ij,ij->i", offset, along)
    inner = half**2 - np.einsum("ij,ij->i", offset, offset) + rules.distance_mm**2
    return np.asarray(points + (np.sqrt(np.maximum(inner, 0.0)) - half)[:, None] * along)
