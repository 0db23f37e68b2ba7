"""A run's report: one HTML page that an inspector signs, and the same as JSON for machines."""

from ..pdf import PdfError, pdf_bytes
from ._json import SCHEMA_VERSION, report_json
from .html import render, render_parts

__all__ = [
    "SCHEMA_VERSION",
    "PdfError",
    "pdf_bytes",
    "render",
    "render_parts",
    "report_json",
]
