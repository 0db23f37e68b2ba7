"""Keeping what the cell wrote: backups of journals, pictures and store, verified by hashes."""

from .backup import Backup, back_up
from .restoring import Restored, restore

__all__ = ["Backup", "Restored", "back_up", "restore"]
