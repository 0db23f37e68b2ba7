"""A run's report: one HTML page that an inspector signs, and the same as JSON for machines."""

from ._json import SCHEMA_VERSION, report_json
from .html import render_parts, write_html

__all__ = [
    "SCHEMA_VERSION",
    "render_parts",
    "report_json",
    "write_html",
]
