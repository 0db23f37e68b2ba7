"""Errors of CAD files; each message names the file and what to do about it."""


class CadError(Exception):
    """The CAD file cannot be used."""


class UnreadableCadError(CadError):
    """The file is missing, of an unknown format, or does not match its name."""


class CsgCadError(CadError):
    """A CSG text describes something that cannot be built; the message names line and key."""


class EmptyCadError(CadError):
    """The file holds no surface."""


class LargeCadError(CadError):
    """The file exceeds a limit on size or count."""


class UnitCadError(CadError):
    """The size makes sense only in another unit, which must be declared."""


class CoordinatesCadError(CadError):
    """Coordinates that are not numbers, or beyond any part and any cell."""


class OpenCadError(CadError):
    """The surface does not enclose a volume: there are holes in it."""


class InsideOutCadError(CadError):
    """Triangles face inwards, all of them or some."""


class SelfIntersectingCadError(CadError):
    """The surface runs through itself, lies on itself or touches itself."""


class ManySolidsCadError(CadError):
    """The file holds more than one separate body."""
