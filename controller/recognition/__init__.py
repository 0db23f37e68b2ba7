"""Recognition: pictures of the table -> part, stable pose, place and score, or "none of these".

Arrays in, dataclasses out (references.md P3.0).
"""

from .fitting import FreeTurn
from .identification.hypotheses import Hypothesis
from .identification.recognise import recognise
from .identification.sighting import Alternative, Recognition, Sighting, Trace
from .library import Library, LibraryPart, make_library, pose_on_table

__all__ = [
    "Alternative",
    "FreeTurn",
    "Hypothesis",
    "Library",
    "LibraryPart",
    "Recognition",
    "Sighting",
    "Trace",
    "make_library",
    "pose_on_table",
    "recognise",
]
