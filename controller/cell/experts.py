"""Whom the cell asks where the part lies, what to do with it, and what a view shows.

In a run that is the worker process (`Workers`). The dispatcher and its actions know the questions
only, so that somebody else may answer them.
"""

import asyncio
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.planning import Doubt, Motion, Plan, Start
from controller.recognition import Alternative, Sighting

from . import workers

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Grey = NDArray[np.uint8]
Result = TypeVar("Result")
Holder = tuple[inspecting.WorldBox, ...]


class Experts(Protocol):
    """The questions; each may take seconds, and none of them moves anything."""

    async def prepare(self) -> float:
        """Do all planning that does not depend on where the part lies; return its seconds."""
        ...

    async def recognise(self, glowing: Grey, lit: Mapping[str, Grey]) -> tuple[Sighting, ...]:
        """Return what lies on the table."""
        ...

    async def plan(
        self,
        start: Start,
        seen: Mask | None,
        avoid: frozenset[str],
        candidates: tuple[Alternative, ...],
    ) -> Plan:
        """Return a plan from whoever has the part.

        Parameters
        ----------
        seen : (n,) bool, samples that need not be shown again
        avoid : ids of grips that have failed
        candidates : what it may be as well, as far as recognition can tell

        Raises
        ------
        NoPlanError : and why not
        """
        ...

    async def tell(
        self, doubt: Doubt, q: Array, opening_mm: float, backlit: Grey, lit: tuple[Grey, ...]
    ) -> tuple[int, ...]:
        """Return which candidates the pictures of the view that is to tell leave; none fits: ()."""
        ...

    async def way_home(
        self, q: Array, hand_mm: float, fixture_mm: float, T_part_hand: Array | None
    ) -> Motion:
        """Return a way from anywhere to where the arm is in nobody's way.

        Parameters
        ----------
        q : (6,) where the arm stands; hand_mm, fixture_mm : how wide the jaws are
        T_part_hand : of a part that may still be in the hand, or None

        Raises
        ------
        NoMotionError : no way free of contact
        """
        ...

    async def inspect(
        self,
        view_id: str,
        T_world_part: Array,
        holder: Holder,
        backlit: Grey,
        lit: Mapping[str, Grey],
        is_hold_seen: bool,
    ) -> inspecting.ViewResult:
        """Judge one view."""
        ...

    async def inspect_lying(
        self, view_id: str, T_world_part: Array, glowing: Grey, lit: Mapping[str, Grey]
    ) -> inspecting.ViewResult:
        """Judge the pictures of the table as a view of the part that lies there."""
        ...

    async def find_hold(
        self, T_world_part: Array, T_part_hand: Array, holder: Holder, backlit: Grey
    ) -> Array | None:
        """Look for a part that is not where it should be in the hand: T_world_part or None."""
        ...

    async def judge(
        self,
        views: tuple[inspecting.ViewResult, ...],
        unseen: Mapping[int, str],
        planned: Mapping[str, Mask],
    ) -> inspecting.PartVerdict:
        """Weigh all views of a part.

        Parameters
        ----------
        unseen : by face id, why the plan shows not all of it
        planned : by view id, which samples (n,) it was meant to show
        """
        ...

    async def share(self, samples: Mask) -> float:
        """Return how much of the part's surface some of its samples (n,) stand for, 0..1."""
        ...


class Workers:
    """The worker process of a job."""

    def __init__(self, job: workers.Job, pool: Executor) -> None:
        self._job = job
        self._pool = pool

    async def _ask(self, function: Callable[..., Result], *args: object) -> Result:
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._pool, function, self._job, *args)

    async def prepare(self) -> float:
        """As `Experts`."""
        return await self._ask(workers.prepare)

    async def recognise(self, glowing: Grey, lit: Mapping[str, Grey]) -> tuple[Sighting, ...]:
        """As `Experts`."""
        return await self._ask(workers.recognise, glowing, lit)

    async def plan(
        self,
        start: Start,
        seen: Mask | None,
        avoid: frozenset[str],
        candidates: tuple[Alternative, ...],
    ) -> Plan:
        """As `Experts`."""
        return await self._ask(workers.plan_from, start, seen, avoid, candidates)

    async def tell(
        self, doubt: Doubt, q: Array, opening_mm: float, backlit: Grey, lit: tuple[Grey, ...]
    ) -> tuple[int, ...]:
        """As `Experts`."""
        return await self._ask(workers.tell, doubt, q, opening_mm, backlit, lit)

    async def way_home(
        self, q: Array, hand_mm: float, fixture_mm: float, T_part_hand: Array | None
    ) -> Motion:
        """As `Experts`."""
        return await self._ask(workers.way_home, q, hand_mm, fixture_mm, T_part_hand)

    async def inspect(
        self,
        view_id: str,
        T_world_part: Array,
        holder: Holder,
        backlit: Grey,
        lit: Mapping[str, Grey],
        is_hold_seen: bool,
    ) -> inspecting.ViewResult:
        """As `Experts`."""
        return await self._ask(
            workers.inspect, view_id, T_world_part, holder, backlit, lit, is_hold_seen
        )

    async def inspect_lying(
        self, view_id: str, T_world_part: Array, glowing: Grey, lit: Mapping[str, Grey]
    ) -> inspecting.ViewResult:
        """As `Experts`."""
        return await self._ask(workers.inspect_lying, view_id, T_world_part, glowing, lit)

    async def find_hold(
        self, T_world_part: Array, T_part_hand: Array, holder: Holder, backlit: Grey
    ) -> Array | None:
        """As `Experts`."""
        return await self._ask(workers.find_hold, T_world_part, T_part_hand, holder, backlit)

    async def judge(
        self,
        views: tuple[inspecting.ViewResult, ...],
        unseen: Mapping[int, str],
        planned: Mapping[str, Mask],
    ) -> inspecting.PartVerdict:
        """As `Experts`."""
        return await self._ask(workers.judge, views, unseen, planned)

    async def share(self, samples: Mask) -> float:
        """As `Experts`."""
        return await self._ask(workers.share, samples)
