"""What commands print, and how what ended one becomes a sentence and an exit code.

Imported module by module: `failure` knows all rooms, and the version must not load them.
"""
