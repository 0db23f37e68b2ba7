"""The gate that everything passes before it moves or looks: holds a pause, requires the permit.

A paused effect is not ended. Its task waits at the gate with its next motion in hand, and continues
with the same waypoint. A pause is reached as soon as nothing moves and nothing can begin to: *now*,
at a safe point, or at the end of a step. Any task that comes to the gate while the door is open
waits there, too, and has the door reported.
"""

import asyncio
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from contextvars import ContextVar
from enum import Enum
from typing import Final

from controller.cell.errors import InterlockError
from controller.cell.journal.rows import FirstMotion
from controller.cell.machine import PauseKind, SafePoint
from drivers.clock import CellClock

from .permits import Permits

# Longest time for the arm to stop on its ramp and to confirm it [cell s].
STOP_RAMP_S: Final = 2.0
# Longest time for jaws to finish a motion [cell s]; the drivers' own limits.
JAWS_S: Final = 10.0


class Mover(Enum):
    """A mover behind the gate."""

    ARM = "arm"
    ARM_JAWS = "jaws of the arm gripper"
    FIXED_JAWS = "jaws of the fixed gripper"


Preview = Callable[[], Awaitable[FirstMotion]]
# returns once a motion may begin, as far as people are concerned
Approve = Callable[[FirstMotion], Awaitable[None]]
# reports an open door, and returns whether there is one
Guard = Callable[[], bool]


