"""A printed board as PDF, true to scale, with a ruler to prove it by."""

from .sheet import sheet_html, sheet_pdf

__all__ = ["sheet_html", "sheet_pdf"]
