"""The settings of one arm, and its address."""

import re
from dataclasses import dataclass
from typing import Final, Literal

__all__ = ["ControllerAddress", "UrSettings"]

RTDE_PORT: Final = 30004
DASHBOARD_PORT: Final = 29999
SCRIPT_PORT: Final = 30001  # of all ports that take lines, the one with messages (ur.md 4.3)
GRIPPER_PORT: Final = 63352
_ADDRESS: Final = re.compile(r"(?P<host>[\w.-]+)(?::(?P<port>\d{1,5}))?")
MAX_PORT: Final = 65535


@dataclass(frozen=True, slots=True)
class ControllerAddress:
    """The controller, and its port of RTDE."""

    host: str
    rtde_port: int = RTDE_PORT

    @classmethod
    def of(cls, text: str) -> "ControllerAddress":
        """Return the address that the cell file gives: ``host`` or ``host:port`` of RTDE.

        Raises
        ------
        ValueError : it is neither
        """
        match = _ADDRESS.fullmatch(text)
        port = RTDE_PORT if match is None or match["port"] is None else int(match["port"])
        if match is None or not 0 < port <= MAX_PORT:
            raise ValueError(f"address: host or host:port of the controller, not {text!r}")
        return cls(match["host"], port)


@dataclass(frozen=True, slots=True)
class UrSettings:
    """The settings of one arm and the gripper on it.

    Attributes
    ----------
    payload_kg : mass on the flange, without a part: the gripper with its coupling. The default is a
        Robotiq 2F-85
    centre_of_mass_mm : where that mass is centred, in the flange's frame
    gripper : ``urcap``: by the arm's own port; ``modbus``: on a line of its own
    gripper_address : ``host:port`` of a Modbus gateway, for ``modbus``
    gripper_unit : its slave id there
    jaw_open_mm : opening of the jaws fully open
    jaw_open_counts, jaw_closed_counts : positions there, and with the fingertips touching
    jaw_zero_mm : true opening where the jaws read 0, as measured
    jaw_speed_mm_s : speed of the jaws
    rtde_hz : rate of the arm's states; an e-Series sends 500 at the most, a CB3 125
    stop_deg_s2 : deceleration of the leading axis in a stop; the controller limits it further
    ramp_deg_s2 : the same in a slow stop
    host : where its other ports are, if not where RTDE is, as behind a relay
    dashboard_port, script_port, gripper_port : its other ports, if not the usual ones
    """

    payload_kg: float = 0.925
    centre_of_mass_mm: tuple[float, float, float] = (0.0, 0.0, 58.0)
    gripper: Literal["urcap", "modbus"] = "urcap"
    gripper_address: str = ""
    gripper_unit: int = 9
    jaw_open_mm: float = 85.0
    jaw_open_counts: int = 3
    jaw_closed_counts: int = 230
    jaw_zero_mm: float = 0.0
    jaw_speed_mm_s: float = 80.0
    rtde_hz: float = 125.0
    stop_deg_s2: float = 1000.0
    ramp_deg_s2: float = 115.0
    host: str = ""
    dashboard_port: int = DASHBOARD_PORT
    script_port: int = SCRIPT_PORT
    gripper_port: int = GRIPPER_PORT

    def __post_init__(self) -> None:
        limits = (
            ("payload_kg", 0.0, 20.0),
            ("gripper_unit", 1, 247),
            ("jaw_open_mm", 1.0, 200.0),
            ("jaw_open_counts", 0, 254),
            ("jaw_closed_counts", self.jaw_open_counts + 1, 255),
            ("jaw_zero_mm", -5.0, 5.0),
            ("jaw_speed_mm_s", 20.0, 150.0),
            ("rtde_hz", 20.0, 500.0),
            ("stop_deg_s2", 100.0, 4000.0),
            ("ramp_deg_s2", 20.0, self.stop_deg_s2),
            ("dashboard_port", 1, MAX_PORT),
            ("script_port", 1, MAX_PORT),
            ("gripper_port", 1, MAX_PORT),
        )
        for name, low, high in limits:
            value = getattr(self, name)
            if not low <= value <= high:  # not a number, too
                raise ValueError(f"{name}: {low:g} to {high:g}, not {value:g}")
        if not all(abs(mm) <= 500.0 for mm in self.centre_of_mass_mm):
            raise ValueError(
                f"centre_of_mass_mm: within 500 mm of the flange, not {self.centre_of_mass_mm}"
            )
        if (self.gripper == "modbus") != bool(self.gripper_address):
            raise ValueError("gripper_address: for `gripper: modbus`, and only for that")
        if self.gripper_address and ":" not in self.gripper_address:
            raise ValueError(f"gripper_address: host:port, not {self.gripper_address!r}")
