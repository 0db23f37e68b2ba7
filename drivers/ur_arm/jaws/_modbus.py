"""A Robotiq 2F on a Modbus line of its own, by the driver of the fixed gripper."""

from drivers.clock import CellClock
from drivers.gripper_modbus import Gripper, GripperConfig, GripperStatus
from drivers.modbus_link import ModbusLink, TcpAddress
from messages import key, say

from ._reading import JawState

__all__ = ["ModbusJaws"]


class ModbusJaws:
    """The gripper on the flange, as a gripper on Modbus.

    Parameters
    ----------
    address : its gateway
    clock : the cell's clock
    config : its slave id, scales and speed
    """

    def __init__(self, address: TcpAddress, clock: CellClock, config: GripperConfig) -> None:
        self._address, self._clock, self._config = address, clock, config
        self._link = ModbusLink(address, clock)
        self._gripper = Gripper(self._link, config, key("arm gripper"))

    @property
    def model(self) -> str:
        """Name in messages and the journal."""
        return say("{model} by Modbus", model=self._gripper.model)

    @property
    def max_opening_mm(self) -> float:
        """Largest opening [mm]."""
        return self._gripper.max_opening_mm

    @property
    def force_range_n(self) -> tuple[float, float]:
        """Least and largest force of a grasp [N]."""
        return self._config.min_force_n, self._config.max_force_n

    async def connect(self) -> JawState:
        """Open the line; return the first reading."""
        await self.aclose()
        self._link = ModbusLink(self._address, self._clock)
        self._gripper = Gripper(self._link, self._config, key("arm gripper"))
        return _state(await self._gripper.connect())

    async def read(self) -> JawState:
        """Return a fresh reading."""
        return _state(await self._gripper.status())

    async def activate(self) -> None:
        """Make them ready to move, which opens and closes them."""
        await self._gripper.activate()

    async def move_to(self, opening_mm: float) -> JawState:
        """Move empty jaws; return the reading where they have come to rest."""
        return _state(await self._gripper.open_to(opening_mm))

    async def close(self, force_n: float, speed_share: float) -> JawState:
        """Close with a force until they rest; return the reading there.

        Parameters
        ----------
        force_n : force [N]
        speed_share : share of the usual speed
        """
        config = self._gripper.config
        speed_mm_s = max(config.default_speed_mm_s * speed_share, config.min_speed_mm_s)
        await self._gripper.close_on(0.0, speed_mm_s, force_n)
        return await self.read()

    async def stop(self) -> None:
        """Stop jaws that are under way; those that hold something go on holding."""
        if (await self._gripper.status()).is_moving:
            await self._gripper.stop()

    async def aclose(self) -> None:
        """Release the line; opens no jaw."""
        await self._gripper.aclose()
        await self._link.aclose()


def _state(status: GripperStatus) -> JawState:
    is_shut = status.opening_mm <= 0.0
    return JawState(
        opening_mm=max(0.0, status.opening_mm),
        is_activated=status.is_activated,
        is_moving=status.is_moving,
        is_pressing=status.is_activated and (status.has_contact or is_shut),
    )
