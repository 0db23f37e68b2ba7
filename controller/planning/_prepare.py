"""What can be worked out for a part in a cell before one lies there; cached by the caller."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from controller.cad import RayCaster, Solid, SurfaceSamples, inverse_pose, stable_poses

from .errors import NotGraspableError
from .grip import Grip
from .grips import find_seeds, select_arm_grips, spread, synthesise_grips, turned_over
from .layout import Box, CellLayout
from .motion import Scene
from .prepared import PlanOptions, PreparedPart
from .transfers import hand_offs
from .views import SightRules, hidden_by_hand, hold_up, holding_boxes, look_out, reachable_views


def prepare_part(
    solid: Solid,
    samples: SurfaceSamples,
    layout: CellLayout,
    options: PlanOptions | None = None,
) -> PreparedPart:
    """Work out grips of both holders, what they leave in sight and how they pass the part.

    Parameters
    ----------
    samples : of `controller.cad.sample_surface`; plans speak of these

    Raises
    ------
    NotGraspableError : neither jaw can hold it, or no resting part can be picked
    """
    options = options or PlanOptions()
    poses = tuple(p for p in stable_poses(solid) if not p.rolling)
    caster = RayCaster(solid.mesh)
    downs = np.stack([-p.R[2] for p in poses]) if poses else np.zeros((0, 3))
    widest = max(layout.hand.max_mm, layout.fixture_open_mm) - options.rules.jaw_reserve_mm
    seeds = find_seeds(solid, samples, caster, widest, options.rules)
    every = synthesise_grips(solid, seeds, caster, layout.hand, "arm", downs, options.rules)
    base = select_arm_grips(
        solid, poses, every, layout.hand, options.arm_grips_per_pose, options.arm_grips_round
    )
    fixed: tuple[Grip, ...] = ()  # views without a hand-off may still do
    if layout.fixture is not None:
        with suppress(NotGraspableError):
            fixed = synthesise_grips(
                solid, seeds, caster, layout.fixture, "fixture", downs, options.rules
            )
    fixed_base = [fixed[k] for k in spread(fixed, range(len(fixed)), options.fixture_grips)]

    rules = SightRules.of_station(layout, options.max_incidence_deg, options.min_px_per_mm)
    lookout = look_out(solid, samples, caster, rules, options.directions_n)
    directions, visible = lookout.directions, lookout.visible
    left_by_hand = [
        visible
        & ~hidden_by_hand(
            solid,
            samples,
            visible,
            directions.vectors,
            rules.distance_mm,
            g.T_part_hand,
            holding_boxes(layout.hand, g),
        )
        for g in base
    ]
    arm_grips = (*base, *(turned_over(g) for g in base))
    left_by_hand *= 2  # turned over, a hand hides the same
    fixture_grips = (*fixed_base, *(turned_over(g) for g in fixed_base))

    low, high = solid.mesh.bounds
    part_box = Box.from_bounds(low[0], high[0], low[1], high[1], low[2], high[2])
    weights = samples.areas_mm2 / samples.areas_mm2.sum()
    showing = hold_up(solid, samples, layout, directions.vectors)
    found = []
    for grip, left in zip(arm_grips, left_by_hand, strict=True):
        scene = Scene(
            layout,
            grip.opening_mm,
            layout.fixture_open_mm,
            part_box.placed(inverse_pose(grip.T_part_hand)),
        )
        found.append(
            reachable_views(layout, scene, samples, showing, left, grip.T_part_hand, layout.park_q)
        )
    shown = tuple(views.shown for views in found)
    view_q = tuple(views.q for views in found)
    covered = np.stack(
        [
            shown[k][sorted(views)].any(axis=0) if views else np.zeros(len(weights), dtype=bool)
            for k, views in enumerate(view_q)
        ]
    )
    return PreparedPart(
        solid=solid,
        samples=samples,
        options=options,
        part_box=part_box,
        poses=poses,
        arm_grips=arm_grips,
        fixture_grips=fixture_grips,
        directions=directions,
        visible=visible,
        shown=shown,
        view_q=view_q,
        hand_offs=tuple(hand_offs(layout, part_box, f, arm_grips) for f in fixture_grips),
        covered=covered,
    )
