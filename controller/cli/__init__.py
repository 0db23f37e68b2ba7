"""The command line: a room per topic, with its commands and what they do."""

from .app import main

__all__ = ["main"]
