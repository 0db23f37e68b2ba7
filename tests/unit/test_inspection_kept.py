"""Stages are computed once for their arguments."""

from __future__ import annotations

from dataclasses import dataclass, field

from controller.inspection.kept import Kept, stage


@dataclass(eq=False)
class Log:
    """Numbers that were worked on; as a key, it is itself, whatever it lists."""

    numbers: list[int] = field(default_factory=list)


@stage
def doubled(kept: Kept, number: int, log: Log) -> int:
    log.numbers.append(number)
    return 2 * number


def test_a_stage_is_computed_once_for_its_arguments() -> None:
    kept, log = Kept(), Log()
    assert [doubled(kept, one, log) for one in (1, 2, 1)] == [2, 4, 2]
    assert log.numbers == [1, 2]


def test_another_cache_knows_nothing_of_it() -> None:
    log = Log()
    assert [doubled(Kept(), 1, log) for _ in range(2)] == [2, 2]
    assert log.numbers == [1, 1]


def test_what_was_dropped_is_computed_again_and_is_a_piece_of_work_each_time() -> None:
    kept, log = Kept(), Log()
    doubled(kept, 1, log)
    kept.forget(doubled, 1, log)
    assert kept.count == 1
    doubled(kept, 1, log)
    assert kept.count == 2
    assert log.numbers == [1, 1]
