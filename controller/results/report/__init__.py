"""A run's report: one HTML page that an inspector signs, and the same as JSON for machines."""

from ._json import SCHEMA_VERSION, report_json
from .html import write_html

__all__ = [
    "SCHEMA_VERSION",
    "report_json",
    "write_html",
]
