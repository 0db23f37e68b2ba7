"""Where the larger collection of parts and pictures lies, of which `tests/data` has a selection."""

from pathlib import Path

SHARED = Path(__file__).resolve().parents[2] / "shared"
