"""Errors of pictures in files."""

from drivers.errors import WrongDeviceError


class NoPictureError(WrongDeviceError):
    """A file is no picture, or not one that this camera could have taken."""
