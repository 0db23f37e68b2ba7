"""Report of the stages of compiling a part, as each begins."""

from collections.abc import Callable

OnStage = Callable[[str], None]  # called with a stage's name, in words for a person, as it begins


def no_stage(stage: str) -> None:
    """Ignore a stage: no caller listens."""
