"""The Moxa ioLogik E1214: inputs polled all the time, outputs switched by name.

Register map: modbus_devices.md 7.1. The safety inputs read here are a copy of the safety chain:
they may stop work early, but must never be relied on for safety (§7.4).

Sections (§) are those of modbus_devices.md.
"""

import asyncio
import logging
import math
from collections.abc import AsyncIterator, Callable, Mapping
from typing import Final, Self

from messages import key, say

from ..errors import DeviceError, RefusedError, WatchdogOffError, WrongDeviceError
from ..kinds import Change, Signal
from ..modbus_link import FunctionCode, ModbusLink, Request, VerbLock, always
from ..supervisor import BlindLook, BlindStop
from ._config import MOTOR_RELAY, IoConfig
from .signals import Believer, Snapshot

log = logging.getLogger(__name__)

FIRST_INPUT: Final = 0  # discrete inputs
FIRST_RELAY: Final = 0  # coils
GUARDS: Final = ("estop_ok", "guard_closed", "supply_ok")  # nothing moves without them
MODEL_REGISTER: Final = 5000  # input registers, 10 of them
MODEL_COUNT: Final = 10
WATCHDOG_COIL: Final = 4144
# Longest delay of the block's own clock and relay: its flag is polled for this long after the
# watchdog's time [s].
TRIP_SLACK_S: Final = 0.3

Observer = Callable[[Change], None]


