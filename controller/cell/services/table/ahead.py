"""The next part, chosen and planned while the arm still has the one before it (ADR 81).

Objects that are left alone stay in place. So the next part can be planned from the last look at the
table, by a worker process of its own. Nothing moves by such a plan before a fresh look has
confirmed each object in place; otherwise the part is planned as usual.
"""

import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.cell.compute import OneTask
from controller.cell.custody import Around
from controller.cell.errors import CellError
from controller.cell.journal.rows import PlanDropped, SightingFields, StoredFields
from controller.cell.services.records import BatchProduct, BatchRecord, matrix
from controller.cell.services.trays import TRAYS
from controller.inspection import Verdict
from controller.planning import OnTable, Plan
from controller.recognition import Sighting
from controller.setup.turns import free_turn_of
from messages import key, say

from .choosing import apart_deg, apart_mm

log = logging.getLogger(__name__)

# Two looks at an object that nobody has moved differ by less, and a grasp shifts it by many times
# as much.
SAME_MM: Final = 0.5
SAME_DEG: Final = 0.5
SAME_PX: Final = 6  # change of an object's box if a neighbour no longer touches its outline

Seen = tuple[SightingFields, ...]
# [deg] that nobody can see, 0 first; None where no turn shows
Turns = tuple[float, ...] | None
# returns which of some objects is next, and of which product; None where nobody can know yet
Choose = Callable[[Seen], Awaitable[tuple[int, BatchProduct] | None]]


@dataclass(frozen=True, slots=True)
class Foreseen:
    """The next part with its plan.

    Attributes
    ----------
    product : product it belongs to
    one : the part, as it was seen
    around : other objects that the plan avoids
    turns_deg : undetectable turns of the part and of each neighbour
    avoid : grasps that the plan does without
    plan : from there
    """

    product: BatchProduct
    one: SightingFields
    around: Around
    turns_deg: tuple[Turns, ...]
    avoid: frozenset[str]
    plan: Plan

    def differs(self, seen: Seen) -> str:
        """Return the difference of a fresh look from the foreseen table; empty if there is none.

        Parameters
        ----------
        seen : all objects on the table
        """
        left = list(seen)
        objects = (self.one, *self.around.neighbours)
        for was, turns in zip(objects, self.turns_deg, strict=True):
            found = next((now for now in left if unseen_turn(was, now, turns) is not None), None)
            if found is None:
                name = was.part or key("the unknown object")
                return say(
                    "{name} at x {x_mm:.0f}, y {y_mm:.0f} mm is not as it was",
                    name=name,
                    x_mm=was.x_mm,
                    y_mm=was.y_mm,
                )
            left.remove(found)
        if left:
            name = left[0].part or key("an unknown object")
            return say(
                "{name} at x {x_mm:.0f}, y {y_mm:.0f} mm is new",
                name=name,
                x_mm=left[0].x_mm,
                y_mm=left[0].y_mm,
            )
        return ""

    def place_in(self, seen: Seen) -> int:
        """Return the number of the part among the objects of a look that does not differ."""
        turns = self.turns_deg[0]
        return next(
            k for k, now in enumerate(seen) if unseen_turn(self.one, now, turns) is not None
        )

    def as_planned(self, sighting: Sighting, now: SightingFields) -> Sighting:
        """Return a fresh sighting of the part, read in the plan's pose.

        A part that looks the same after some turn may be read either way, but not first one way and
        then the other: grasps and views of the plan are in the part's own frame.

        Parameters
        ----------
        sighting, now : sighting of the part in the fresh look, and its form in the journal
        """
        unseen_deg = unseen_turn(self.one, now, self.turns_deg[0])
        if not unseen_deg or sighting.T_world_part is None:
            return sighting
        return sighting.turned(float(np.radians(unseen_deg)))


def unseen_turn(was: SightingFields, now: SightingFields, turns: Turns) -> float | None:
    """Return the turn [deg] between two looks at one unmoved object, None if it is not one.

    Parameters
    ----------
    was, now : the two looks
    turns : turns that cannot be seen
    """
    if (was.part, was.pose_index, was.is_cut) != (now.part, now.pose_index, now.is_cut):
        return None
    if {o.part for o in was.ambiguous_with} != {o.part for o in now.ambiguous_with}:
        return None
    beside_px = max(abs(a - b) for a, b in zip(was.box_px, now.box_px, strict=True))
    if apart_mm(was, now) > SAME_MM or beside_px > SAME_PX:
        return None
    missing_deg = was.theta_deg - now.theta_deg
    if turns is None or _is_turn_open(now):
        return missing_deg
    return next((t for t in turns if apart_deg(missing_deg, t) <= SAME_DEG), None)


