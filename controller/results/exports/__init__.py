"""Judged parts as files that a factory reads: QIF 3.0 results, Q-DAS dfq, CSV."""

from ._dfq import dfq_bytes
from ._qif import QIF_NAMESPACE, qif_bytes
from ._table import COLUMNS, csv_cell, csv_text

__all__ = ["COLUMNS", "QIF_NAMESPACE", "csv_cell", "csv_text", "dfq_bytes", "qif_bytes"]
