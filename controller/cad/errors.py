"""What can be wrong with a CAD file; each message says which file and what to do about it."""


class CadError(Exception):
    """The CAD file cannot be used."""


class UnreadableCadError(CadError):
    """The file is missing, of an unknown format, or not what its name says."""


class EmptyCadError(CadError):
    """The file holds no surface."""


class OpenCadError(CadError):
    """The surface does not enclose a volume: holes in it, or triangles facing inwards."""


class ManySolidsCadError(CadError):
    """The file holds more than one separate body."""