def _is_turn_open(now: SightingFields) -> bool:
    """Return True if an object's turn about the vertical is a guess."""
    free = free_turn_of(now.free_turn)
    return free is not None and (
        now.T_world_part is None or free.is_vertical(np.array(now.T_world_part))
    )


class LookAhead:
    """Works on the next part beside the current one.

    Parameters
    ----------
    record : record of the batch; its products have the services that work ahead
    """

    def __init__(self, record: BatchRecord) -> None:
        self._record = record
        self._next: OneTask[Foreseen | None] = OneTask()

    def begin(self, choose: Choose) -> None:
        """Begin, once a gripper has the current part; returns at once.

        Parameters
        ----------
        choose : says which of the objects left on the table comes next
        """
        self.drop()
        left, wanted = self._record.part.neighbours, self._record.wanted_next
        if left and any(product.ahead is not None for product in wanted):
            self._next.begin(self._foresee(choose, left))

    def drop(self) -> None:
        """Forget the foreseen table and its plan."""
        self._next.drop()

    async def aclose(self) -> None:
        """Forget the plan, and wait until none of it runs in this process."""
        await self._next.aclose()

    async def take(self, seen: Seen) -> Foreseen | None:
        """Return the foreseen plan if a fresh look shows all of it unchanged; once.

        Waits for a plan that is being made: it was begun before another could be.

        Parameters
        ----------
        seen : all objects on the table
        """
        task = self._next.take()
        foreseen = None if task is None else await task
        if foreseen is None:
            return None
        why = foreseen.differs(seen) or self._why_void(foreseen)
        if why:
            self._record.note(PlanDropped(reason=why))
            return None
        return foreseen

    def _why_void(self, foreseen: Foreseen) -> str:
        """Return why a plan no longer holds, whatever is on the table; empty if it does."""
        if foreseen.avoid != foreseen.product.budgets.grasps:
            return key("a grasp is avoided now that was allowed when the plan was made")
        if _places(foreseen.around.stored) != _places(self._record.trays.stored):
            return key("the part before it went into another nest")
        return ""

    async def _foresee(self, choose: Choose, seen: Seen) -> Foreseen | None:
        try:
            found = await choose(seen)
            if found is None:
                return None
            number, product = found
            one, avoid = seen[number], product.budgets.grasps
            # which part an ambiguous one is, the fresh look decides
            if product.ahead is None or one.ambiguous_with or one.T_world_part is None:
                return None
            around = Around((*seen[:number], *seen[number + 1 :]), self._stored_then())
            start = OnTable(one.pose_index, np.array(one.T_world_part))
            turns = await product.ahead.unseen_turns((one, *around.neighbours))
            plan = await product.ahead.plan(start, None, avoid, (), around)
            return Foreseen(product, one, around, turns, avoid, plan)
        except Exception as error:  # noqa: BLE001  whatever it is: the part is planned as ever
            level = logging.INFO if isinstance(error, CellError) else logging.WARNING
            log.log(level, "nothing planned ahead: %s", error)
            return None

    def _stored_then(self) -> tuple[StoredFields, ...]:
        """Return the content of the trays once the current part is accepted, as most parts are."""
        record, part, accept = self._record, self._record.part, TRAYS[Verdict.PASS]
        nest, plan = record.trays.next_nest(accept), part.plan
        if nest is None or plan is None or part.sighting is None or part.sighting.part is None:
            return record.trays.stored
        stored = StoredFields(
            tray=accept,
            nest=nest,
            part=part.sighting.part,
            T_world_part=matrix(plan.place[accept].T_world_part),
        )
        return (*record.trays.stored, stored)


def _places(stored: tuple[StoredFields, ...]) -> list[StoredFields]:
    """Return the stored parts that a plan keeps clear of, without the run that put them there."""
    return [one.model_copy(update={"run": "", "number": 0, "serial": ""}) for one in stored]
