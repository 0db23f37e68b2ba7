"""The vision system: what clients' calls do, and what the cell's changes show. One lock for both.

It asks the cell through `Plant` alone. What it keeps of its own is which recipe a client has
prepared and whether one has halted the starts, in a file, so that neither is lost with the bridge.
"""

import asyncio
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

from pydantic import BaseModel, ConfigDict, ValidationError

from controller.page.security.private_file import SharedFileError, read_private, write_private
from controller.plant.model import AlarmNotice, CellState, OrderRequest, OrderState, PartResult
from controller.plant.plant import Offer, Plant, PlantError, RefusedError, UnknownError
from messages import say

from .events import Events
from .space import CellSpace
from .states import (
    EXECUTING,
    Cause,
    ClientRequest,
    JobKind,
    VisionState,
    VisionTransition,
    transition_of,
    transitions_between,
    vision_state_of,
)
from .values import internal_recipe, record, result_fields, text

log = logging.getLogger(__name__)

SOURCE: Final = "by OPC UA"
# A call waits this long for the cell: homing is not waited for, an order is answered at once.
CALL_MAX_WALL_S: Final = 20.0
BEGUN: Final = ("queued", "running")


class Refusal(IntEnum):
    """`Error` of a method: 0 is done, below 0 is ours (OPC 40100-1, 8.2.4); `why` says it in words.

    The sentence goes out as a VisionInformationEvent.
    """

    DONE = 0
    STATE = -1
    """Not in this state."""
    UNKNOWN = -2
    """There is no such recipe, result, configuration or job."""
    REFUSED = -3
    """The cell does not take it: a permit is missing, or it is in no state for it."""
    ARGUMENT = -4
    """An argument cannot be used."""
    NO_ANSWER = -5
    """The cell has not answered in time."""


class NotDoneError(Exception):
    """A call is refused.

    Attributes
    ----------
    refusal : number that goes out as `Error`
    """

    def __init__(self, refusal: Refusal, why: str) -> None:
        super().__init__(why)
        self.refusal = refusal


