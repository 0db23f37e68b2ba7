"""The evidence page of a commissioned cell: each step with figures, limits, pictures, persons."""

from .page import write_evidence_page

__all__ = ["write_evidence_page"]
