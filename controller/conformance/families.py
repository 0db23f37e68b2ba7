"""The requirements of each kind of device."""

from collections.abc import Mapping
from typing import Final

from . import arm, camera, gripper, io_block, lights
from .requirement import Requirement

FAMILIES: Final[Mapping[str, tuple[Requirement, ...]]] = {
    "arm": arm.REQUIREMENTS,
    "gripper": gripper.REQUIREMENTS,
    "lights": lights.REQUIREMENTS,
    "io": io_block.REQUIREMENTS,
    "camera": camera.REQUIREMENTS,
}
