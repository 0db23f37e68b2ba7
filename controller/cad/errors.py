"""Errors of CAD files; each message names the file and the next step."""


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
    """Coordinates that are not numbers, or that exceed any part and any cell."""


class OpenCadError(CadError):
    """The surface does not enclose a volume: there are holes in it."""


class InsideOutCadError(CadError):
    """Some or all triangles face inwards."""


class SelfIntersectingCadError(CadError):
    """The surface intersects, overlaps or touches itself."""


class ManySolidsCadError(CadError):
    """The file holds more than one separate body."""
