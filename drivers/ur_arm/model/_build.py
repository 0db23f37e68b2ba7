"""The arm from what the cell file says about it.

Sections (§) are those of ur.md.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ...kinds import ArmDescription
from ._model import LIMITS_RAD, Clear, LinkBox, UrModel
from ._sizes import SIZES
from ._timing import UrTiming
from .kinematics import JOINTS, LINKS

__all__ = ["MODELS", "UrShape", "describe"]

MODELS: Final = tuple(SIZES)
MAX_TOOL_MM: Final = 500.0  # a longer gripper is a wrong unit
MAX_ACCELERATION_DEG_S2: Final = 800.0  # §4.1: the controller's own limit on movej is not published
# of the gripper, on the flange: wrist 3 carries it, wrist 2 is farther back than the flange (§1.3)
_CLEAR: Final[dict[str, Clear]] = {"wrist2": "fingers", "wrist3": "nothing"}
_RIDES: Final = ("shoulder", "upper")  # beside and above the base (§1.3)

Six = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class UrShape:
    """What the cell file says under ``arm.shape:``.

    Attributes
    ----------
    model : ``ur3e``, ``ur5e``, ``ur10e`` or ``ur5``
    flange_to_tcp_mm : flange to TCP, along the flange's axis
    park_deg : joints in which the arm waits, out of the cameras' pictures
    jaws_deg : direction in which the jaws move, about the flange's axis from its x axis
    middle_deg : each joint is used within 175 deg of this, elbow and wrist 2 within 180 deg
    speed_deg_s : speed of the leading axis in a move; the default is the controller's own (§4.1)
    acceleration_deg_s2 : its acceleration; the default is the controller's own (§4.1)
    """

    model: str
    flange_to_tcp_mm: float
    park_deg: Six
    jaws_deg: float = 0.0
    middle_deg: Six = (0.0, -90.0, 0.0, -90.0, 0.0, 0.0)
    speed_deg_s: float = 60.0
    acceleration_deg_s2: float = 80.0

    def __post_init__(self) -> None:
        if self.model not in SIZES:
            raise ValueError(f"model: {self.model!r} is none of {', '.join(SIZES)}")
        fastest = max(SIZES[self.model].deg_per_s)
        limits = (
            ("flange_to_tcp_mm", 0.0, MAX_TOOL_MM, "mm"),
            ("jaws_deg", -180.0, 180.0, "deg"),
            ("speed_deg_s", 1.0, fastest, "deg/s"),
            ("acceleration_deg_s2", 1.0, MAX_ACCELERATION_DEG_S2, "deg/s²"),
        )
        for name, low, high, unit in limits:
            value = getattr(self, name)
            if not low <= value <= high:  # not a number, too
                raise ValueError(f"{name}: {low:g} to {high:g} {unit}, not {value:g}")
        if self.middle_deg[4]:
            raise ValueError(f"middle_deg: wrist2: 0, no other than {self.middle_deg[4]:g}")
        for name in ("park_deg", "middle_deg"):
            rows = zip(JOINTS, getattr(self, name), np.degrees(LIMITS_RAD).tolist(), strict=True)
            for joint, value, limit in rows:
                if not abs(value) <= limit:
                    raise ValueError(f"{name}: {joint}: -{limit:g} to {limit:g} deg, not {value:g}")
        for joint, value, limit in zip(
            JOINTS, self.middle_deg, np.degrees(LIMITS_RAD), strict=True
        ):
            if abs(value) > limit - 180.0:
                raise ValueError(
                    f"middle_deg: {joint}: half a turn to either side is not within its range of "
                    f"-{limit:g} to {limit:g} deg: {value:g}"
                )

    def timing(self) -> UrTiming:
        """Return the timing model of its moves."""
        a, b, c, d, e, f = (
            float(np.radians(min(self.speed_deg_s, most))) for most in SIZES[self.model].deg_per_s
        )
        return UrTiming((a, b, c, d, e, f), float(np.radians(self.acceleration_deg_s2)))


def describe(shape: UrShape) -> ArmDescription[UrModel]:
    """Return the arm of that shape, for planning."""
    published = SIZES[shape.model]
    links = tuple(
        LinkBox.of_bounds(
            name,
            published.boxes[name],
            may_touch_base=name not in _RIDES,
            may_touch_table=name != "shoulder",
            keeps_clear_of=_CLEAR.get(name, "gripper"),
        )
        for name in LINKS
    )
    model = UrModel(
        shape.model,
        published.size,
        links,
        shape.timing(),
        shape.flange_to_tcp_mm,
        float(np.radians(shape.jaws_deg)),
        np.radians(shape.middle_deg),
    )
    return ArmDescription(model, np.radians(shape.park_deg))
