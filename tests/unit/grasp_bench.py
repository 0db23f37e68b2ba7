"""Parts with known walls in a known jaw, for the tests of grasps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from controller.cad import Solid, SurfaceSamples, sample_surface, stable_poses
from controller.imaging import RayCaster
from controller.planning import Box, GraspRules, Jaw
from controller.planning.grasps import GraspProblem, Synthesis, find_seeds, judge_grasps

# pads 12 x 24 mm on fingers 8 mm thick, as the arm's
HAND = Jaw(
    body=(
        Box.from_bounds(-177, -138, -20, 20, -20, 20),
        Box.from_bounds(-140, -76, -52, 52, -22, 22),
    ),
    finger_length_mm=78.0,
    finger_width_mm=12.0,
    finger_thickness_mm=8.0,
    pad_length_mm=24.0,
    max_mm=85.0,
)
SPREADING = replace(HAND, can_spread=True)
RULES = GraspRules()
QUICK = replace(RULES.coarse(), seed_count=40, enough_count=60, fine_count=24, keep_count=24)
DOWN = np.array([[0.0, 0.0, -1.0]])


def downs_of(solid: Solid) -> np.ndarray:
    return np.stack([-p.R[2] for p in stable_poses(solid) if not p.rolling])


def judged(
    solid: Solid,
    rules: GraspRules = QUICK,
    jaw: Jaw = HAND,
    downs: np.ndarray = DOWN,
    samples: SurfaceSamples | None = None,
) -> Synthesis:
    caster = RayCaster(solid.mesh)
    widest = jaw.max_mm - rules.jaw_reserve_mm
    points = sample_surface(solid, 5.0) if samples is None else samples
    seeds = find_seeds(solid, points, caster, widest, rules, [jaw])
    return judge_grasps(GraspProblem(solid, seeds, caster, downs, rules), jaw, "arm")


def stood(
    at: tuple[float, float, float],
    approach: tuple[float, float, float],
    axis: tuple[float, float, float],
) -> np.ndarray:
    """The pose of tips at a point."""
    T = np.eye(4)
    x, y = np.array(approach, float), np.array(axis, float)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, y, np.cross(x, y), at
    return T
