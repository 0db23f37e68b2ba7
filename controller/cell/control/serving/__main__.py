"""Prints what docs/control-api.json stores: ``python -m controller.cell.control.serving``."""

import sys

from .openapi import document_bytes

sys.stdout.write(document_bytes().decode())
