"""Keeping what the cell wrote: backups, verified by hashes, and room made for more."""

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