class _Kept(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")
    prepared: str | None = None
    prepared_sha256: str = ""
    is_halted: bool = False


@dataclass(frozen=True, slots=True)
class VisionJob:
    """A job that was accepted and is not over.

    Attributes
    ----------
    order : number of its order
    state : of the order
    has_run : its run was there, or it was stopped: what the cell says is all that counts
    """

    order: str
    kind: JobKind
    state: str
    has_run: bool = False


class VisionSystem:
    """The vision system of one cell.

    Parameters
    ----------
    plant : the cell
    space : its nodes
    events : its events
    path : file of what it keeps
    """

    def __init__(self, plant: Plant, space: CellSpace, events: Events, path: Path) -> None:
        self.plant = plant
        self._space = space
        self._events = events
        self._path = path
        self._kept = _read(path)
        self._vision_state = VisionState.PREOPERATIONAL
        self._cell: CellState | None = None
        self._job: VisionJob | None = None
        self._turn = asyncio.Lock()

    @property
    def vision_state(self) -> VisionState:
        """State of the machine now."""
        return self._vision_state

    async def begin(self) -> None:
        """Show where the cell stands, with a job that another life of the bridge began."""
        async with self._turn:
            await self._space.show_state(self._vision_state)
            for order in await self.plant.orders():
                if order.source.endswith(SOURCE) and order.is_open:
                    self._job = VisionJob(order.number, _kind(order), order.state)
            self._cell = await self.plant.state()
            await self._settle()

    # what the cell does

    async def cell_changed(self, cell: CellState) -> None:
        """Show a change of the cell."""
        async with self._turn:
            self._cell = cell
            job = self._job
            if job is not None and cell.run is not None and cell.order == job.order:
                self._job = replace(job, has_run=True)
            await self._settle()

    async def order_changed(self, order: OrderState) -> None:
        """Show a change of an order, if it is the job's."""
        async with self._turn:
            if self._job is None or order.number != self._job.order:
                return
            self._job = replace(self._job, state=order.state)
            if not order.is_open:
                if order.reason:
                    await self._events.raised(
                        "Information", f"job {order.number} is {order.state}: {order.reason}"
                    )
                await self._settle()
                self._job = None
            await self._settle()

    async def finished(self, result: PartResult) -> None:
        """Say that a result is there."""
        fields = result_fields(result)
        who = f"part {result.part}" + (f", {result.serial}" if result.serial else "")
        revised = f" (revision {result.revision})" if result.revision > 1 else ""
        async with self._turn:
            await self._events.raised("ResultReady", f"{who}: {result.verdict}{revised}", fields)

    async def alarmed(self, alarm: AlarmNotice) -> None:
        """Say that an alarm was raised, or acknowledged."""
        number = f"alarm {alarm.number}" if alarm.number is not None else "alarm"
        async with self._turn:
            await self._events.raised(
                "Information", f"{number} {alarm.code} {alarm.change}: {alarm.message}"
            )

    # what clients call

    async def prepare_recipe(self, offer: Offer) -> None:
        """Prepare a recipe; another that was prepared is not any more.

        Raises
        ------
        NotDoneError : it cannot be used, or the machine is in another state
        """
        async with self._call("PrepareRecipe", VisionState.INITIALIZED, VisionState.READY):
            if offer.problem:
                raise NotDoneError(Refusal.REFUSED, offer.problem)
            self._keep(prepared=offer.key, prepared_sha256=offer.sha256)
            await self._events.raised(
                "RecipePrepared",
                f"{offer.key} is prepared",
                {
                    "InternalId": internal_recipe(offer.key, offer.sha256, offer.name),
                    "ExternalId": None,
                    "ProductId": None,
                },
            )

    async def unprepare_recipe(self, offer: Offer) -> None:
        """Let go of the prepared recipe.

        Raises
        ------
        NotDoneError : it is not prepared, or the machine is in another state
        """
        async with self._call("UnprepareRecipe", VisionState.READY):
            if self._kept.prepared != offer.key:
                raise NotDoneError(Refusal.STATE, f"{offer.key} is not prepared")
            self._keep(prepared=None, prepared_sha256="")

    def is_prepared(self, offer: Offer) -> bool:
        """Return whether a recipe is prepared."""
        return (self._kept.prepared, self._kept.prepared_sha256) == (offer.key, offer.sha256)

    async def start(
        self,
        kind: JobKind,
        account: str,
        number: str,
        recipe: str,
        serial: str,
        quantity: int | None,
    ) -> str:
        """Order one part, or many, of the prepared recipe.

        Parameters
        ----------
        kind : one part, or many
        account : who orders
        number : number of the order; empty for one that is made here
        recipe : key of the recipe; empty for the prepared one
        serial : serial number of a single part; empty without
        quantity : number of parts; None for the recipe's own

        Returns
        -------
        number of the order

        Raises
        ------
        NotDoneError : no recipe is prepared, a job is running, or the cell refuses
        """
        cause: Cause = "StartSingleJob" if kind == "single" else "StartContinuous"
        async with self._call(cause, VisionState.READY):
            prepared = await self._prepared_offer()
            if recipe and recipe != prepared.key:
                raise NotDoneError(Refusal.STATE, f"{recipe} is not prepared, {prepared.key} is")
            if self._job is not None and not self._job.has_run:
                raise NotDoneError(
                    Refusal.STATE, f"job {self._job.order} is {self._job.state}; stop it first"
                )
            number = number or f"opcua-{uuid4().hex[:12]}"
            try:
                request = OrderRequest(
                    recipe=prepared.key,
                    quantity=1 if kind == "single" else quantity,
                    serials=(serial,) if serial else (),
                )
            except ValidationError as error:
                raise NotDoneError(Refusal.ARGUMENT, _first(error)) from error
            known = {order.number for order in await self.plant.orders()}
            if number in known:
                raise NotDoneError(
                    Refusal.ARGUMENT,
                    f"MeasId {number} was used already: it is the number of the order, and starts"
                    " one job",
                )
            order = await self.plant.order(number, request, f"{account} {SOURCE}")
            if order.state == "refused":
                raise NotDoneError(Refusal.REFUSED, order.reason or "the cell refuses the order")
            if order.is_open:
                self._job = VisionJob(number, kind, order.state)
            return number

    async def stop(self, cause: Cause, account: str, why: str) -> None:
        """Stop the job on a ramp, or abort it: the cell stops at once.

        Parameters
        ----------
        cause : `Stop` or `Abort`
        account : who asks for it
        why : for the cell's record

        Raises
        ------
        NotDoneError : nothing runs, or the cell refuses
        """
        async with self._call(cause, *EXECUTING, VisionState.READY):
            await self._end_job(cause, account, why)

    async def halt(self, account: str, why: str) -> None:
        """Stop what runs, and refuse starts until `reset`.

        Raises
        ------
        NotDoneError : halted already, or the cell does not stop
        """
        async with self._call("Halt", *VisionState):
            if self._vision_state is VisionState.HALTED:
                raise NotDoneError(Refusal.STATE, "halted already")
            if self._vision_state in EXECUTING or self._job is not None:
                await self._end_job("Stop", account, why)
            self._keep(is_halted=True)

    async def reset(self) -> None:
        """Leave the halt, or let go of the prepared recipe.

        Raises
        ------
        NotDoneError : a person has to clear an error, or a job is running
        """
        async with self._call("Reset", *VisionState):
            if self._vision_state is VisionState.ERROR:
                said = self._cell.message if self._cell else ""
                raise NotDoneError(
                    Refusal.REFUSED,
                    f"a person at the cell must clear this: {said or 'see its screen'}",
                )
            if self._vision_state in EXECUTING or self._job is not None:
                raise NotDoneError(Refusal.STATE, "a job is running; stop it first")
            self._keep(prepared=None, prepared_sha256="", is_halted=False)

    async def said(self, why: str) -> None:
        """Say a refusal in words."""
        await self._events.raised("Information", why)

    # within

    @asynccontextmanager
    async def _call(self, cause: Cause, *vision_states: VisionState) -> AsyncIterator[None]:
        """Let a call do its part in one of some states; then make its transition and settle."""
        try:
            async with self._turn, asyncio.timeout(CALL_MAX_WALL_S):
                if self._vision_state not in vision_states:
                    raise NotDoneError(
                        Refusal.STATE,
                        f"{cause} is not possible in {self._vision_state}, only in"
                        f" {', '.join(dict.fromkeys(vision_states))}",
                    )
                yield
                transition = transition_of(cause, self._vision_state)
                # a job that waits for a person's release has not begun
                has_waited = cause in ("StartSingleJob", "StartContinuous") and not (
                    self._job is not None and self._job.state in BEGUN
                )
                if transition is not None and not has_waited:
                    await self._make(transition)
                await self._settle()
        except NotDoneError:
            raise
        except TimeoutError as error:
            raise NotDoneError(
                Refusal.NO_ANSWER, f"the cell has not answered within {CALL_MAX_WALL_S:.0f} s"
            ) from error
        except UnknownError as error:
            raise NotDoneError(Refusal.UNKNOWN, str(error)) from error
        except PlantError as error:
            raise NotDoneError(Refusal.REFUSED, str(error)) from error

    async def _end_job(self, cause: Cause, account: str, why: str) -> None:
        source = f"{account} {SOURCE}"
        if self._job is not None and self._job.state in ("queued", "asked"):
            try:
                await self.plant.withdraw(self._job.order, source)
            except RefusedError:
                pass  # it has begun meanwhile: stopped below
            else:
                self._job = None
                return
        if self._vision_state not in EXECUTING:
            raise NotDoneError(Refusal.STATE, "nothing runs")
        do = self.plant.abort if cause == "Abort" else self.plant.stop
        word = await do(source, why)
        if self._job is not None:
            self._job = replace(self._job, has_run=True)
        if self._cell is not None:  # what it will say itself in a moment
            self._cell = self._cell.model_copy(update={"state": word, "packml": "Stopping"})

    async def _prepared_offer(self) -> Offer:
        found = {offer.key: offer for offer in await self.plant.recipes()}
        offer = found.get(self._kept.prepared or "")
        if offer is None or not self.is_prepared(offer):
            raise NotDoneError(
                Refusal.STATE,
                f"{self._kept.prepared} has changed since it was prepared; prepare it again",
            )
        return offer

    async def _settle(self) -> None:
        """Go where the cell's state leads, by the fewest transitions."""
        if self._cell is None:
            return
        job = self._job
        request = ClientRequest(
            is_prepared=self._kept.prepared is not None,
            is_halted=self._kept.is_halted,
            order=job.order if job else None,
            kind=job.kind if job else None,
            has_begun=job is not None and job.state in BEGUN and not job.has_run,
        )
        for transition in transitions_between(
            self._vision_state, vision_state_of(self._cell, request, self._vision_state)
        ):
            await self._make(transition)
        await self._space.show_cell(self._cell, self._vision_state)

    async def _make(self, transition: VisionTransition) -> None:
        """Make a transition, with the events that belong to it."""
        before, self._vision_state = self._vision_state, transition.after
        await self._space.show_transition(transition)
        shown = self._space.transition(transition.name)
        await self._events.raised(
            "StateChanged",
            say("{before} to {after}", before=before, after=transition.after),
            {
                "FromState": text(before.value),
                "FromState/Id": self._space.state(before).node,
                "ToState": text(transition.after.value),
                "ToState/Id": self._space.state(transition.after).node,
                "Transition": text(transition.name),
                "Transition/Id": shown.node,
            },
        )
        said = (self._cell.message if self._cell else "") or transition.after.value
        if transition.after is VisionState.ERROR:
            await self._events.raised("Error", said)
        elif before is VisionState.ERROR:
            await self._events.raised("ErrorResolved", "the error is cleared")
        job_id = record("JobIdDataType", Id=self._job_id())
        if transition.after in EXECUTING:
            await self._events.raised("JobStarted", "a job has begun", {"JobId": job_id})
        elif before in EXECUTING and transition.after is VisionState.READY:
            await self._events.raised("Ready", "the job is over", {"JobId": job_id})

    def _job_id(self) -> str:
        if self._job is not None:
            return self._job.order
        return (self._cell.order or self._cell.run or "") if self._cell else ""

    def _keep(self, **changes: Any) -> None:
        kept = self._kept.model_copy(update=changes)
        if kept == self._kept:
            return
        try:
            write_private(self._path, kept.model_dump_json())
        except OSError as error:
            raise NotDoneError(Refusal.REFUSED, f"cannot be kept: {error}") from error
        self._kept = kept


def _kind(order: OrderState) -> JobKind:
    return "single" if order.request.count == 1 else "continuous"


def _read(path: Path) -> _Kept:
    try:
        text = read_private(path)
        return _Kept() if text is None else _Kept.model_validate_json(text)
    except (OSError, SharedFileError, ValidationError) as error:
        # what cannot be read may have been a halt
        log.warning("%s: %s; starts by OPC UA are halted until Reset", path, error)
        return _Kept(is_halted=True)


def _first(error: ValidationError) -> str:
    return str(error.errors()[0]["msg"]).removeprefix("Value error, ")
