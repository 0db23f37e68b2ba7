"""Worker processes of `benchmarks`: a case that hangs, dies or raises costs itself alone."""

import math
import os
import time
from collections.abc import Callable

from benchmarks.case_workers import Failed, Workers

BUDGET_CPU_S = 3.0  # a process starts within


def squared(number: int) -> int:
    return number * number


def spins_at_two(number: int) -> int:
    while number == 2:
        pass
    return number


def dies_at_two(number: int) -> int:
    if number == 2:
        os._exit(7)
    return number


def raises_at_two(number: int) -> int:
    if number == 2:
        raise ValueError("two is too many")
    return number


def what_became(run: Callable[[int], int], until_s: float = math.inf) -> dict[int, object]:
    workers = Workers(run, 2, BUDGET_CPU_S)
    return {
        number: (answer.outcome, answer.message) if isinstance(answer, Failed) else answer
        for number, answer in workers.results((1, 2, 3), until_s)
    }


def test_every_case_has_its_result() -> None:
    assert what_became(squared) == {1: 1, 2: 4, 3: 9}


def test_no_case_is_begun_once_the_time_is_over() -> None:
    assert what_became(squared, time.monotonic()) == {}


def test_a_case_that_dies_takes_no_other_one_with_it() -> None:
    assert what_became(dies_at_two) == {
        1: 1, 2: ("crashed", "its process ended with code 7"), 3: 3
    }  # fmt: skip


def test_a_case_that_raises_says_what() -> None:
    assert what_became(raises_at_two) == {
        1: 1, 2: ("broke off", "ValueError: two is too many"), 3: 3
    }  # fmt: skip


def test_a_case_that_goes_on_for_ever_is_given_up() -> None:
    became = what_became(spins_at_two)
    assert str(became.pop(2)).startswith("('hang', 'not done after")
    assert became == {1: 1, 3: 3}