class Watch(AsyncIterator[Change]):
    """Changes from the moment it was got, in order; ends when the driver is closed."""

    def __init__(self, on_close: Callable[["Watch"], None]) -> None:
        self._queue: asyncio.Queue[Change | None] = asyncio.Queue()
        self._on_close = on_close

    def put(self, change: Change | None) -> None:
        """Add a change; None ends it."""
        self._queue.put_nowait(change)

    def close(self) -> None:
        """Stop collecting changes."""
        self._on_close(self)
        self.put(None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __anext__(self) -> Change:
        change = await self._queue.get()
        if change is None:
            self.put(None)  # the next caller must end, too
            raise StopAsyncIteration
        return change


class CellIo:
    """The cell's inputs and relays. Polls from `connect` to `aclose`; usable as ``async with``.

    Parameters
    ----------
    link : connection to the block; not closed by this
    config : wiring
    on_change : called with every change; must return at once
    name : name used in messages
    """

    def __init__(
        self,
        link: ModbusLink,
        config: IoConfig | None = None,
        on_change: Observer | None = None,
        name: str = key("I/O block"),
    ) -> None:
        self.config = config or IoConfig()
        self.name = name
        self._clock = link.clock
        self._count = self.config.channel_count
        self._unit = link.unit(
            self.config.unit,
            name,
            probes=(
                Request(FunctionCode.READ_INPUT_REGISTERS, MODEL_REGISTER, 1),
                Request(FunctionCode.READ_INPUT_REGISTERS, MODEL_REGISTER, 2),
            ),
            check=say(
                "its power, its network cable, and its unit id {unit}", unit=self.config.unit
            ),
        )
        self._on_change = on_change
        self._believer = Believer(self.config.inputs)
        self._relay_of = {channel.name: channel.channel for channel in self.config.outputs}
        self._relays: tuple[bool, ...] | None = None
        self._switching = VerbLock(link)
        self._talking = VerbLock(link)  # whoever has it may keep the block from hearing anything
        self._tripped = asyncio.Event()
        self._is_trip_wanted = self.config.watchdog_s is not None  # until it was proven
        self._read_at_s = -math.inf
        self._attended_at_s = -math.inf  # the same instant without what this process missed
        self._watches: set[Watch] = set()
        self._poller: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    def blind_stop(self) -> BlindStop | None:
        """Return the switch that cuts the motors' supply; None if no relay of ours is in it."""
        if self.watchdog_s is None:
            return None
        return self._unit.blind_switch(FIRST_RELAY + self._relay_of[MOTOR_RELAY], is_on=False)

    def blind_look(self) -> BlindLook | None:
        """Return a reading of emergency stop, door and supply, for the supervisor to make.

        None if the line has no room for a second reader. A look feeds the block's watchdog, so
        whoever looks has `blind_stop` as well, and does not go on looking after that.
        """
        guards = tuple(c.channel for c in self.config.inputs if c.name in GUARDS)
        return self._unit.blind_look(self._count, guards)

    async def connect(self) -> str:
        """Check the model, start polling, return the model name. Switches nothing.

        Raises
        ------
        WrongDeviceError : another device answers
        """
        model = await self.identify()
        if self._poller is None:
            self._poller = asyncio.create_task(self._poll(), name=f"{self.name} poll")
        return model

    @property
    def model(self) -> str:
        """The device's name in messages and the journal."""
        return say("Moxa {model}", model=self.config.model)

    async def aclose(self) -> None:
        """End polling; relays stay as they are, signals become unknown."""
        poller, self._poller = self._poller, None
        if poller is None:
            return
        poller.cancel()
        (outcome,) = await asyncio.gather(poller, return_exceptions=True)
        self._publish(self._believer.forget(self._clock.now_s()))
        for watch in self._watches:
            watch.put(None)
        if isinstance(outcome, Exception):
            raise outcome  # a bug ended it early

    async def identify(self) -> str:
        """Return the model name.

        Raises
        ------
        WrongDeviceError : it is another model, or something that names none
        """
        advice = key("check address and unit id, or which device is connected there")
        try:
            registers = await self._unit.read_input_registers(MODEL_REGISTER, MODEL_COUNT)
        except RefusedError as error:
            raise WrongDeviceError(
                say(
                    "{unit}: expected a Moxa {model}, found {error}; {advice} (its "
                    "register map may also have been redefined in its web console)",
                    unit=self._unit,
                    model=self.config.model,
                    error=error,
                    advice=advice,
                )
            ) from error
        raw = b"".join(register.to_bytes(2, "big") for register in registers)
        model = raw.split(b"\0")[0].decode("ascii", "replace").strip()
        if self.config.model.lower() not in model.lower():
            raise WrongDeviceError(
                say(
                    "{unit}: expected a Moxa {model}, found {found}; {advice}",
                    unit=self._unit,
                    model=self.config.model,
                    found=repr(model),
                    advice=advice,
                )
            )
        return model

    # --- inputs ---

    def snapshot(self) -> Snapshot:
        """Return the known state of all inputs now; stale readings count as unknown."""
        if self._is_stale():
            return Snapshot(self._read_at_s, dict.fromkeys(self._believer.signals, Signal.UNKNOWN))
        return Snapshot(self._read_at_s, dict(self._believer.signals))

    def signal(self, name: str) -> Signal:
        """Return the known state of one input now.

        Raises
        ------
        ValueError : no such input
        """
        if name not in self._believer.signals:
            raise ValueError(f"no input {name!r}; there are {', '.join(self._believer.signals)}")
        return Signal.UNKNOWN if self._is_stale() else self._believer.signals[name]

    def watch(self) -> Watch:
        """Return all changes from now on: ``with io.watch() as changes: async for ...``."""
        watch = Watch(self._watches.discard)
        self._watches.add(watch)
        return watch

    async def wait_for(self, name: str, signal: Signal) -> None:
        """Wait until an input is known to have a state. Put a time-out around it.

        Raises
        ------
        DeviceError : the block was closed meanwhile
        """
        with self.watch() as changes:
            if self.signal(name) is signal:
                return
            async for change in changes:
                if change.name == name and change.signal is signal:
                    return
        raise DeviceError(
            say("{name}: closed while waiting for {signal}", name=self.name, signal=name)
        )

    # --- relays ---

    async def set_outputs(self, outputs: Mapping[str, bool], *, force: bool = False) -> None:
        """Close (True) or open relays by name, in the order given; nothing is sent to the others.

        A request that named them all would close the motors' relay again after a supervisor has
        opened it. Writes only what changes, unless ``force``.

        Raises
        ------
        ValueError : no such output; nothing has been sent
        LinkError : done or not; the next call reads the relays first
        """
        unknown = [name for name in outputs if name not in self._relay_of]
        if unknown:
            raise ValueError(f"no output {unknown[0]!r}; there are {', '.join(self._relay_of)}")
        async with self._switching.held("set_outputs"):
            known = self._relays
            if known is None:
                known = await self._unit.read_coils(FIRST_RELAY, self._count)
            wanted = list(known)
            self._relays = None
            for name, is_closed in outputs.items():
                channel = self._relay_of[name]
                if force or known[channel] is not is_closed:
                    await self._unit.write_coil(FIRST_RELAY + channel, is_closed, again=always)
                    wanted[channel] = is_closed
            self._relays = tuple(wanted)

    async def read_outputs(self) -> dict[str, bool]:
        """Return whether each relay is closed, by name, as the block reads them back."""
        async with self._switching.held("read_outputs"):
            self._relays = await self._unit.read_coils(FIRST_RELAY, self._count)
            return {name: self._relays[channel] for name, channel in self._relay_of.items()}

    async def has_watchdog_tripped(self) -> bool:
        """Return whether the block's watchdog put its outputs into their safe state."""
        return (await self._unit.read_coils(WATCHDOG_COIL, 1))[0]

    async def clear_watchdog(self) -> None:
        """Clear that flag; the relays are then read before they are next switched."""
        async with self._switching.held("clear_watchdog"):
            self._relays = None
            await self._unit.write_coil(WATCHDOG_COIL, True, again=always)

    @property
    def watchdog_s(self) -> float | None:
        """Silence after which the block takes the motors' supply away; None: it never does."""
        return self.config.watchdog_s if MOTOR_RELAY in self._relay_of else None

    async def fall_silent(self) -> bool:
        """Send nothing for the watchdog's time; return whether it has tripped.

        To be called while nothing moves: inputs are unknown meanwhile, so that no motion is
        admitted, and no change of them is reported. They are read before this returns.

        Raises
        ------
        ValueError : nothing depends on the watchdog
        """
        watchdog_s = self.config.watchdog_s
        if watchdog_s is None:
            raise ValueError(f"{self.name}: no watchdog_s")
        async with self._talking.held("fall_silent"), self._switching.held("fall_silent"):
            self._read_at_s = self._attended_at_s = -math.inf
            await self._clock.sleep(watchdog_s + TRIP_SLACK_S)
            has_tripped = await self.has_watchdog_tripped()
            self._is_trip_wanted = True
            await self._read_once(fresh_for_s=self._stale_s)
            return has_tripped

    async def restore_motor_supply(self) -> None:
        """Clear the flag; close the relay in the motors' supply, if any, and read it back.

        Raises
        ------
        WatchdogOffError : the relay does not close
        """
        await self.clear_watchdog()
        await self._close_motor_relay()
        self._is_trip_wanted = False

    async def _close_motor_relay(self) -> None:
        if MOTOR_RELAY not in self._relay_of:
            return
        await self.set_outputs({MOTOR_RELAY: True}, force=True)
        if not (await self.read_outputs())[MOTOR_RELAY]:
            raise WatchdogOffError(
                say(
                    "{unit}: the relay in the motors' supply (output {relay_of}) does "
                    "not close; check the output's mode and the safe state in the "
                    "block's web console",
                    unit=self._unit,
                    relay_of=self._relay_of[MOTOR_RELAY],
                )
            )

    async def wait_tripped(self) -> None:
        """Wait for a watchdog flag that no `fall_silent` has caused."""
        await self._tripped.wait()

    async def prove_watchdog(self) -> None:
        """Prove that the watchdog trips and opens all outputs, then close the motors' relay.

        Nothing where no output depends on it. All other outputs are off afterwards.

        Raises
        ------
        WatchdogOffError : it does not trip, it leaves an output on, or the relay does not close
        """
        watchdog_s = self.config.watchdog_s
        if watchdog_s is None:
            return
        self._is_trip_wanted = True  # the flag is up since the last controller left
        await self.clear_watchdog()
        if not await self.fall_silent():
            raise WatchdogOffError(
                say(
                    "{unit}: its watchdog has not tripped within {silent_s:.1f} s of "
                    "silence, so a computer that freezes would leave its outputs as "
                    "they are, the arm with its supply and the PLC with old signals; "
                    "set the host connection watchdog to {watchdog_s:g} s in the "
                    "block's web console, all outputs safe when open, and let nothing "
                    "else poll the block; or leave `motor_relay` and `outputs` out of "
                    "the cell file",
                    unit=self._unit,
                    silent_s=watchdog_s + TRIP_SLACK_S,
                    watchdog_s=watchdog_s,
                )
            )
        still_on = [name for name, is_on in (await self.read_outputs()).items() if is_on]
        if still_on:
            raise WatchdogOffError(
                say(
                    "{unit}: its watchdog has left {still_on} on; set the safe state "
                    "of every output to open in the block's web console",
                    unit=self._unit,
                    still_on=", ".join(still_on),
                )
            )
        await self.restore_motor_supply()

    # --- polling ---

    def _is_stale(self) -> bool:
        poller = self._poller
        if self._clock.waits and poller is not None and not poller.done():
            # That clock stands for this process and creeps for the last look: the poller, which
            # has asked anew by then, alone tells a late reader from a silent block, and forgets.
            return self._read_at_s == -math.inf
        return self._clock.attended_s() - self._attended_at_s > self._stale_s

    @property
    def _stale_s(self) -> float:
        return self._clock.patience_s(self.config.stale_s)

    async def _poll(self) -> None:
        due_s = self._clock.now_s()
        while True:
            async with self._talking.held("poll"):
                await self._read_once()
            due_s = max(due_s + self.config.poll_s, self._clock.now_s())
            await self._clock.sleep(due_s - self._clock.now_s())

    async def _read_once(self, fresh_for_s: float | None = None) -> None:
        at_s, attended_at_s = self._clock.now_s(), self._clock.attended_s()
        reading = asyncio.ensure_future(self._ask())
        try:
            # A silent block holds this up for longer than a reading may be old.
            if fresh_for_s is None:
                fresh_for_s = max(0.0, self._attended_at_s + self._stale_s - attended_at_s)
            await self._clock.wait({reading}, fresh_for_s, looks_again=True)
            if not reading.done():
                self._forget()
            try:
                bits = await reading
            except DeviceError as error:
                self._fail(error)
                return
        finally:
            reading.cancel()
        if self._clock.attended_s() - attended_at_s > self._stale_s:
            return  # too old on arrival: it is asked for once more, at once
        self._read_at_s, self._attended_at_s = at_s, attended_at_s
        self._publish(self._believer.take(bits, at_s))

    async def _ask(self) -> tuple[bool, ...]:
        """Return all inputs; note a watchdog that has tripped."""
        bits = await self._unit.read_discrete_inputs(FIRST_INPUT, self._count)
        if self.config.watchdog_s is not None and await self.has_watchdog_tripped():
            self._relays = None
            if not self._is_trip_wanted:
                self._tripped.set()
        return bits

    def _fail(self, error: DeviceError) -> None:
        """Note that a reading failed; the last reading stays known until it is stale."""
        self._relays = None  # it may be restarting, with all relays open
        age_s = self._clock.attended_s() - self._attended_at_s
        if age_s <= self._stale_s:
            log.info("inputs not read, known for %.2f s: %s", age_s, error)
            return
        if self._read_at_s != -math.inf:
            log.warning("inputs unknown: %s", error)
        self._read_at_s = self._attended_at_s = -math.inf
        self._forget()

    def _forget(self) -> None:
        self._relays = None  # it may be restarting, with all relays open
        self._publish(self._believer.forget(self._clock.now_s()))

    def _publish(self, changes: list[Change]) -> None:
        for change in changes:
            for watch in tuple(self._watches):
                watch.put(change)
            if self._on_change is not None:
                try:
                    self._on_change(change)
                except Exception:  # an observer cannot stop the polling
                    log.exception("observer of %s failed", self.name)
