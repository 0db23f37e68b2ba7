"""The output of commands; errors as a sentence and an exit code.

Imported module by module: `failure` loads all rooms, which `--version` must not.
"""
