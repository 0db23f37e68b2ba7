"""What can be worked out for a part in a cell before one lies there; cached by the caller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from controller.cad import RayCaster, Solid, StablePose, SurfaceSamples, inverse_pose, stable_poses

from ._boxes import BoolArray
from ._handoff import HandOff, hand_offs
from ._scene import Scene
from ._select import select_arm_grips, spread, turned_over
from ._views import (
    Directions,
    candidate_directions,
    hidden_by_hand,
    reachable_views,
    view_poses,
    visible_from,
)
from .errors import NotGraspableError
from .grip import Grip, GripRules, find_seeds, synthesise_grips
from .layout import Box, CellLayout, FloatArray


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """What the planner aims at."""

    max_incidence_deg: float = 70.0  # a surface seen flatter than this shows too little
    arm_grips_per_pose: int = 8
    arm_grips_round: int = 16
    fixture_grips: int = 16
    max_views: int = 12  # beside square views of main faces
    least_gain: float = 0.007  # share of the area a further view must add: it costs seconds
    hand_off_gain: float = 0.002  # share of the area that is worth passing the part over
    square_share: float = 0.5  # of a face must show for a view to count as its square view
    rules: GripRules = field(default_factory=GripRules)


@dataclass(frozen=True, slots=True, eq=False)
class PreparedPart:
    """Everything of one part in one cell that does not depend on where it lies.

    Attributes
    ----------
    arm_grips : each base grip, then each once more with the hand turned over
    visible : (v, n) samples the bare part shows in each direction
    shown : per arm grip (v, n), what of it the hand leaves in sight
    view_q : per arm grip, direction -> (k, 6) collision-free configurations
    hand_offs : per fixture grip, arm grip -> how they meet
    covered : (g, n) samples some reachable view of an arm grip shows
    """

    solid: Solid
    samples: SurfaceSamples
    options: PlanOptions
    part_box: Box
    poses: tuple[StablePose, ...]
    arm_grips: tuple[Grip, ...]
    fixture_grips: tuple[Grip, ...]
    directions: Directions
    visible: BoolArray
    shown: tuple[BoolArray, ...]
    view_q: tuple[Mapping[int, FloatArray], ...]
    hand_offs: tuple[Mapping[int, HandOff], ...]
    covered: BoolArray

    @property
    def weights(self) -> FloatArray:
        """Return each sample's share of the surface (n,)."""
        areas = self.samples.areas_mm2
        return np.asarray(areas / areas.sum())

    def shown_by(self, grip: int) -> BoolArray:
        """Return what arm grip `grip` leaves in sight (v, n); turned over it hides the same."""
        return self.shown[grip % len(self.shown)]

    def carried_box(self, grip: Grip) -> Box:
        """Return the part as a box in the tip frame of the hand that holds it."""
        return self.part_box.placed(inverse_pose(grip.T_part_hand))


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
    widest = max(layout.hand.max_mm, layout.fixture.max_mm) - options.rules.jaw_reserve_mm
    seeds = find_seeds(solid, samples, caster, widest, options.rules)
    every = synthesise_grips(solid, seeds, caster, layout.hand, "arm", downs, options.rules)
    base = select_arm_grips(
        solid, poses, every, layout.hand, options.arm_grips_per_pose, options.arm_grips_round
    )
    try:
        fixed = synthesise_grips(
            solid, seeds, caster, layout.fixture, "fixture", downs, options.rules
        )
    except NotGraspableError:
        fixed = ()  # views without a hand-off may still do; the plan says what stays hidden
    fixed_base = [fixed[k] for k in spread(fixed, range(len(fixed)), options.fixture_grips)]

    camera_mm = float(np.linalg.norm(layout.inspection.position_mm - layout.station_mm))
    directions = candidate_directions(solid)
    visible = visible_from(
        solid,
        samples,
        caster,
        directions.vectors,
        camera_mm,
        float(np.radians(options.max_incidence_deg)),
    )
    shown = tuple(
        visible
        & ~hidden_by_hand(
            solid,
            samples,
            visible,
            directions.vectors,
            camera_mm,
            g.T_part_hand,
            [*layout.hand.body, *layout.hand.fingers(g.opening_mm)],
        )
        for g in base
    )
    arm_grips = (*base, *(turned_over(g) for g in base))
    fixture_grips = (*fixed_base, *(turned_over(g) for g in fixed_base))

    low, high = solid.mesh.bounds
    part_box = Box.from_bounds(low[0], high[0], low[1], high[1], low[2], high[2])
    weights = samples.areas_mm2 / samples.areas_mm2.sum()
    T_view, inside = view_poses(solid, layout, directions.vectors)
    view_q = []
    for k, grip in enumerate(arm_grips):
        scene = Scene(
            layout,
            grip.opening_mm,
            layout.fixture.max_mm,
            part_box.placed(inverse_pose(grip.T_part_hand)),
        )
        wanted = shown[k % len(shown)] @ weights > options.least_gain
        view_q.append(
            reachable_views(layout, scene, T_view, inside, wanted, grip.T_part_hand, layout.park_q)
        )
    covered = np.stack(
        [
            shown[k % len(shown)][sorted(views)].any(axis=0)
            if views
            else np.zeros(len(weights), dtype=bool)
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
        view_q=tuple(view_q),
        hand_offs=tuple(hand_offs(layout, part_box, f, arm_grips) for f in fixture_grips),
        covered=covered,
    )
