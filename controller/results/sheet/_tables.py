"""Rows of the page's tables of features and tolerances."""

from controller.cad.compiled import CompiledPart


def feature_rows(part: CompiledPart) -> tuple[tuple[str, ...], ...]:
    """Return kind, size and surfaces of each feature."""
    return ()


def tolerance_rows(part: CompiledPart) -> tuple[tuple[str, ...], ...]:
    """Return what, demand and surfaces of each tolerance."""
    return ()
