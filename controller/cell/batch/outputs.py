"""Tells a PLC at 24 V what the run does, by the outputs of the I/O block that the cell file names.

The run is the block's one master and writes them; the words are those of a PLC's registers
(docs/plant-plc.md). A result is told once `PartDone` is on the disk, so that a run that is killed
and one that goes on after it never tell the same part twice.
"""

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Iterable, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Final

from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.kinds import SignalOutputs

from ..services.records import BatchRecord, PartRecord

log = logging.getLogger(__name__)

RESULT_VALID: Final = "result_valid"
LOOKS: Final = frozenset({"idle", "acquiring", "recognising"})  # no part is worked on
AT_REST: Final = frozenset({"stopped", "complete"})
FAULTS: Final = frozenset({"aborting", "aborted", "clearing"})
ASKS: Final = frozenset({"holding", "held"})
# A result stands at least so long: ten cycles of a slow PLC (50 ms) [cell s].
RESULT_S: Final = 0.5
# From `accept` or `reject` to `result_valid`: a small relay closes and bounces for 15 ms at most,
# and so does the input behind it filter [cell s].
SETTLED_S: Final = 0.05
# An output that was not written is tried again after this [cell s].
RETRY_S: Final = 0.5


def signals_of(state: str, result: PartRecord | None) -> dict[str, bool]:
    """Return all signals.

    Parameters
    ----------
    state : the run's, as its progress has it
    result : the placed part whose result stands; None for none
    """
    is_ready = state in LOOKS
    tray = None if result is None else result.tray
    return {
        "ready": is_ready,
        "busy": not is_ready and state not in AT_REST | FAULTS,
        "held": state in ASKS,
        "fault": state in FAULTS,
        "accept": tray == "accept",
        "reject": tray == "reject",
        RESULT_VALID: result is not None,
    }


def result_of(state: str, part: PartRecord, done: PartRecord | None) -> PartRecord | None:
    """Return the part whose result stands: the last one placed, until another is worked on.

    Parameters
    ----------
    state : the run's
    part : the part at hand
    done : the last part that is done; None for none
    """
    if done is None or done.tray is None or state in FAULTS:
        return None
    is_looking = state.rpartition("_")[2] in LOOKS
    return done if part is done or is_looking else None


class PlcSignals:
    """Keeps the wired outputs true while a run is on, and off when it is not.

    Parameters
    ----------
    outputs : the I/O block; None where no output is wired
    wired : names of the signals that are wired
    record : what the run does
    clock : clock of the cell
    """

    def __init__(
        self,
        outputs: SignalOutputs | None,
        wired: Iterable[str],
        record: BatchRecord,
        clock: CellClock,
    ) -> None:
        self._outputs = outputs
        self._wired = frozenset(wired)
        self._record = record
        self._clock = clock
        self._changed = asyncio.Event()
        self._shown: PartRecord | None = None
        self._last: PartRecord | None = None  # that was shown: no result rises twice
        self._stands_until_s = -math.inf

    def note(self) -> None:
        """Take note that the run may be in another state."""
        self._changed.set()

    @asynccontextmanager
    async def told(self) -> AsyncIterator[None]:
        """Tell them until the context ends; the last result then stands its time, but for errors.

        An output that cannot be written is logged and ends nothing: the inputs of the same block
        stop the run, and its watchdog opens the outputs.
        """
        if self._outputs is None or not self._wired:
            yield
            return
        following = asyncio.create_task(self._follow(self._outputs), name="PLC signals")
        try:
            try:
                yield
            finally:
                following.cancel()
                await asyncio.gather(following, return_exceptions=True)
            with suppress(DeviceError):  # said below
                await self._tell(self._outputs)
                if self._shown is not None:
                    await self._clock.sleep(self._stands_until_s - self._clock.now_s())
        finally:
            try:
                await self._write(self._outputs, dict.fromkeys((RESULT_VALID, *self._wired), False))
            except DeviceError as error:
                log.warning("24 V signals may be on until the block's watchdog trips: %s", error)

    async def _follow(self, outputs: SignalOutputs) -> None:
        while True:
            self._changed.clear()
            pause_s = math.inf
            try:
                await self._tell(outputs)
            except DeviceError as error:
                log.warning("24 V signals are not as they should be: %s", error)
                pause_s = RETRY_S
            if self._shown is not None and self._shown is not self._result():
                pause_s = min(pause_s, self._stands_until_s - self._clock.now_s())
            changed = asyncio.ensure_future(self._changed.wait())
            try:
                await self._clock.wait({changed}, pause_s)
            finally:
                changed.cancel()

    def _result(self) -> PartRecord | None:
        record = self._record
        done = record.finished[-1] if record.finished else None
        return result_of(record.progress.state, record.part, done)

    async def _tell(self, outputs: SignalOutputs) -> None:
        """Write what is so: a result's tray before it is valid, and not after."""
        state, result, shown = self._record.progress.state, self._result(), self._shown
        is_due = self._clock.now_s() >= self._stands_until_s
        if shown is not None and result is not shown and (is_due or state in FAULTS):
            await self._write(outputs, {RESULT_VALID: False})
            self._shown = None
        if self._shown is None and result is not None and result is not self._last:
            signals = signals_of(state, result)
            await self._write(outputs, {n: on for n, on in signals.items() if n != RESULT_VALID})
            await self._clock.sleep(SETTLED_S)
            self._shown = self._last = result
            self._stands_until_s = self._clock.now_s() + RESULT_S
            state = self._record.progress.state
        await self._write(outputs, signals_of(state, None if state in FAULTS else self._shown))

    async def _write(self, outputs: SignalOutputs, signals: Mapping[str, bool]) -> None:
        offs_first = sorted(signals.items(), key=lambda signal: signal[1])
        await outputs.set_outputs({n: on for n, on in offs_first if n in self._wired})
