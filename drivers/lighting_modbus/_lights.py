"""The verbs of the lamps: which are lit, at which brightness."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from messages import key, say

from ..modbus_link import ModbusLink, VerbLock
from ._config import CHANNEL_COUNT, LampChannel, LightsConfig
from ._modules import AnalogModule, RelayModule


@dataclass(frozen=True, slots=True)
class LampState:
    """The modules' report on one lamp.

    Attributes
    ----------
    level : 0..1 as `Lights.set` takes it; 0 when the relay is open
    voltage_mv : dimming voltage [mV]
    is_relay_closed : True if the lamp has power
    """

    level: float
    voltage_mv: int
    is_relay_closed: bool

    @property
    def is_off(self) -> bool:
        """Off means relay open *and* 0 mV: either alone may still glow, or light up later."""
        return not self.is_relay_closed and self.voltage_mv == 0


@dataclass(frozen=True, slots=True)
class LightsReading:
    """All lamps as read back; ``at_s`` is the cell instant just before the request [s]."""

    at_s: float
    lamps: Mapping[str, LampState]


class Lights:
    """Lamps over one analog module and one relay module.

    The modules keep their outputs when the controller goes away, so lamps left on stay on:
    leaving ``async with`` switches nothing, `all_off` does.

    Parameters
    ----------
    link : line of both modules; not closed by the lights
    config : lamps and slave ids
    relay_link : line of the relay module when it has one of its own

    Raises
    ------
    ValueError : both modules have the same slave id on the same line
    """

    def __init__(
        self, link: ModbusLink, config: LightsConfig, relay_link: ModbusLink | None = None
    ) -> None:
        if relay_link in (None, link) and config.analog_unit == config.relay_unit:
            raise ValueError(
                f"both modules have slave id {config.analog_unit} on {link.address}: give one of "
                "them another id (register 0x4000), or its own line"
            )
        self.config = config
        self._clock = link.clock
        self._lamps = {lamp.name: lamp for lamp in config.lamps}
        self._analog = AnalogModule(link, config.analog_unit, config.spacing_s)
        self._relays = RelayModule(relay_link or link, config.relay_unit, config.spacing_s)
        self._versions: tuple[str, str] | None = None
        self._verb = VerbLock(link)
        self._acknowledged_at_s = self._clock.now_s()
        self._settle_s = self._slowest_s  # of the last change

    @property
    def _slowest_s(self) -> float:
        own = self.config.settle_s
        return max((own, *(one.settle_s for one in self.config.lamps if one.settle_s is not None)))

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        return

    @property
    def model(self) -> str:
        """The modules' name in messages and the journal: the version of each, once known."""
        if self._versions is None:
            return key("Waveshare analog output and relays")
        analog, relays = self._versions
        return say(
            "Waveshare analog output {analog} and relays {relays}", analog=analog, relays=relays
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all lamps."""
        return tuple(self._lamps)

    async def connect(self) -> LightsReading:
        """Check that both modules are the right ones; switch nothing; return the lamps' state."""
        await self.identify()
        return await self.read_back()

    async def identify(self) -> tuple[str, str]:
        """Return the versions of the analog and of the relay module, such as ``V1.00``.

        Raises
        ------
        WrongDeviceError : another device answers at one of the two slave ids
        """
        self._versions = await self._analog.identify(), await self._relays.identify()
        return self._versions

    async def set(
        self, levels: Mapping[str, float], *, settle: bool = False, force: bool = False
    ) -> float:
        """Set the brightness of lamps; lamps not named stay unchanged.

        Parameters
        ----------
        levels : lamp name to 0 (relay open and 0 mV) .. 1 (its full scale)
        settle : also wait until the light is steady
        force : write even what is known to be so already

        Returns
        -------
        The cell instant from which on the light is so [s]: the last acknowledge, or with ``settle``
        the end of the wait. A picture of this light is exposed wholly after it. When nothing had
        to be sent, it lies in the past.

        Raises
        ------
        ValueError : no such lamp or level; nothing has been sent
        LinkError : lamps may be half-way; the next `set` first reads both modules
        """
        unknown = [name for name in levels if name not in self._lamps]
        if unknown:
            raise ValueError(f"no lamp {unknown[0]!r}; there are {', '.join(self._lamps)}")
        wanted = {self._lamps[name]: level for name, level in levels.items()}
        voltages_mv = {lamp: lamp.level_to_mv(level) for lamp, level in wanted.items()}
        async with self._verb.held("set"):
            outputs_mv = list(await self._analog.known())
            closed = list(await self._relays.known())
            was_closed = tuple(closed)
            for lamp, voltage_mv in voltages_mv.items():
                outputs_mv[lamp.analog_channel - 1] = voltage_mv
                closed[lamp.relay_channel - 1] = wanted[lamp] > 0
            self._note_settling(await self._analog.known(), outputs_mv, was_closed, closed)
            return await self._apply(outputs_mv, closed, was_closed, settle=settle, force=force)

    async def all_off(self, *, settle: bool = False) -> float:
        """Open every relay, set every output to 0 mV, lamp or not; return what `set` returns.

        Always writes, whatever is known, and tries either module even if the other is silent.
        Returns what `set` returns.
        """
        async with self._verb.held("all_off"):
            try:
                await self._analog.write([0] * CHANNEL_COUNT, force=True)
            finally:
                await self._relays.write([False] * CHANNEL_COUNT, force=True)
            self._settle_s = self._slowest_s
            self._acknowledged_at_s = self._clock.now_s()
            return await self._since(settle=settle)

    async def read_back(self) -> LightsReading:
        """Return the state of the lamps, as both modules read it back."""
        async with self._verb.held("read_back"):
            at_s = self._clock.now_s()
            outputs_mv = await self._analog.read()
            closed = await self._relays.read()
        return LightsReading(
            at_s, {lamp.name: _state(lamp, outputs_mv, closed) for lamp in self.config.lamps}
        )

    def _note_settling(
        self,
        before_mv: Sequence[int],
        outputs_mv: Sequence[int],
        was_closed: Sequence[bool],
        closed: Sequence[bool],
    ) -> None:
        """Take the settling time of the slowest changing lamp; without changes, keep the last."""
        own = self.config.settle_s
        changed = [
            own if lamp.settle_s is None else lamp.settle_s
            for lamp in self.config.lamps
            if before_mv[lamp.analog_channel - 1] != outputs_mv[lamp.analog_channel - 1]
            or was_closed[lamp.relay_channel - 1] != closed[lamp.relay_channel - 1]
        ]
        if changed:
            self._settle_s = max(changed)

    async def _apply(
        self,
        outputs_mv: list[int],
        closed: list[bool],
        was_closed: tuple[bool, ...],
        *,
        settle: bool,
        force: bool,
    ) -> float:
        """Send at most one request to either module.

        Relays close before voltage rises, since LED drivers draw their inrush at full output
        otherwise. When lamps only go off, the voltage falls first, and the contacts open without
        load.
        """
        closes_any = any(
            now and not before for now, before in zip(closed, was_closed, strict=False)
        )
        if closes_any:
            if await self._relays.write(closed, force=force):
                self._acknowledged_at_s = self._clock.now_s()
                await self._clock.sleep(self.config.relay_settle_s)
            if await self._analog.write(outputs_mv, force=force):
                self._acknowledged_at_s = self._clock.now_s()
        else:
            if await self._analog.write(outputs_mv, force=force):
                self._acknowledged_at_s = self._clock.now_s()
            if await self._relays.write(closed, force=force):
                self._acknowledged_at_s = self._clock.now_s()
        return await self._since(settle=settle)

    async def _since(self, *, settle: bool) -> float:
        if not settle:
            return self._acknowledged_at_s
        steady_at_s = self._acknowledged_at_s + self._settle_s
        await self._clock.sleep(steady_at_s - self._clock.now_s())
        return steady_at_s


def _state(lamp: LampChannel, outputs_mv: tuple[int, ...], closed: tuple[bool, ...]) -> LampState:
    voltage_mv = outputs_mv[lamp.analog_channel - 1]
    is_closed = closed[lamp.relay_channel - 1]
    return LampState(lamp.mv_to_level(voltage_mv) if is_closed else 0.0, voltage_mv, is_closed)
