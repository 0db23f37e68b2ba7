"""Parts as a workshop leaves them: tool marks, dust, oil film, and light from wall to wall; ADR 43.

Put over a painted picture: what is here changes light on parts, never where an edge is.
"""

from .finish import Finish, MachinedPart

__all__ = ["Finish", "MachinedPart"]
