"""Emulated grippers on Modbus: the jaws' physics and a Robotiq 2F-85's register map."""

from ._jaws import JawModel
from ._registers import Fault, JawScale
from ._robotiq import RobotiqConfig, RobotiqDevice

__all__ = ["Fault", "JawModel", "JawScale", "RobotiqConfig", "RobotiqDevice"]
