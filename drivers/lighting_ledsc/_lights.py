"""The verbs of the lamps: which are lit, at which brightness."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

from messages import key, say

from ..errors import DeviceError, RefusedError, WrongDeviceError
from ..modbus_link import FunctionCode, ModbusLink, Request, VerbLock, always
from ._registers import (
    ADDRESS_REGISTER,
    CHANNEL_COUNT,
    FIRST_REGISTER,
    MAX_CYCLE,
    STATE_COUNT,
    State,
    decode_state,
    encode_values,
)

_SPACING_S: Final = 0.004  # 3.5 characters at 9600 baud
_CHECK: Final = key("its supply, its slave id, RS-485 A and B, baud rate and parity")


@dataclass(frozen=True, slots=True)
class PwmLamp:
    """One lamp.

    Attributes
    ----------
    name : name used in recipes
    controller, channel : its controller and channel, both from 0
    drive : share of full light that level 1 means
    settle_s : from the acknowledge until its light is steady [cell s]
    """

    name: str
    controller: int
    channel: int
    drive: float
    settle_s: float


class _Controller:
    """One controller of four channels; its settings are forgotten when a write may have failed.

    Parameters
    ----------
    link : the line it is on
    unit : its slave id
    """

    def __init__(self, link: ModbusLink, unit: int) -> None:
        probes = (
            Request(FunctionCode.READ_HOLDING_REGISTERS, ADDRESS_REGISTER),
            Request(FunctionCode.READ_HOLDING_REGISTERS, FIRST_REGISTER, STATE_COUNT),
        )
        self.unit = link.unit(
            unit, key("lamp controller"), spacing_s=_SPACING_S, probes=probes, check=_CHECK
        )
        self._state: State | None = None

    async def identify(self) -> None:
        """Check that it is one, by its own slave id and its settings.

        Raises
        ------
        WrongDeviceError : it is another device, or has a PWM cycle that channel A cannot do
        """
        try:
            (address,) = await self.unit.read_holding_registers(ADDRESS_REGISTER, 1)
            await self.read()
        except RefusedError as error:
            raise WrongDeviceError(
                say(
                    "{unit}: expected an LedSC controller, found {error}; check slave "
                    "id and port, or which device is wired there",
                    unit=self.unit,
                    error=error,
                )
            ) from error
        if address != self.unit.unit:
            raise WrongDeviceError(
                say(
                    "{unit}: expected an LedSC controller, whose register "
                    "{address_register} is its slave id; found {address} there",
                    unit=self.unit,
                    address_register=ADDRESS_REGISTER,
                    address=address,
                )
            )

    async def read(self) -> State:
        """Return the controller's settings.

        Raises
        ------
        WrongDeviceError : its PWM cycle is not of use
        """
        self._state = None
        registers = await self.unit.read_holding_registers(FIRST_REGISTER, STATE_COUNT)
        state = decode_state(registers)
        if not 1 <= state.cycle <= MAX_CYCLE:
            raise WrongDeviceError(
                say(
                    "{unit}: its PWM cycle is {cycle}; channel A has at most "
                    "{max_cycle} steps. Write {max_cycle} to register 6",
                    unit=self.unit,
                    cycle=state.cycle,
                    max_cycle=MAX_CYCLE,
                )
            )
        self._state = state
        return state

    async def known(self) -> State:
        """Return the controller's settings; read them only if they are not known."""
        return await self.read() if self._state is None else self._state

    async def write(self, state: State, values: Sequence[int], *, force: bool) -> bool:
        """Set the channels to the wanted levels in one FC16; return whether anything was sent.

        Parameters
        ----------
        state : as it is known
        values : values of all four channels
        force : write even what is known to be so already
        """
        wanted = replace(state, values=tuple(values), transition_ms=0, is_live=True)
        if wanted == state and not force:
            return False
        self._state = None
        await self.unit.write_registers(FIRST_REGISTER, encode_values(values), again=always)
        self._state = wanted
        return True

    async def dark(self) -> None:
        """Write 0 to all channels, in any state."""
        state, self._state = self._state, None
        await self.unit.write_registers(
            FIRST_REGISTER, encode_values([0] * CHANNEL_COUNT), again=always
        )
        if state is not None:
            values = (0,) * CHANNEL_COUNT
            self._state = replace(state, values=values, transition_ms=0, is_live=True)


