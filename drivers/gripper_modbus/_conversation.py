"""The conversation with a gripper below its verbs: asking, writing once, keeping it awake.

Knows when a part is lost, since every reading passes here. Moves nothing.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Final

from ..errors import DeviceError, FaultError, ReplyTimeoutError, StalledError, UnpluggedError
from ..kinds import Hold
from ..modbus_link import FunctionCode, ModbusLink, Request
from ._config import GripperConfig
from ._registers import (
    INPUT_COUNT,
    INPUT_REGISTER,
    OUTPUT_REGISTER,
    FaultClass,
    decode_inputs,
    fault_of,
)
from ._status import GraspResult, GripperStatus, judge_hold

log = logging.getLogger(__name__)

# An emulated cell that runs fast shares the host: asking more often costs it more than it learns.
MIN_MOVE_POLL_WALL_S: Final = 0.004
MIN_HOLD_POLL_WALL_S: Final = 0.02
NOT_KNOWN_TO_BE_DONE: Final = (ReplyTimeoutError, UnpluggedError)  # errors after which one looks


class Conversation:
    """Everything said to one gripper; the verbs are built on it.

    Parameters
    ----------
    link : the line the gripper is on
    config : its slave id, calibration and limits
    name : what messages call it
    """

    def __init__(self, link: ModbusLink, config: GripperConfig, name: str) -> None:
        self.clock = link.clock
        self.config = config
        self.name = name
        self.unit = link.unit(
            config.unit,
            name,
            spacing_s=config.spacing_s,
            probes=tuple(
                Request(FunctionCode.READ_HOLDING_REGISTERS, INPUT_REGISTER, count)
                for count in (1, 2)
            ),
            check=(
                f"its 24 V supply, its slave id {config.unit}, RS-485 A and B, 115200 8N1 "
                "(a Robotiq also stays silent when it does not like a request)"
            ),
        )
        self.grasp: GraspResult | None = None
        self.latest: GripperStatus | None = None
        self.lost = asyncio.Event()
        self._asked_at_s = self.clock.now_s()
        self._keeper: asyncio.Task[None] | None = None

    def keep_awake(self) -> None:
        """Start asking it often enough for fault 09 to stay away."""
        if self._keeper is None:
            self._keeper = asyncio.create_task(self._keep_alive(), name=f"{self.name} keep-alive")

    async def aclose(self) -> None:
        """End the keep-alive."""
        keeper, self._keeper = self._keeper, None
        if keeper is not None:
            keeper.cancel()
            (outcome,) = await asyncio.gather(keeper, return_exceptions=True)
            if isinstance(outcome, Exception):
                raise outcome  # a bug ended it early

    async def status(self) -> GripperStatus:
        """Read the input block."""
        at_s = self.clock.now_s()
        self._asked_at_s = at_s
        registers = await self.unit.read_holding_registers(INPUT_REGISTER, INPUT_COUNT)
        status = GripperStatus.of(decode_inputs(registers), self.config, at_s)
        self.latest = status
        if judge_hold(self.grasp, status, self.config) is Hold.LOST and not self.lost.is_set():
            log.warning("%s: part lost, jaws now at %.1f mm", self.name, status.width_mm)
            self.lost.set()
        return status

    async def write(
        self, outputs: tuple[int, int, int], has_arrived: Callable[[GripperStatus], bool]
    ) -> None:
        """Write the output block; after silence look whether it arrived before repeating it.

        Outputs are absolute, so the one repetition moves nothing twice.
        """
        self._asked_at_s = self.clock.now_s()
        try:
            await self.unit.write_registers(OUTPUT_REGISTER, outputs)
        except NOT_KNOWN_TO_BE_DONE as error:
            log.warning("reading back: %s", error)
            if not has_arrived(await self.status()):
                await self.unit.write_registers(OUTPUT_REGISTER, outputs)

    async def until(
        self,
        claim: Callable[[GripperStatus], bool],
        limit_s: float,
        what: str,
        *,
        stop_at_major: bool = False,
    ) -> GripperStatus:
        """Read the status until a claim about it holds, for at most ``limit_s`` [cell s].

        Parameters
        ----------
        claim : what must become true of the status
        limit_s : how long to keep asking [cell s of attended time]
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
                raise FaultError(f"{self.name}: {what}: {status.fault_text}", status.fault)
            if claim(status):
                return status
            if self.clock.attended_s() > deadline_s:
                message = f"{self.name}: {what} not finished after {limit_s:g} s"
                if status.has_fault:
                    raise FaultError(f"{message}; {status.fault_text}", status.fault)
                raise StalledError(f"{message}; check that the fingers are free")
            await self.pause()

    async def pause(self) -> None:
        """Wait as long as between two readings while the jaws move."""
        await self.clock.sleep(
            max(self.config.move_poll_s, MIN_MOVE_POLL_WALL_S * self.clock.speed)
        )

    def deadline_s(self, limit_s: float) -> float:
        """Return the attended instant at which ``limit_s`` from now is over [cell s]."""
        return self.clock.attended_s() + self.clock.patience_s(limit_s)

    async def _keep_alive(self) -> None:
        is_failing = False
        while True:
            period_s = self.config.keep_alive_s
            if self.grasp:
                hold_poll_s = max(self.config.hold_poll_s, MIN_HOLD_POLL_WALL_S * self.clock.speed)
                period_s = min(period_s, hold_poll_s)
            remaining_s = self._asked_at_s + period_s - self.clock.now_s()
            if remaining_s > 0:
                await self.clock.sleep(remaining_s)
                continue
            try:
                await self.status()
            except DeviceError as error:
                if not is_failing:
                    log.warning("keep-alive: %s", error)
                is_failing = True
            else:
                is_failing = False
