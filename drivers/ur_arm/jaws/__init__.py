"""The gripper on the arm: a Robotiq 2F by the arm's own port, or by Modbus.

Sections (§) are those of ur.md.
"""

from ._modbus import ModbusJaws
from ._reading import Jaws, JawState
from ._urcap import UrcapJaws
from ._zeroed import ZeroedJaws

__all__ = ["JawState", "Jaws", "ModbusJaws", "UrcapJaws", "ZeroedJaws"]
