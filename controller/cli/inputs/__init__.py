"""The inputs of commands: folders, pictures, calibrations, CAD files; checked before work.

Imported module by module: a check of a folder needs no library that reads pictures.
"""