class Gate:
    """Lets through the motions that are allowed now.

    Parameters
    ----------
    permits : required of whatever passes
    clock : clock of the cell
    approve : awaited before each motion; None where motions need nobody's word

    Attributes
    ----------
    guard : called before anything passes
    """

    def __init__(self, permits: Permits, clock: CellClock, approve: Approve | None = None) -> None:
        self.permits = permits
        self.guard: Guard = lambda: False
        self._approve = approve
        self._clock = clock
        self._wanted: PauseKind | None = None
        self._is_closed = False
        self._halts_jaws = False
        # nobody knows where the arm stands before it has moved
        self._point: SafePoint | None = None
        self._ends_step = False
        self._moving: Counter[Mover] = Counter()
        self._bound_s: float | None = None
        self._is_in_step = False
        self._is_single_step = False
        self._waiting: list[Preview] = []
        self._changed = asyncio.Event()
        self._is_check: ContextVar[bool] = ContextVar("is_check", default=False)

    # ---- for what moves --------------------------------------------------------------------------
    @asynccontextmanager
    async def moving(self, preview: Preview, mover: Mover) -> AsyncIterator[None]:
        """Wait until a motion may begin, then note that it is under way.

        Parameters
        ----------
        preview : describes the motion, for whoever decides when it begins
        mover : a pause *now* stops the arm on its way; jaws finish what they have begun

        Raises
        ------
        NoPermitError : nothing may move
        """
        await self._until_approved(preview)
        self.permits.require()
        if not self._is_check.get():
            self._point, self._ends_step = None, False
        self._moving[mover] += 1
        self._change()
        try:
            yield
        finally:
            self._moving[mover] -= 1
            self._change()

    async def _until_approved(self, preview: Preview) -> None:
        """Wait until the gate is open and the motion approved; a pause since then asks again."""
        while True:
            await self.wait(preview)
            if self._approve is None or self._is_check.get():
                return
            self._waiting.append(preview)
            try:
                await self._approve(await preview())
            finally:
                self._waiting.remove(preview)
            if not self._holds_back():
                return

    async def wait(self, preview: Preview) -> None:
        """Wait until the gate is open; a look is no motion, so it requires no permit.

        Parameters
        ----------
        preview : describes what follows
        """
        if self._is_check.get() or not self._holds_back():
            return
        self._waiting.append(preview)
        try:
            while self._holds_back():
                await self._next_change()
        finally:
            self._waiting.remove(preview)

    async def until_admitted(self, admit: Callable[[], Awaitable[None]], preview: Preview) -> None:
        """Return once a motion is admitted; a motion barred by an open door waits until it closes.

        Parameters
        ----------
        admit : raises where it is not
        preview : describes what follows

        Raises
        ------
        InterlockError : an interlock rule does not hold
        """
        while True:
            try:
                await admit()
            except InterlockError as error:
                if not error.holds or not self.guard():
                    raise
                await self.wait(preview)
            else:
                return

    def reach(self, point: SafePoint, *, ends_step: bool = False) -> None:
        """Note that the cell stands at a safe point, until the next motion begins."""
        self._point, self._ends_step = point, ends_step
        if ends_step:
            self._bound_s, self._is_in_step = None, False
        self._change()

    def begin_step(self, worst_s: float) -> None:
        """Note that a step begins, which takes ``worst_s`` at most [cell s]."""
        self._bound_s, self._is_in_step = self._clock.now_s() + worst_s, True

    def begin_path(self, worst_s: float) -> None:
        """Note that a path begins, which takes ``worst_s`` at most [cell s]; a step has its own."""
        if not self._is_in_step:
            self._bound_s = self._clock.now_s() + worst_s

    @property
    def was_interrupted(self) -> bool:
        """Whether a pause *now* has stopped the arm on its way: its motion is to be repeated."""
        return self._wanted is PauseKind.NOW

    @property
    def halts_jaws(self) -> bool:
        """Whether the pause stops jaws on their way, too: their motion is to be repeated."""
        return self._halts_jaws and self.was_interrupted

    # ---- for who pauses --------------------------------------------------------------------------
    def want(self, kind: PauseKind) -> None:
        """Request a pause; a request already made may become more urgent, never less."""
        if self._wanted is None or kind.urgency > self._wanted.urgency:
            self._wanted = kind
        self._change()

    def halt(self) -> None:
        """Request a pause that stops moving jaws, too: somebody may be among them."""
        self._halts_jaws = True
        self.want(PauseKind.NOW)

    def close(self) -> None:
        """Let nothing through, at any place."""
        self._is_closed, self._wanted = True, None
        self._change()

    def open(self) -> None:
        """Let everything through that has a permit."""
        self._is_closed, self._wanted, self._halts_jaws = False, None, False
        self._change()

    def prepare(self, *, is_single_step: bool) -> None:
        """Note whether one step is to follow, or all; the gate opens once that is found safe."""
        self._is_single_step = is_single_step

    @property
    def is_single_step(self) -> bool:
        """Whether one step alone is to follow."""
        return self._is_single_step

    def open_for_step(self) -> None:
        """Let one step through."""
        self._is_closed, self._wanted, self._halts_jaws = False, PauseKind.AFTER_STEP, False
        # where the cell stands now ended the step before this one
        self._point, self._ends_step = None, False
        self._change()

    @property
    def wanted(self) -> PauseKind | None:
        """The pause that is requested and not reached yet."""
        return self._wanted

    @property
    def movers(self) -> frozenset[Mover]:
        """The movers in motion."""
        return frozenset(+self._moving)

    @property
    def is_settled(self) -> bool:
        """Whether nothing moves, and nothing will before the gate is opened."""
        return self._blocks() and not self.movers

    @property
    def point(self) -> SafePoint | None:
        """The safe point at which the cell stands, None elsewhere."""
        return self._point

    @property
    def now_s(self) -> float:
        """The cell's clock [cell s]."""
        return self._clock.now_s()

    async def changed(self) -> None:
        """Wait until something about the gate has changed."""
        await self._next_change()

    @contextmanager
    def checking(self) -> Iterator[None]:
        """Let this task through a closed gate while the block runs: it checks before a resume."""
        token = self._is_check.set(True)
        try:
            yield
        finally:
            self._is_check.reset(token)

    async def next_motion(self) -> FirstMotion | None:
        """Return the first motion after the gate opens; None while it is still being computed."""
        return await self._waiting[0]() if self._waiting else None

    def seconds_to(self, kind: PauseKind) -> float | None:
        """Return the longest time until the cell stands still [cell s]; None if unknown.

        Parameters
        ----------
        kind : kind of the pause
        """
        movers = self.movers
        now_s = JAWS_S if movers - {Mover.ARM} else STOP_RAMP_S if movers else 0.0
        if kind is PauseKind.NOW or self._is_closed:
            return now_s
        if not now_s and self._is_met(kind):
            return 0.0
        if self._bound_s is None:
            return None
        return max(self._bound_s - self._clock.now_s(), now_s)

    # ---- how it decides --------------------------------------------------------------------------
    def _is_met(self, kind: PauseKind) -> bool:
        if kind is PauseKind.NOW:
            return True
        return self._point is not None and (self._ends_step or kind is PauseKind.SAFE_POINT)

    def _blocks(self) -> bool:
        return self._is_closed or (self._wanted is not None and self._is_met(self._wanted))

    def _holds_back(self) -> bool:
        return self._blocks() or self.guard()

    def _change(self) -> None:
        self._changed.set()

    async def _next_change(self) -> None:
        self._changed.clear()
        await self._changed.wait()
