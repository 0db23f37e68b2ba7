"""The cell's layout for the planner: boxes, frames, cameras, joint speeds.

Lengths in mm, angles in rad, poses in the world frame (table plane z = 0, z up). Nothing here
reads a file: `controller.config` builds a `CellLayout` from the cell's YAML.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera

from ..geometry import Box, PlacedShape
from .arm import ArmModel


@dataclass(frozen=True, slots=True)
class Pads:
    """Properties of a gripper's pads.

    Attributes
    ----------
    friction : coefficient against the part
    compliance_mm : compliance of the pads
    """

    friction: float
    compliance_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class Jaw:
    """A parallel gripper; TCP frame: x = approach, y = the jaws' axis, origin between fingertips.

    Attributes
    ----------
    max_mm : widest opening
    force_n : force of the pads
    can_spread : True if it may also hold a bore or a channel from inside, its fingers' backs being
        pads
    pads : None for those that `GraspRules` assumes
    """

    body: tuple[Box, ...]
    finger_length_mm: float
    finger_width_mm: float
    finger_thickness_mm: float
    pad_length_mm: float
    max_mm: float
    force_n: float = 40.0
    can_spread: bool = False
    pads: Pads | None = None

    def fingers(
        self, opening_mm: float, behind_mm: float = 0.0, until_mm: float | None = None
    ) -> tuple[Box, Box]:
        """Return the two fingers at an opening, boxes in the TCP frame; that on +y first.

        Parameters
        ----------
        opening_mm : opening between the pads
        behind_mm : extra length backwards, for the straight path in
        until_mm : a second, wider opening: the boxes hold all openings between; None for one alone
        """
        x0, z = -self.finger_length_mm - behind_mm, self.finger_width_mm / 2
        near = opening_mm / 2
        far = (opening_mm if until_mm is None else until_mm) / 2 + self.finger_thickness_mm
        return (
            Box.from_bounds(x0, 0.0, near, far, -z, z),
            Box.from_bounds(x0, 0.0, -far, -near, -z, z),
        )

    @property
    def pad_centre_mm(self) -> float:
        """Distance from the fingertips back to the middle of the pads."""
        return self.pad_length_mm / 2


@dataclass(frozen=True, slots=True)
class Nest:
    """A place for one part in a tray.

    Attributes
    ----------
    centre_mm : its middle, x and y in the world
    size_mm : room along x and y that the part's outline stays within
    turn_rad : turn of the part about the vertical, from its stable pose; None for any
    """

    centre_mm: tuple[float, float]
    size_mm: tuple[float, float]
    turn_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Tray:
    """A place where parts of one verdict are put down.

    Attributes
    ----------
    nests : its places for one part each; empty where there is one place, its middle
    next_nest : number of the nest that the next part goes into
    """

    centre_mm: tuple[float, float]
    size_mm: tuple[float, float]
    nests: tuple[Nest, ...] = ()
    next_nest: int = 0

    @property
    def nest(self) -> Nest | None:
        """The nest for the next part; None where there are none."""
        return self.nests[self.next_nest] if self.nests else None

    @property
    def target_mm(self) -> tuple[float, float]:
        """Target of the next part's centre of mass, or of the middle of its outline in a nest."""
        return self.centre_mm if self.nest is None else self.nest.centre_mm


