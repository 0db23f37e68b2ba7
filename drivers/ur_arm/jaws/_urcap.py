"""A Robotiq 2F by the socket that its URCap opens on the controller (§6).

Sections (§) are those of ur.md.
"""

import asyncio
from typing import Final

from drivers.clock import CellClock
from drivers.errors import (
    BadReplyError,
    FaultError,
    MotionStoppedError,
    PositionLostError,
    RefusedError,
    ReplyTimeoutError,
    StalledError,
)
from drivers.gripper_modbus import Counts, GripperConfig
from messages import key, say

from ..ports import Stream, open_stream
from ._reading import JawState

__all__ = ["UrcapJaws"]

REPLY_S: Final = 1.0  # the URCap asks the gripper over its serial line: some 10 ms [cell s]
POLL_S: Final = 0.02  # from one reading to the next while they move [cell s]
BEGIN_S: Final = 0.1  # an order takes this long to reach the gripper and be seen in OBJ [cell s]
REST_COUNT: Final = 2  # equal readings at rest, one after the other
ACTIVATION_S: Final = 10.0  # it boots, then opens and closes once, at its own speed [cell s]
MOVE_MARGIN: Final = 1.5  # speed is only nearly linear in its byte
MOVE_MARGIN_S: Final = 1.0
ACTIVE: Final = 3  # STA (§6.1)
MOVING, CONTACT_CLOSING = 0, 2  # OBJ (§6.1)
MINOR_FAULTS: Final = frozenset({0, 5, 7, 9})  # none, or cleared by activation (§6.2)
NO_GRIPPER: Final = "?"  # the URCap's answer while the gripper has no power (§6.1)


