"""Codes in pictures, and the numbers in what they say."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.printed_codes import Kind, Printed, markings, printed
from controller.config.serial_code import SerialCodeSection
from controller.imaging.codes import (
    MIN_MODULE_PX,
    fields_of_gs1,
    fields_of_iso15434,
    printable,
    read_codes,
)

KINDS: tuple[Kind, ...] = ("data_matrix", "qr")
SEED = 77001  # figures in docs/measurements/cell.md are of others


def pictures(kind: Kind, count: int, module_px: float, *, dots: bool) -> list[Printed]:
    rng = np.random.default_rng(SEED)
    return [printed(rng, one) for one in markings(rng, count, module_px, kind, dots=dots)]


@pytest.mark.parametrize("dots", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_marked_parts_are_read_from_any_side_in_dim_light(kind: Kind, dots: bool) -> None:
    seen = pictures(kind, 12, 1.4 * MIN_MODULE_PX, dots=dots)
    read = [[code.text for code in read_codes(one.image, KINDS)] for one in seen]
    assert all(texts in ([], [one.marking.text]) for texts, one in zip(read, seen, strict=True))
    assert sum(map(bool, read)) >= 10


def test_corners_are_those_of_the_symbol() -> None:
    (one,) = pictures("data_matrix", 1, 6.0, dots=False)
    (code,) = read_codes(one.image, KINDS)
    apart = np.linalg.norm(code.corners_px[:, None] - one.corners_px[None], axis=2)
    # within half a module of the four corners, each of them once
    assert (apart.min(axis=1) < 3.0).all()
    assert sorted(apart.argmin(axis=1)) == [0, 1, 2, 3]


def test_two_codes_in_a_picture_are_both_read() -> None:
    one, other = pictures("qr", 2, 5.0, dots=False)
    both = np.hstack((one.image, other.image))
    assert {code.text for code in read_codes(both, KINDS)} == {
        one.marking.text,
        other.marking.text,
    }


def test_nothing_is_read_where_no_code_is() -> None:
    rng = np.random.default_rng(SEED)
    for _ in range(4):
        noise = rng.integers(0, 255, (160, 160), dtype=np.uint8)
        assert read_codes(noise, KINDS) == ()
    (one,) = pictures("qr", 1, 5.0, dots=False)
    assert read_codes(one.image, ("data_matrix",)) == ()
    half = one.image.copy()
    half[:, half.shape[1] // 2 :] = 60
    assert read_codes(half, KINDS) == ()


# --- what a code says ---------------------------------------------------------------------------


def test_fields_of_both_standards_are_found_by_their_identifier() -> None:
    assert fields_of_gs1("(01)04012345678901(21)A-7(10)L5") == {
        "01": "04012345678901", "21": "A-7", "10": "L5",
    }  # fmt: skip
    raw = "[)>\x1e06\x1d1P0815\x1dSA-7\x1e\x04"
    assert fields_of_iso15434(raw) == {"1P": "0815", "S": "A-7"}
    assert fields_of_iso15434("SA-7") == {}
    assert printable(raw) == "[)><RS>06<GS>1P0815<GS>SA-7<RS><EOT>"


@given(st.text(max_size=60))
def test_whatever_a_code_says_can_be_printed(text: str) -> None:
    assert printable(text).isprintable()
    fields_of_gs1(text), fields_of_iso15434(text)


def asked(**keys: Any) -> SerialCodeSection:
    return SerialCodeSection(code="qr", **keys)


@pytest.mark.parametrize(
    ("form", "good", "bad"),
    [
        ("SN-####", "SN-0042", "SN-42"),
        ("@@*", "AB7", "A77"),
        ("A.#", "A.1", "AB1"),  # signs that patterns use elsewhere are themselves
        ("*-#", "L5/7-1", "L5/7-A"),
        ("", "anything", None),
    ],
)
def test_a_number_has_the_form_that_the_recipe_asks_for(
    form: str, good: str, bad: str | None
) -> None:
    assert asked(form=form).why_not(good) == ""
    if bad is not None:
        assert f"the form {form}" in asked(form=form).why_not(bad)


def test_the_number_is_the_field_asked_for_or_all_of_it() -> None:
    fields = {"21": "A-7"}
    assert asked(field="21").number_in("(21)A-7", fields) == "A-7"
    assert asked(field="10").number_in("(21)A-7", fields) is None
    assert asked().number_in("A-7", {}) == "A-7"


@pytest.mark.parametrize(
    "keys", [{"field": "21a"}, {"form": "***"}, {"form": "x" * 81}, {"at": "tray"}, {"pattern": ""}]
)
def test_a_wrong_key_is_refused(keys: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=next(iter(keys))):
        asked(**keys)
