"""Upkeep of the cell's records: backups, verified by hashes, and disk space regained."""

from .backup import Backup, back_up
from .copies import Copied, Dropped, copy_pictures, drop_copied, keep_pictures, rules_now
from .pictures import OldPictures, drop_pictures, old_pictures
from .restoring import Restored, restore

__all__ = [
    "Backup",
    "Copied",
    "Dropped",
    "OldPictures",
    "Restored",
    "back_up",
    "copy_pictures",
    "drop_copied",
    "drop_pictures",
    "keep_pictures",
    "old_pictures",
    "restore",
    "rules_now",
]