class UrcapJaws:
    """The gripper behind port 63352.

    Parameters
    ----------
    host, port : where it is
    clock : the cell's clock
    config : its scales, and the usual speed of its jaws
    idle_force_n : force with which they move in empty air
    """

    def __init__(
        self,
        host: str,
        port: int,
        clock: CellClock,
        config: GripperConfig,
        idle_force_n: float = 20.0,
    ) -> None:
        self._host, self._port, self._clock, self._config = host, port, clock, config
        self._idle_force_n = idle_force_n
        self._stream: Stream | None = None
        self._data = b""
        self._one = asyncio.Lock()
        self._target = 0
        self._stop_count = 0

    @property
    def model(self) -> str:
        """Name in messages and the journal."""
        return "Robotiq 2F by URCap"

    @property
    def max_opening_mm(self) -> float:
        """Largest opening [mm]."""
        return self._config.open_mm

    @property
    def force_range_n(self) -> tuple[float, float]:
        """Least and largest force of a grasp [N]."""
        return self._config.min_force_n, self._config.max_force_n

    async def connect(self) -> JawState:
        """Open the line; return the first reading."""
        await self.aclose()
        return await self.read()

    async def read(self) -> JawState:
        """Return a fresh reading.

        Raises
        ------
        FaultError : the gripper has a fault, which is its ``code``
        """
        status = await self._get("STA")
        if status is None:
            return JawState(0.0, is_activated=False, is_moving=False, is_pressing=False)
        contact, position, fault = [await self._get(name) or 0 for name in ("OBJ", "POS", "FLT")]
        if fault not in MINOR_FAULTS:
            raise FaultError(
                say(
                    "arm gripper: fault {fault}; see its light and the Robotiq page on the pendant",
                    fault=fault,
                ),
                fault,
            )
        is_active = status == ACTIVE
        is_shut = position >= self._config.counts_closed
        return JawState(
            opening_mm=max(0.0, self._config.counts_to_opening_mm(Counts(position))),
            is_activated=is_active,
            is_moving=is_active and contact == MOVING,
            is_pressing=is_active
            and (contact == CONTACT_CLOSING or (is_shut and contact != MOVING)),
        )

    async def activate(self) -> None:
        """Make the jaws ready to move, which opens and closes them.

        Raises
        ------
        StalledError : it does not become ready in time
        """
        stop_count = self._stop_count
        until_s = self._clock.attended_s() + ACTIVATION_S
        is_ordered = False
        while not (is_ordered and (await self.read()).is_activated):
            self._guard(stop_count)
            if self._clock.attended_s() > until_s:
                raise StalledError(
                    say(
                        "arm gripper: not active after {activation_s:g} s; see that it is "
                        "plugged in and its jaws are free, and its light",
                        activation_s=ACTIVATION_S,
                    )
                )
            if not is_ordered and await self._get("STA") is not None:
                await self._set("ACT 0")
                await self._set("ACT 1")
                is_ordered = True
            await self._clock.sleep(POLL_S)

    async def move_to(self, opening_mm: float) -> JawState:
        """Move empty jaws to an opening [mm]; return the reading where they rest."""
        return await self._go(opening_mm, self._idle_force_n, 1.0)

    async def close(self, force_n: float, speed_share: float) -> JawState:
        """Close with a force until they rest; return the reading there.

        Parameters
        ----------
        force_n : force [N]
        speed_share : share of the usual speed
        """
        return await self._go(0.0, force_n, speed_share)

    async def _go(self, opening_mm: float, force_n: float, speed_share: float) -> JawState:
        stop_count = self._stop_count
        before = await self.read()
        if not before.is_activated:
            raise PositionLostError(
                key(
                    "arm gripper: not active: it had no power; home the arm, which opens and "
                    "shuts it"
                )
            )
        speed_mm_s = max(self._config.default_speed_mm_s * speed_share, self._config.min_speed_mm_s)
        limit_s = MOVE_MARGIN * abs(before.opening_mm - opening_mm) / speed_mm_s + MOVE_MARGIN_S
        self._guard(stop_count)
        await self._set(
            f"POS {self._config.opening_mm_to_counts(opening_mm)} "
            f"SPE {self._config.speed_to_byte(speed_mm_s)} "
            f"FOR {self._config.force_to_byte(force_n)} GTO 1"
        )
        begun_s = self._clock.attended_s()
        rest_count, last_mm = 0, -1.0
        await self._clock.sleep(BEGIN_S)
        while True:
            state = await self.read()
            self._guard(stop_count)
            is_still = not state.is_moving and state.opening_mm == last_mm
            rest_count, last_mm = rest_count + 1 if is_still else 0, state.opening_mm
            if rest_count >= REST_COUNT:
                return state
            if self._clock.attended_s() - begun_s > limit_s:
                await self.stop()
                raise StalledError(
                    say(
                        "arm gripper: still moving after {limit_s:.1f} s, stopped at "
                        "{opening_mm:.1f} mm; look at the jaws",
                        limit_s=limit_s,
                        opening_mm=state.opening_mm,
                    )
                )
            await self._clock.sleep(POLL_S)

    def _guard(self, stop_count: int) -> None:
        if stop_count != self._stop_count:
            raise MotionStoppedError(key("arm gripper: stopped on request"))

    async def stop(self) -> None:
        """Stop jaws that are under way; those that hold something go on holding."""
        self._stop_count += 1
        if (await self.read()).is_moving:
            await self._set("GTO 0")

    async def _get(self, name: str) -> int | None:
        """Return a variable, None while the gripper has no power."""
        answer = await self._ask(f"GET {name}")
        if answer == NO_GRIPPER:
            return None
        given, _, value = answer.partition(" ")
        if given != name or not value.strip().isdigit():
            raise BadReplyError(
                say(
                    "arm gripper: `GET {name}` was answered by {answer}",
                    name=name,
                    answer=repr(answer[:40]),
                )
            )
        return int(value)

    async def _set(self, pairs: str) -> None:
        answer = await self._ask(f"SET {pairs}")
        if answer != "ack":
            raise RefusedError(
                say(
                    "arm gripper: `SET {pairs}` was answered by {answer}",
                    pairs=pairs,
                    answer=repr(answer[:40]),
                ),
                0,
            )

    async def _ask(self, line: str) -> str:
        """Return the answer to a line; what a cancelled one leaves dies with its connection."""
        async with self._one:
            if self._stream is None:
                self._stream = await open_stream(
                    "gripper (Robotiq URCap)", self._host, self._port, self._clock
                )
                self._data = b""
            try:
                self._stream.write(f"{line}\n".encode())
                return await self._line(line)
            except BaseException:
                await self._close()
                raise

    async def _line(self, asked: str) -> str:
        assert self._stream is not None, "open"
        try:
            async with self._clock.timeout(REPLY_S):
                self._data = await self._stream.read()
        except TimeoutError as error:
            raise ReplyTimeoutError(
                say(
                    "arm gripper: no answer to `{asked}`; is the Robotiq URCap "
                    "installed, and the gripper plugged in at the tool?",
                    asked=asked,
                )
            ) from error
        # a short answer comes in one piece, and without an end of line (§6.1)
        line, self._data = self._data, b""
        return line.decode("utf-8", "replace").strip()

    async def _close(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            await stream.aclose()

    async def aclose(self) -> None:
        """Release the line; opens no jaw."""
        await self._close()
