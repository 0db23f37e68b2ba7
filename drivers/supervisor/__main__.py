"""Starts the supervisor's process: ``python -m drivers.supervisor``."""

from .process import main

if __name__ == "__main__":
    main()
