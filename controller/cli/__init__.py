"""The command line, one thin module per command."""

from .app import main

__all__ = ["main"]
