"""Numbers, ranges, boxes and poses of a cell file. mm, degrees."""

import re
from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from controller.arrays import FloatArray

from ..yaml_models import Section

Number = Annotated[float, Field(ge=-50_000, le=50_000)]  # no cell is 50 m wide
Vec2 = tuple[Number, Number]
Vec3 = tuple[Number, Number, Number]
Length = Annotated[float, Field(ge=10, le=5000)]  # of a link [mm]; given in metres it is below 1
# Between a camera and the table or the station that it looks at [mm]. A value below 20 is likely to
# be in metres.
MIN_HEIGHT_MM, MAX_HEIGHT_MM = 50.0, 20_000.0
IN_MM = "lengths are in millimetres; are these metres?"
MAX_ZERO_DEG, MAX_OFF_MM = 5.0, 20.0  # an arm that is farther off wants mending, not measuring
LISTEN = re.compile(r"(\[[0-9a-fA-F:]+\]|[A-Za-z0-9.-]+):(\d{1,5})")


def _address_and_port(text: str) -> str:
    found = LISTEN.fullmatch(text)
    if found is None or int(found[2]) >= 2**16:
        raise ValueError("must be an address and a port, as in 127.0.0.1:8471 or [::1]:8471")
    return text


def host_and_port(listen: str) -> tuple[str, int]:
    """Return the host, without brackets, and the port of an address to listen at.

    Parameters
    ----------
    listen : as a cell file has it (`Listen`)
    """
    host, _, port = listen.rpartition(":")
    return host.strip("[]"), int(port)


Listen = Annotated[str, Field(max_length=300), AfterValidator(_address_and_port)]


def rising(bounds: tuple[float, ...]) -> tuple[float, ...]:
    """Return (low, high) pairs that are in this order.

    Parameters
    ----------
    bounds : low, high, low, high, ...

    Raises
    ------
    ValueError : one pair is not
    """
    for low, high in zip(bounds[::2], bounds[1::2], strict=True):
        if low >= high:
            raise ValueError(f"bounds must go from low to high, not from {low:g} to {high:g}")
    return bounds


def positive(size: tuple[float, ...]) -> tuple[float, ...]:
    """Return sizes that are all more than 0.

    Parameters
    ----------
    size : lengths

    Raises
    ------
    ValueError : one is not
    """
    if min(size) <= 0:
        raise ValueError(f"sizes must be more than 0, not {min(size):g}")
    return size


def require_all_different(what: str, values: Mapping[str, int]) -> None:
    """Require that no two names have the same number.

    Parameters
    ----------
    what : the numbers are, for the message
    values : by name

    Raises
    ------
    ValueError : two have
    """
    owner: dict[int, str] = {}
    for name, value in values.items():
        if value in owner:
            raise ValueError(f"{what} {value} is given to both {owner[value]} and {name}")
        owner[value] = name


Range = Annotated[Vec2, AfterValidator(rising)]
Size = Annotated[Vec2, AfterValidator(positive)]
Box = Annotated[tuple[float, float, float, float, float, float], AfterValidator(rising)]


class Pose(Section):
    """A frame in the world: its origin and two of its axes.

    Attributes
    ----------
    position : position of the origin
    x_axis, y_axis : directions, of length 1 and at right angles
    """

    position: Vec3
    x_axis: Vec3 = (1, 0, 0)
    y_axis: Vec3 = (0, 1, 0)

    @model_validator(mode="after")
    def _axes_are_square(self) -> "Pose":
        x, y = np.array(self.x_axis), np.array(self.y_axis)
        if abs(x @ y) > 1e-6 or abs(x @ x - 1) > 1e-6 or abs(y @ y - 1) > 1e-6:
            raise ValueError("x_axis and y_axis must be of length 1 and at right angles")
        return self

    def build(self) -> FloatArray:
        """Return the pose (4, 4) [mm]."""
        T = np.eye(4)
        x, y = np.array(self.x_axis, dtype=float), np.array(self.y_axis, dtype=float)
        T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = x, y, np.cross(x, y), self.position
        return T
