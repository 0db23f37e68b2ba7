"""Begins to judge the pictures of a view, whether they were just taken or are stored.

Questions that do not hold up the arm go to the worker process one at a time.
"""

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from typing import Any, ParamSpec, TypeVar

import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.cell.compute import Compute, begin
from controller.cell.services.records import PartInGripper, Shown
from controller.inspection import NO_FACTS, PartFacts, ViewResult
from controller.planning import shown_pose
from controller.planning.model import CellLayout
from controller.setup.holder import holder_boxes

Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")


class Background:
    """Queues slow questions one by one, so that a quick one waits for one at most.

    The worker process answers questions in order. Urgent ones, for which the arm waits, are sent at
    once; the others are queued here.

    Attributes
    ----------
    lane : held by whoever asks. Of the questions put, one at most waits for it; the judging of a
        grasp that is over takes it before the rest, and keeps it
    """

    def __init__(self) -> None:
        self.lane = asyncio.Lock()
        self._next = asyncio.Lock()

    async def put(
        self,
        question: Callable[Arguments, Coroutine[Any, Any, Answer]],
        *args: Arguments.args,
        **kwargs: Arguments.kwargs,
    ) -> Answer:
        """Return the answer to a question.

        Parameters
        ----------
        question : question of the compute service
        *args, **kwargs : its arguments
        """
        async with self._next:
            await self.lane.acquire()
        try:
            return await question(*args, **kwargs)
        finally:
            self.lane.release()


def judge_held(
    compute: Compute,
    background: Background,
    layout: CellLayout,
    view: str,
    hold: PartInGripper,
    q: FloatArray,
    backlit: Grey,
    lit: Mapping[str, Grey],
    by_then: PartInGripper | None = None,
    facts: PartFacts = NO_FACTS,
) -> Shown:
    """Begin to judge a view of the held part; return it.

    Parameters
    ----------
    compute : judges it
    background : queue for questions that do not hold up the arm
    layout : layout with camera, arm and fixed gripper
    view : its name
    hold : grasp in which it was taken; learns from the result
    q : (6,) joints of the arm
    backlit, lit : pictures before the backlight panel, and by lamp
    by_then : grasp as known at that time; None for the one in `hold`
    facts : known of this part besides its CAD model
    """
    known = hold if by_then is None else by_then
    expected = shown_pose(layout, q, known.T_part_tcp)
    holder = holder_boxes(layout, q, known.opening_mm)
    asked = (view, expected, holder, backlit, lit, known.is_measured, facts)
    located = begin(compute.locate(*asked))
    return Shown(
        view=view,
        hold=hold,
        q=q,
        expected=expected,
        holder=holder,
        backlit=backlit,
        lamps=tuple(lit),
        is_hold_measured=known.is_measured,
        T_part_tcp=known.T_part_tcp,
        task=begin(background.put(compute.inspect, *asked)),
        located=located,
        facts=facts,
    )


def judge_on_table(
    compute: Compute,
    background: Background,
    view: str,
    T_world_part: FloatArray,
    planned: BoolArray,
    backlit: Grey,
    lit: Mapping[str, Grey],
    facts: PartFacts = NO_FACTS,
) -> Shown:
    """Begin to judge pictures of the table as a view of the part at rest on it; return it.

    Parameters
    ----------
    compute : judges it
    background : asks it
    view : its name
    T_world_part : (4, 4) pose of the part as recognised
    planned : (n,) the samples that count: those that the plan has this view resolve
    backlit, lit : pictures of the light table, and by lamp
    facts : known of this part besides its CAD model
    """
    inspect = compute.inspect_on_table  # of this part's recipe, whenever it is asked

    async def counted() -> ViewResult:
        found = await background.put(inspect, view, T_world_part, backlit, lit, facts)
        return found.within(planned)

    return Shown(
        view=view,
        hold=None,
        q=np.zeros(6),
        expected=T_world_part,
        holder=(),
        backlit=backlit,
        lamps=tuple(lit),
        is_hold_measured=True,
        T_part_tcp=None,
        task=begin(counted()),
        facts=facts,
    )
