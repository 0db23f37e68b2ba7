"""A batch's experience of its sources: a grasp or view that fails too often is avoided.

A source is anything that can fail by itself: ``grasp A12``, ``view A12-V3``. Each has a window of
its last uses. Plain counting, no device.
"""

from collections import deque
from dataclasses import dataclass

GRASP = "grasp "
VIEW = "view "


@dataclass(frozen=True, slots=True)
class Demotion:
    """A source that is avoided for the rest of the batch.

    Attributes
    ----------
    source : source to look up
    failure_count, use_count : number of failures among its last uses
    reason : reason of the latest failure
    """

    source: str
    failure_count: int
    use_count: int
    reason: str


class Budgets:
    """The count of each source's failures.

    Parameters
    ----------
    demote_after : a source that failed so often within the window is demoted
    window : uses that are remembered of each source
    """

    def __init__(self, demote_after: int, window: int) -> None:
        self._demote_after = demote_after
        self._window = window
        self._uses: dict[str, deque[bool]] = {}
        self._demoted: dict[str, Demotion] = {}

    @property
    def grasps(self) -> frozenset[str]:
        """Ids of the avoided grasps."""
        return frozenset(s.removeprefix(GRASP) for s in self._demoted if s.startswith(GRASP))

    def is_demoted(self, source: str) -> bool:
        """Return whether a source is avoided."""
        return source in self._demoted

    def succeed(self, source: str) -> None:
        """Count a successful use."""
        self._of(source).append(False)

    def fail(self, source: str, reason: str) -> Demotion | None:
        """Count a failure; return the demotion it causes, None if it causes none."""
        uses = self._of(source)
        uses.append(True)
        if source in self._demoted or sum(uses) < self._demote_after:
            return None
        demotion = Demotion(source, sum(uses), len(uses), reason)
        self._demoted[source] = demotion
        return demotion

    def _of(self, source: str) -> deque[bool]:
        return self._uses.setdefault(source, deque(maxlen=self._window))
