"""cell.yaml: the devices' addresses and the cell's places in the world. mm, degrees, seconds."""

from .arm import ArmSection, OtherArmSection, UmiSection
from .cell import Cell
from .devices import EMULATED, DeviceSection, LineSection, Parity
from .optics import MAX_SIZE_PX, AccuracySection, CameraSection, LampSection, LightSection
from .surroundings import ChuteSection, TraySection
from .values import MAX_HEIGHT_MM, MIN_HEIGHT_MM, Box

__all__ = [
    "EMULATED",
    "MAX_HEIGHT_MM",
    "MAX_SIZE_PX",
    "MIN_HEIGHT_MM",
    "AccuracySection",
    "ArmSection",
    "Box",
    "CameraSection",
    "Cell",
    "ChuteSection",
    "DeviceSection",
    "LampSection",
    "LightSection",
    "LineSection",
    "OtherArmSection",
    "Parity",
    "TraySection",
    "UmiSection",
]
