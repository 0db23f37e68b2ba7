"""Hypotheses for the part in the arm gripper, and the light that decides between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid

Light = Literal["backlight", "front"]
LIGHTS: tuple[Light, ...] = ("backlight", "front")


@dataclass(frozen=True, slots=True, eq=False)
class HeldHypothesis:
    """One hypothesis for the part in the arm gripper, and the part's pose in it.

    Attributes
    ----------
    name : for people
    T_tcp_part : (4, 4) pose of its CAD frame in the TCP frame
    """

    name: str
    solid: Solid
    T_tcp_part: FloatArray

    @classmethod
    def taken(
        cls, name: str, solid: Solid, T_world_part: FloatArray, T_world_tcp: FloatArray
    ) -> HeldHypothesis:
        """Return the hypothesis as a gripper takes it from where it is.

        Parameters
        ----------
        name : for people
        solid : the part it may be
        T_world_part : (4, 4) pose of the part then [mm]
        T_world_tcp : (4, 4) pose of the gripper's TCP [mm]
        """
        return cls(name, solid, np.linalg.inv(T_world_tcp) @ T_world_part)
