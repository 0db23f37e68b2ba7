"""Reads a gripper: for its verbs, often enough to keep it awake, and to notice a lost part.

Every reading passes here. Nothing here writes to the gripper.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Final

from messages import say

from ..errors import DeviceError, FaultError, StalledError
from ..kinds import Hold
from ..modbus_link import ModbusUnit
from ._config import GripperConfig
from ._registers import (
    INPUT_COUNT,
    INPUT_REGISTER,
    FaultClass,
    decode_inputs,
    fault_of,
)
from ._status import GraspResult, GripperStatus, judge_hold

log = logging.getLogger(__name__)

# A fast emulated cell shares the host: polling more often would slow it down.
MIN_MOVE_POLL_WALL_S: Final = 0.004
MIN_HOLD_POLL_WALL_S: Final = 0.02


class GripperMonitor:
    """The readings of one gripper.

    Parameters
    ----------
    unit : the gripper on its line
    config : calibration, and how often to read

    Attributes
    ----------
    grasp : the last grasp, whose part must stay; None if nothing is gripped
    latest : the last reading
    lost : set once a reading shows that the part of ``grasp`` is gone
    """

    def __init__(self, unit: ModbusUnit, config: GripperConfig) -> None:
        self._unit = unit
        self._clock = unit.link.clock
        self._config = config
        self._name = unit.name
        self.grasp: GraspResult | None = None
        self.latest: GripperStatus | None = None
        self.lost = asyncio.Event()
        self._keeper: asyncio.Task[None] | None = None

    def keep_awake(self) -> None:
        """Start reading often enough to avoid fault 09 (no message for 1 s)."""
        if self._keeper is None:
            self._keeper = asyncio.create_task(self._keep_alive(), name=f"{self._name} keep-alive")

    async def aclose(self) -> None:
        """End the keep-alive."""
        keeper, self._keeper = self._keeper, None
        if keeper is not None:
            keeper.cancel()
            (outcome,) = await asyncio.gather(keeper, return_exceptions=True)
            if isinstance(outcome, Exception):
                raise outcome  # a bug ended it early

    async def status(self) -> GripperStatus:
        """Read the input block and return the status."""
        at_s = self._clock.now_s()
        registers = await self._unit.read_holding_registers(INPUT_REGISTER, INPUT_COUNT)
        status = GripperStatus.of(decode_inputs(registers), self._config, at_s)
        self.latest = status
        if judge_hold(self.grasp, status, self._config) is Hold.LOST and not self.lost.is_set():
            log.warning("%s: part lost, jaws now at %.1f mm", self._name, status.opening_mm)
            self.lost.set()
        return status

    async def until(
        self,
        claim: Callable[[GripperStatus], bool],
        limit_s: float,
        what: str,
        *,
        stop_at_major: bool = False,
    ) -> GripperStatus:
        """Read until a condition on the status holds, for ``limit_s`` [cell s]; return the status.

        Parameters
        ----------
        claim : condition that the status must meet
        limit_s : time limit of the reading [cell s of attended time]
        what : the action under way, for the message of an error
        stop_at_major : raise at once when the gripper reports a major fault

        Raises
        ------
        FaultError : a major fault, with ``stop_at_major``; or the limit has passed and the gripper
            reports any fault
        StalledError : the limit has passed without a fault: something blocks the fingers
        """
        deadline_s = self.deadline_s(limit_s)
        while True:
            status = await self.status()
            if stop_at_major and fault_of(status.fault).kind is FaultClass.MAJOR:
                raise FaultError(
                    say(
                        "{name}: {what}: {fault_text}",
                        name=self._name,
                        what=what,
                        fault_text=status.fault_text,
                    ),
                    status.fault,
                )
            if claim(status):
                return status
            if self._clock.attended_s() > deadline_s:
                message = say(
                    "{name}: {what} not finished after {limit_s:g} s",
                    name=self._name,
                    what=what,
                    limit_s=limit_s,
                )
                if status.has_fault:
                    raise FaultError(
                        say(
                            "{message}; {fault_text}", message=message, fault_text=status.fault_text
                        ),
                        status.fault,
                    )
                raise StalledError(
                    say("{message}; check that the fingers are free", message=message)
                )
            await self.pause()

    async def pause(self) -> None:
        """Wait as long as between two readings while the jaws move."""
        await self._clock.sleep(
            max(self._config.move_poll_s, MIN_MOVE_POLL_WALL_S * self._clock.speed)
        )

    def deadline_s(self, limit_s: float) -> float:
        """Return the attended instant at which ``limit_s`` from now is over [cell s]."""
        return self._clock.attended_s() + self._clock.patience_s(limit_s)

    async def _keep_alive(self) -> None:
        is_failing = False
        while True:
            period_s = self._config.keep_alive_s
            if self.grasp:
                hold_poll_s = max(
                    self._config.hold_poll_s, MIN_HOLD_POLL_WALL_S * self._clock.speed
                )
                period_s = min(period_s, hold_poll_s)
            # whatever else was asked meanwhile: a race with it would be decided by chance, and a
            # recorded run could not be replayed (docs/wires.md)
            await self._clock.sleep(period_s)
            try:
                await self.status()
            except DeviceError as error:
                if not is_failing:
                    log.warning("keep-alive: %s", error)
                is_failing = True
            else:
                is_failing = False
