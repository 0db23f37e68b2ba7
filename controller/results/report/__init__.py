"""Report of a run: an HTML page for an inspector to sign, and the same as JSON for machines.

`form3.py` renders the parts in the layout of Form 3 of AS9102.
"""

from ..pdf import PdfError, pdf_bytes
from ._json import SCHEMA_VERSION, report_json
from .form3 import render_form3, render_form3_parts
from .html import render, render_parts

__all__ = [
    "SCHEMA_VERSION",
    "PdfError",
    "pdf_bytes",
    "render",
    "render_form3",
    "render_form3_parts",
    "render_parts",
    "report_json",
]
