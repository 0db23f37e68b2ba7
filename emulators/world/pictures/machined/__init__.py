"""Parts as a workshop leaves them: tool marks, dust, oil film, and light from wall to wall; ADR 43.

Painted over a finished picture: it changes light on parts, never the position of an edge.
"""

from .finish import Finish, MachinedPart

__all__ = ["Finish", "MachinedPart"]
