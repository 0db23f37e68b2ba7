"""The inputs of commands: folders, pictures, calibrations, CAD files; checked before work.

Imported module by module: who checks a folder needs no library that reads pictures.
"""
