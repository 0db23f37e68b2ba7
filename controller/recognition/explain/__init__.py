"""Explanation of a recognition: a picture, and the figures of all stages."""

from ._explain import Explanation, explain
from ._tables import StageTable

__all__ = ["Explanation", "StageTable", "explain"]
