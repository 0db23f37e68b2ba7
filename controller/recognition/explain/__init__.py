"""Why recognition answered what it did: a picture and the numbers of all stages."""

from ._explain import Explanation, explain
from ._tables import StageTable

__all__ = ["Explanation", "StageTable", "explain"]