class LedscLights:
    """Lamps over LedSC controllers on one line.

    Leaving ``async with`` switches nothing, `all_off` does.

    Parameters
    ----------
    link : line of all controllers; not closed by the lights
    lamps : all lamps
    units : slave ids of the controllers

    Raises
    ------
    ValueError : a lamp is on a controller that is not there
    """

    def __init__(self, link: ModbusLink, lamps: Sequence[PwmLamp], units: Sequence[int]) -> None:
        for lamp in lamps:
            if not lamp.controller < len(units):
                raise ValueError(
                    f"lamp {lamp.name!r} is on `analog` "
                    f"{lamp.controller * CHANNEL_COUNT + lamp.channel}, and {len(units)} LedSC "
                    f"controllers have 0 to {len(units) * CHANNEL_COUNT - 1}; add its slave id to "
                    "`units`"
                )
        self._clock = link.clock
        self._lamps = {lamp.name: lamp for lamp in lamps}
        self._controllers = tuple(_Controller(link, unit) for unit in units)
        self._verb = VerbLock(link)
        self._acknowledged_at_s = self._clock.now_s()
        self._settle_s = self._slowest_s

    @property
    def _slowest_s(self) -> float:
        return max((lamp.settle_s for lamp in self._lamps.values()), default=0.0)

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        return

    @property
    def model(self) -> str:
        """The device's name in messages and the journal."""
        return say(
            "{controllers_count} LedSC lamp controllers", controllers_count=len(self._controllers)
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all lamps."""
        return tuple(self._lamps)

    async def connect(self) -> tuple[State, ...]:
        """Check that every controller is one; switch nothing; return their settings.

        Raises
        ------
        WrongDeviceError : another device answers, or one that is set up otherwise
        """
        async with self._verb.held("connect"):
            for controller in self._controllers:
                await controller.identify()
            return tuple([await controller.known() for controller in self._controllers])

    async def set(
        self, levels: Mapping[str, float], *, settle: bool = False, force: bool = False
    ) -> float:
        """Set the brightness of lamps; lamps not named stay unchanged.

        Parameters
        ----------
        levels : lamp name to 0 (dark) .. 1 (its drive)
        settle : also wait until the light is steady
        force : write even what is known to be so already

        Returns
        -------
        The cell instant from which on the light is so [s], as `LampUnit.set` has it.

        Raises
        ------
        ValueError : no such lamp or level; nothing has been sent
        LinkError : lamps may be half-way; the next `set` first reads the controller
        """
        for name, level in levels.items():
            if name not in self._lamps:
                raise ValueError(f"no lamp {name!r}; there are {', '.join(self._lamps)}")
            if not 0 <= level <= 1:
                raise ValueError(f"lamp {name!r}: levels are 0..1, not {level:g}")
        async with self._verb.held("set"):
            changed: list[float] = []
            for number, controller in enumerate(self._controllers):
                state = await controller.known()
                values = list(state.values)
                for lamp in (self._lamps[name] for name in levels):
                    if lamp.controller != number:
                        continue
                    value = round(levels[lamp.name] * lamp.drive * state.cycle)
                    if value != values[lamp.channel] or not state.is_ready:
                        changed.append(lamp.settle_s)
                    values[lamp.channel] = value
                if await controller.write(state, values, force=force):
                    self._acknowledged_at_s = self._clock.now_s()
            if changed:
                self._settle_s = max(changed)
            return await self._since(settle=settle)

    async def all_off(self) -> float:
        """Write 0 to every channel, lamp or not; return what `set` returns.

        Always writes, whatever is known, and tries every controller even if another is silent.

        Raises
        ------
        DeviceError : a controller did not confirm; the first one
        """
        async with self._verb.held("all_off"):
            failed: list[DeviceError] = []
            for controller in self._controllers:
                try:
                    await controller.dark()
                except DeviceError as error:
                    failed.append(error)
            if failed:
                raise failed[0]
            self._settle_s = self._slowest_s
            self._acknowledged_at_s = self._clock.now_s()
            return self._acknowledged_at_s

    async def _since(self, *, settle: bool) -> float:
        if not settle:
            return self._acknowledged_at_s
        steady_at_s = self._acknowledged_at_s + self._settle_s
        await self._clock.sleep(steady_at_s - self._clock.now_s())
        return steady_at_s
