"""Plans: steps to drive, their forecast, the surface shown, and reasons for the rest.

A motion is a tuple of waypoints q (6,), ending at the arm's target; it starts at the end of the
step before. Joints are those of the layout's arm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from controller.arrays import BoolArray, FloatArray
from messages import key

from .grasp import Grasp
from .hypotheses import HeldHypothesis, Light

JointPath = tuple[FloatArray, ...]


def lit_count(*, is_square: bool) -> int:
    """Return the number of pictures of a view beside the backlit one, each under another lamp.

    On a plane seen squarely, the side lamp's shadows reveal pockets and steps. In slanting views
    they fall mostly where the prediction is not trusted.
    """
    return 2 if is_square else 1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Step:
    """One action of the cell.

    Attributes
    ----------
    seconds : forecast [cell s], `wait_s` of it until what was shown is judged
    label : for people
    """

    seconds: float
    wait_s: float = 0.0
    label: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Pick(Step):
    """Take the part off the table: go above it, open, come down, close, lift."""

    grasp: Grasp
    motion_in: JointPath
    pre_open_mm: float
    motion_down: JointPath
    expected_opening_mm: float
    motion_up: JointPath


@dataclass(frozen=True, slots=True, eq=False)
class Ambiguity:
    """Hypotheses that a view has to tell apart.

    Attributes
    ----------
    hypotheses : the part that was planned for comes first
    light : the picture that tells
    margin : difference over the difference required; 1 is enough
    """

    hypotheses: tuple[HeldHypothesis, ...]
    light: Light
    margin: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Present(Step):
    """Show the part to the inspection camera.

    Attributes
    ----------
    q : (6,) present joints of the arm
    T_world_part : (4, 4) pose of the part then
    direction_part : (3,) unit, from the centre of mass to the camera, in the part frame
    seen : (n,) bool, per sample
    square_to : id of the planar face or bore this view is square to, -1 if none
    ambiguity : ambiguity that this view is to resolve before anything else is done; None as a rule
    """

    view_id: str
    grasp: Grasp
    motion: JointPath
    q: FloatArray
    T_world_part: FloatArray
    direction_part: FloatArray
    seen: BoolArray
    square_to: int
    expected_opening_mm: float
    ambiguity: Ambiguity | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GiveStep(Step):
    """Give the part to the fixed gripper: open it, bring the part in, close it, open the arm's."""

    grasp: Grasp
    fixed_grasp: Grasp
    fixed_pre_open_mm: float
    motion: JointPath
    fixed_expected_opening_mm: float
    arm_open_mm: float
    retreat: JointPath


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReceiveStep(Step):
    """Take the part from the fixed gripper with another grasp."""

    grasp: Grasp
    fixed_grasp: Grasp
    motion_in: JointPath
    pre_open_mm: float
    approach: JointPath
    expected_opening_mm: float
    fixed_open_mm: float
    motion_out: JointPath


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SetDown(Step):
    """Put the part back on the table, to be looked at and taken with another grasp.

    Its resting place is known to a millimetre only, so a plan goes no further than this: the cell
    looks at the table again and makes a new plan. The steps after it are a forecast.

    Attributes
    ----------
    pose_index : index of the stable pose it is put down in
    T_world_part : (4, 4) pose of the part
    """

    grasp: Grasp
    motion: JointPath
    motion_down: JointPath
    open_mm: float
    motion_up: JointPath
    T_world_part: FloatArray
    pose_index: int


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Look(Step):
    """Inspect the part where it lies, by the latest pictures of the table.

    Attributes
    ----------
    seen : (n,) bool, per sample
    T_world_part : (4, 4) pose of the part
    """

    view_id: str
    T_world_part: FloatArray
    direction_part: FloatArray
    seen: BoolArray


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Place(Step):
    """Put the part into a tray.

    Attributes
    ----------
    tilt_rad : tilt of the part when it is released; 0 where it is set down
    """

    tray: str
    grasp: Grasp
    motion: JointPath
    motion_down: JointPath
    open_mm: float
    motion_up: JointPath
    T_world_part: FloatArray
    tilt_rad: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Park(Step):
    """Go to the park position, clear of all work."""

    motion: JointPath


class Reason(StrEnum):
    """Reason for a piece of surface not shown; the first that applies (planning-facts.md 1.3)."""

    HIDDEN_BY_PART = key("hidden by the part")
    FINGERS = "fingers"
    REACH = "reach"
    NO_REGRASP_PATH = key("no regrasp path")
    GRASP_STRENGTH = key("grasp strength")
    LEFT_OUT = key("left out")  # it could be shown; options or a failed motion left it out


@dataclass(frozen=True, slots=True)
class Unseen:
    """A piece of a face that no view of the plan shows.

    Attributes
    ----------
    area_fraction : share of all surface
    reason : a sentence for people, with the evidence
    kind : kind of the step, one of five
    advice : the smallest change found that would show it, or ""
    samples : indices of the samples
    """

    face_id: int
    area_fraction: float
    reason: str
    kind: Reason
    advice: str = ""
    samples: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Proof:
    """Proven quality of a plan, and the scope of the proof.

    The cost covers regrasps (seconds and risk) and views at a fixed cost each, but not the order of
    the views.

    Attributes
    ----------
    cost_s, bound_s : cost and bound of this plan, and what no plan of the scope can undercut
    scope : the candidates to which the proof applies
    """

    cost_s: float
    bound_s: float
    scope: str

    @property
    def gap(self) -> float:
        """Share of its cost by which the plan may still be improved."""
        return max(0.0, self.cost_s - self.bound_s) / self.cost_s if self.cost_s > 0 else 0.0

    @property
    def is_optimal(self) -> bool:
        """True if no plan of the scope is cheaper."""
        return self.gap < 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The steps of one part through the cell.

    Attributes
    ----------
    steps : in order, up to where the verdict is known
    place, park : per tray, what comes then; the tray of good parts first, as in the layout
    covered_fraction : share of the surface in sight at least once
    covered_U : expanded uncertainty (k = 2) of that share, from how far apart its points are
    reachable_fraction : share that any grasp and any view of this cell could inspect, regrasps
        aside
    """

    steps: tuple[Step, ...]
    place: Mapping[str, Place]
    park: Mapping[str, Park]
    covered_fraction: float
    covered_U: float  # noqa: N815 (U is the symbol of the field)
    reachable_fraction: float
    unseen: tuple[Unseen, ...]
    grasps: tuple[Grasp, ...]
    proof: Proof

    @property
    def seconds_by_step(self) -> tuple[tuple[str, float], ...]:
        """The forecast step by step, the tray of a good part last."""
        return tuple((s.label, s.seconds) for s in (*self.steps, *self.good_part_steps))

    @property
    def forecast_s(self) -> float:
        """The forecast of all steps of a good part."""
        return sum(seconds for _, seconds in self.seconds_by_step)

    @property
    def good_part_steps(self) -> tuple[Place, Park]:
        """The steps of a good part once all is seen, by which the plan is forecast."""
        good = next(iter(self.place))
        return self.place[good], self.park[good]

    @property
    def presents(self) -> tuple[Present, ...]:
        """The views in order."""
        return tuple(s for s in self.steps if isinstance(s, Present))

    @property
    def regrasp_count(self) -> int:
        """Number of times the part changes grasp."""
        return sum(isinstance(s, ReceiveStep | SetDown) for s in self.steps)
