"""What commands print; how an error becomes a sentence and an exit code.

Imported module by module: `failure` loads all rooms, which `--version` must not.
"""
