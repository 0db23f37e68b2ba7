"""STEP files, read by a kernel in child processes with limits."""
