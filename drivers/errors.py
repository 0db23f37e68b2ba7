"""Errors of all drivers, sorted by what the caller can do next (not by origin).

A bug of ours is a plain ``ValueError``; ``asyncio.CancelledError`` always passes through.
"""


class DeviceError(Exception):
    """Root of everything a driver raises on purpose."""


class LinkError(DeviceError):
    """No bytes get through: reconnect, re-reference if power was lost, repeat."""


class UnpluggedError(LinkError):
    """The device left while it was open: its node or connection is gone."""


class SilentLineError(LinkError):
    """No byte has come back for so long that the device counts as unplugged.

    It has been sent a stop, in case it is only the way back that is cut.
    """


class ReplyTimeoutError(LinkError):
    """No reply in time: done or not? Read the state back before repeating anything."""


class LaterError(ReplyTimeoutError):
    """The device answered that it is busy; as after silence, a command is done or not."""


class BadReplyError(DeviceError):
    """Bytes that the manual forbids: stop, log them in hex, never guess."""


class WrongDeviceError(DeviceError):
    """A device answers at this address, but not the one that belongs there."""


class NoLibraryError(DeviceError):
    """A library of this computer that the driver needs is missing or too old: install it."""


class RefusedError(DeviceError):
    """Understood, and answered no.

    Attributes
    ----------
    code : the device's own code
    """

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class WatchdogOffError(DeviceError):
    """The device's own watchdog failed to trip: it protects nothing."""


class FaultError(DeviceError):
    """The device reports a fault of its own; ``code`` is the device's number for it."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class PositionLostError(DeviceError):
    """The device restarted: all its positions are void until it is referenced again."""


class MotionStoppedError(DeviceError):
    """A motion was ended by a stop; the stop itself has been sent."""


class StalledError(DeviceError):
    """A motion ended against an unexpected obstacle."""


class ArmStalledError(StalledError):
    """An arm ended short of its target: it may have hit something. It is stopped."""
