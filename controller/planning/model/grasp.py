"""A grasp of a part, and the rules for one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from controller.arrays import FloatArray

from .layout import Jaw

Holder = Literal["arm", "fixture"]
# Between an open gripper and the table it takes a part from: four times the position error of
# picks (p95) in commissioned cells, measurements.md; the layout's own uncertainty comes on top.
TABLE_MARGIN_MM = 1.0


@dataclass(frozen=True, slots=True)
class GraspRules:
    """Rules for a grasp, and the effort of the search; each with its reason."""

    # rubber pads on machined aluminium, dry; for jaws without a value of their own
    friction: float = 0.6
    density_kg_mm3: float = 2.7e-6  # aluminium
    # share of the friction limit that weight, and slope of the walls, may use in the worst attitude
    max_load: float = 0.5
    compliance_mm: float = 0.4  # pads give this much, so that near-touching cells carry
    min_contact_mm2: float = 40.0  # per pad; less is a line or a corner
    # where the pose was wrong, or where a part on the table shows no more: two lines 1 mm wide
    min_line_contact_mm2: float = 24.0
    # of the rim of a thin plate on the table, where nothing else can be had: one line 1 mm high
    min_rim_contact_mm2: float = 12.0
    max_offset_mm: float = 4.0  # between the two contacts along the pads: more tips the part
    clearance_mm: float = 4.0  # per finger while open, for 1-2 mm of pose error
    # per finger that goes into a bore: at least; preferably the value above
    bore_clearance_mm: float = 1.5
    # reserve of the full opening, so that the open gripper gets over the part
    jaw_reserve_mm: float = 5.0
    approach_mm: float = 90.0  # straight path in and out
    # the pose a part is picked at is known this well, each way on each axis (planning-facts.md 6)
    wrong_mm: float = 1.0
    wrong_deg: float = 2.0
    min_margin: float = 0.9  # share of such poses in which it must hold as well
    ray_step_mm: float = 2.0  # spacing of the first rays from a pad
    fine_step_mm: float = 1.0  # spacing of the rays for the remaining ones
    # seeds of opposed planes, as many of other walls, as many again of inner walls
    seed_count: int = 150
    spin_count: int = 12  # approaches round each seed
    # grasps by coarse rays that are enough; until then every candidate is tried
    enough_count: int = 500
    fine_count: int = 150  # largest number that is measured finely and tried at wrong poses
    wrong_count: int = 20  # wrong poses tried
    keep_count: int = 120  # largest number of grasps of a jaw
    pick_count: int = 20  # grasps from above for each stable pose, of those

    def for_pads_of(self, *jaws: Jaw) -> GraspRules:
        """Return the rules with the pads of some jaws, the firmest and softest of several."""
        pads = [jaw.pads for jaw in jaws if jaw.pads is not None]
        if not pads:
            return self
        return replace(
            self,
            friction=max(p.friction for p in pads),
            compliance_mm=max(p.compliance_mm for p in pads),
        )

    def coarse(self) -> GraspRules:
        """Return the same rules with a quick, less thorough search, for a first plan."""
        return replace(
            self,
            seed_count=60,
            spin_count=8,
            enough_count=100,
            fine_count=40,
            wrong_count=10,
            keep_count=40,
            pick_count=8,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Grasp:
    """One hold of the part by a gripper.

    Attributes
    ----------
    T_part_tcp : (4, 4) TCP frame of the jaw in the part's CAD frame while it holds
    opening_mm, pre_open_mm : opening holding, and before and after
    contact_mm2 : contact area of the smaller of both contacts
    load : share of the friction limit in use
    score : 0..1, larger is surer
    margin : share of the poses about the planned one (+-1 mm, +-2 deg) in which it still holds
    is_inner : the fingers spread inside a bore or a channel; `opening_mm` is then the distance of
        their backs, and `pre_open_mm` is narrower
    on_table : `margin` counts for taking the part from a table, which gives its height and tilt;
        contact may then be as little as `GraspRules.min_line_contact_mm2`
    """

    id: str
    T_part_tcp: FloatArray
    opening_mm: float
    pre_open_mm: float
    contact_mm2: float
    load: float
    score: float
    holder: Holder
    margin: float = 1.0
    is_inner: bool = False
    on_table: bool = False

    def gap_mm(self, jaw: Jaw) -> float:
        """Return the gap between the pads while it holds, as an argument of `Jaw.fingers`."""
        return self.opening_mm - self._backs_mm(jaw)

    def open_gap_mm(self, jaw: Jaw) -> float:
        """Return the gap between the pads before and after, as an argument of `Jaw.fingers`."""
        return self.pre_open_mm - self._backs_mm(jaw)

    def _backs_mm(self, jaw: Jaw) -> float:
        return 2 * jaw.finger_thickness_mm if self.is_inner else 0.0
