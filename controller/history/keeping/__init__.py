"""Upkeep of the cell's records: backups, verified by hashes, and disk space regained."""

from .backup import Backup, back_up
from .pictures import OldPictures, drop_pictures, old_pictures
from .restoring import Restored, restore

__all__ = [
    "Backup",
    "OldPictures",
    "Restored",
    "back_up",
    "drop_pictures",
    "old_pictures",
    "restore",
]