@dataclass(frozen=True, slots=True)
class CellTimes:
    """The fixed times of a cycle; the arm's timing model gives the duration of moves.

    Medians of the actions' verbs on the cell's clock. The needs of each kind of step are listed
    below, in the order of the actions.

    Attributes
    ----------
    open_s, release_s : the arm's jaws open, before a grasp and out of one
    grasp_s, press_s : they close until they stall, width read back; they press on what they hold
    fixed_open_s, fixed_grasp_s, fixed_release_s : the same of the fixed gripper
    read_s : the joints are read back
    ringing_s : time for which the arm vibrates after it stops; no picture is taken before
    picture_s : lamps, exposure after the change, download
    judge_s : time from the pictures of a view to its result, if the cell waits for it
    verdict_s : time from the last result to the verdict
    relook_s : pictures of the table, recognition and a new plan after a set-down
    """

    open_s: float = 0.7
    release_s: float = 0.6
    grasp_s: float = 0.75
    press_s: float = 0.3
    fixed_open_s: float = 0.35
    fixed_grasp_s: float = 0.15
    fixed_release_s: float = 0.2
    read_s: float = 0.25
    ringing_s: float = 0.3
    picture_s: float = 0.4
    judge_s: float = 2.0
    verdict_s: float = 2.0
    relook_s: float = 12.0

    @property
    def pick_s(self) -> float:
        """Time of the jaws to take the part off the table, and to prove the hold."""
        return self.open_s + self.grasp_s + self.press_s

    def look_s(self, lit_count: int) -> float:
        """Return the time of a view, with proof of the grasp, the backlit picture and the others.

        Parameters
        ----------
        lit_count : pictures beside the backlit one
        """
        return self.press_s + self.ringing_s + (1 + lit_count) * self.picture_s + self.read_s

    @property
    def give_step_s(self) -> float:
        """Time of both jaws to give the part to the fixed gripper."""
        return self.fixed_open_s + self.press_s + self.fixed_grasp_s + self.read_s + self.release_s

    @property
    def receive_s(self) -> float:
        """Time of both jaws to give it back to the arm gripper."""
        return (
            self.open_s + self.grasp_s + self.fixed_release_s + self.fixed_open_s + 2 * self.press_s
        )

    @property
    def hand_off_s(self) -> float:
        """Time of the jaws for a regrasp over the fixed gripper."""
        return self.give_step_s + self.receive_s

    @property
    def put_s(self) -> float:
        """Time of the jaws to release on the table or over a tray, proven above and below."""
        return 2 * self.press_s + self.release_s


@dataclass(frozen=True, slots=True, eq=False)
class CellLayout:
    """All data of the cell that planning depends on.

    Attributes
    ----------
    arm : with the shapes of its links
    column : box in the world of the part of the arm that stands still
    T_world_fixed_tcp : pose of the fixed gripper's TCP frame
    obstacles : world boxes by name, the fixed gripper's post among them
    station_mm : (3,) position of the part's centre of mass before the `inspection` camera
    fixed_gripper : None where the cell has none (then its pose says nothing)
    inspection_sharp_mm, overhead_sharp_mm : depths along the optical axis between which the
        camera's picture is sharp (its depth of field)
    set_down_mm : (2, 2) rows x and y, low and high: where on the table parts may be put down again
    park_q : (6,) rad and mm, joints as `arm` has them
    place_u_mm : standard uncertainty of where the arm is against all else, by its calibration;
        every margin to what stands in the cell is wider by `clearance_mm`
    fixed_held : mm and rad, by how much the fixed gripper may stand elsewhere along its pads and
        turned in their plane, where a calibration measured that plane alone
    neighbours : other objects on the table, beside the planned part
    trays : by their names, that of good parts first
    stored : parts that stand in the trays now
    """

    arm: ArmModel
    T_world_arm: FloatArray
    column: Box
    arm_gripper: Jaw
    fixed_gripper: Jaw | None
    T_world_fixed_tcp: FloatArray
    obstacles: Mapping[str, Box]
    station_mm: FloatArray
    inspection: Camera
    overhead: Camera
    trays: Mapping[str, Tray]
    park_q: FloatArray
    place_u_mm: float = 0.0
    fixed_held: tuple[float, float] = (0.0, 0.0)
    neighbours: tuple[PlacedShape, ...] = ()
    stored: tuple[PlacedShape, ...] = ()
    cell_times: CellTimes = field(default_factory=CellTimes)
    inspection_sharp_mm: tuple[float, float] = (0.0, float("inf"))
    overhead_sharp_mm: tuple[float, float] = (0.0, float("inf"))
    set_down_mm: FloatArray = field(
        default_factory=lambda: np.array([[270.0, 450.0], [-100.0, 100.0]])
    )

    @property
    def clearance_mm(self) -> float:
        """Expanded uncertainty (k = 2) of the arm's position against everything else."""
        return 2.0 * self.place_u_mm

    @property
    def fixed_open_mm(self) -> float:
        """The opening at which the fixed gripper waits; 0 where there is none."""
        return 0.0 if self.fixed_gripper is None else self.fixed_gripper.max_mm
