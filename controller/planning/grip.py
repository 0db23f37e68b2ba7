"""One way to hold a part, and what counts as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .layout import FloatArray

Holder = Literal["arm", "fixture"]
TABLE_MARGIN_MM = 1.5  # between an open hand and the table it takes a part from


@dataclass(frozen=True, slots=True)
class GripRules:
    """What counts as a grip; each with its reason."""

    friction: float = 0.6  # rubber pads on machined aluminium, dry
    # of the friction, what the slope of an outer wall against its pad may use: it pushes the part
    # out of the jaws all the while (a bore centres itself), and the weight wants its share too
    wall_share: float = 0.4
    force_n: float = 40.0  # the arm's hand; the fixture is stronger
    density_kg_mm3: float = 2.7e-6  # aluminium
    max_load: float = 0.8  # share of the friction limit that weight may use, worst attitude
    compliance_mm: float = 0.4  # pads give this much, so that near-touching cells carry
    min_contact_mm2: float = 24.0  # per pad; less is a line or a corner
    max_offset_mm: float = 4.0  # between the two contacts along the pads: more tips the part
    clearance_mm: float = 4.0  # per finger while open, for 1-2 mm of pose error
    jaw_reserve_mm: float = 5.0  # of the full opening, so that the open hand gets over the part
    approach_mm: float = 90.0  # straight way in and out
    ray_step_mm: float = 2.0
    seeds_n: int = 150
    spin_n: int = 12


@dataclass(frozen=True, slots=True, eq=False)
class Grip:
    """One way to hold the part.

    Attributes
    ----------
    T_part_hand : (4, 4) tip frame of the jaw in the part's CAD frame while it holds
    opening_mm, pre_open_mm : jaw width holding, and before and after
    contact_mm2 : of the smaller of both contacts; load : share of the friction limit in use
    score : 0..1, larger is surer
    margin : share of the poses about the planned one (+-1 mm, +-2 deg) in which it still holds
    is_inner : the fingers spread inside a bore or a channel; `opening_mm` is then the distance of
        their backs, and `pre_open_mm` is narrower
    """

    id: str
    T_part_hand: FloatArray
    opening_mm: float
    pre_open_mm: float
    contact_mm2: float
    load: float
    score: float
    holder: Holder
    margin: float = 1.0
    is_inner: bool = False
