"""Prints the content of docs/control-api.json: ``python -m controller.cell.control.serving``."""

import sys

from .openapi import document_bytes

sys.stdout.write(document_bytes().decode())
