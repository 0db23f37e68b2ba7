"""The files of killed emulators, removed at once: folders, mounts, clocks."""

from emulators.camera_v4l2 import unmount
from emulators.owned import sweep
from emulators.register import register_folder
from emulators.register import sweep as sweep_register


def reap() -> None:
    """Take it away; where nothing is left, do nothing."""
    sweep(unmount)
    sweep_register(register_folder())
