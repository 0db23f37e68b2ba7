"""Emulated grippers on Modbus: the jaws' physics and a Robotiq 2F-85's register map."""

from ._jaws import MAX_FORCE_N, JawModel
from ._registers import Fault, JawScale
from ._robotiq import RobotiqConfig, RobotiqDevice

__all__ = ["MAX_FORCE_N", "Fault", "JawModel", "JawScale", "RobotiqConfig", "RobotiqDevice"]
