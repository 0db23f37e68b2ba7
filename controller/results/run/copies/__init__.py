"""Pictures of a run, from its folder or from the store of objects that they were copied to."""

from .objects import ChangedFileError, ObjectsError, ObjectStore, WrongObjectError
from .pictures import RunPictures

__all__ = ["ChangedFileError", "ObjectStore", "ObjectsError", "RunPictures", "WrongObjectError"]
