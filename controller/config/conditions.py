"""Conditions over named facts, as interlock rules state them: ``door_closed & !(a | b)``.

``!`` binds strongest, then ``&``, then ``|``. Parses and checks conditions; their truth is
evaluated elsewhere.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final, Literal

MAX_LENGTH: Final = 400
MAX_DEPTH: Final = 20
_TOKEN: Final = re.compile(r"\s*([a-z][a-z0-9_]*|[!&|()])")


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition: a fact, or an operator on other conditions.

    Attributes
    ----------
    op : ``fact``, ``not``, ``and`` or ``or``
    name : name of the fact
    parts : joined parts, or the one that is denied
    """

    op: Literal["fact", "not", "and", "or"]
    name: str = ""
    parts: "tuple[Condition, ...]" = ()

    def names(self) -> frozenset[str]:
        """Return the facts that the condition depends on."""
        own = {self.name} if self.op == "fact" else set()
        return frozenset(own.union(*(part.names() for part in self.parts)))


def read_condition(text: str, known: Sequence[str]) -> Condition:
    """Return the condition that a text states.

    Parameters
    ----------
    text : as in the file
    known : names of the facts there are

    Raises
    ------
    ValueError : no condition, or a fact that is not known
    """
    if len(text) > MAX_LENGTH:
        raise ValueError(f"a condition has at most {MAX_LENGTH} characters")
    reader = _Reader(text, frozenset(known))
    condition = reader.any_of(0)
    reader.end()
    return condition


class _Reader:
    """Reads tokens from left to right."""

    def __init__(self, text: str, known: frozenset[str]) -> None:
        self._text = text
        self._known = known
        self._tokens = list(_tokens(text))
        self._at = 0

    def any_of(self, depth: int) -> Condition:
        return self._joined("|", depth)

    def end(self) -> None:
        if self._peek():
            raise ValueError(f"`{self._peek()}` is not expected in {self._text!r}")

    def _joined(self, sign: str, depth: int) -> Condition:
        if depth > MAX_DEPTH:
            raise ValueError(f"more than {MAX_DEPTH} levels")
        parts = [self._part(sign, depth)]
        while self._peek() == sign:
            self._at += 1
            parts.append(self._part(sign, depth))
        if len(parts) == 1:
            return parts[0]
        return Condition("or" if sign == "|" else "and", parts=tuple(parts))

    def _part(self, sign: str, depth: int) -> Condition:
        return self._joined("&", depth) if sign == "|" else self._one(depth)

    def _one(self, depth: int) -> Condition:
        token = self._peek()
        self._at += 1
        if token == "!":
            if depth > MAX_DEPTH:
                raise ValueError(f"more than {MAX_DEPTH} levels")
            return Condition("not", parts=(self._one(depth + 1),))
        if token == "(":
            inner = self._joined("|", depth + 1)
            if self._peek() != ")":
                raise ValueError(f"a bracket is not closed in {self._text!r}")
            self._at += 1
            return inner
        if not token or token in "&|)":
            raise ValueError(f"the name of a fact is missing in {self._text!r}")
        if token not in self._known:
            known = sorted(self._known)
            near = get_close_matches(token, known, 1)
            hint = f"did you mean `{near[0]}`?" if near else f"there are {', '.join(known)}"
            raise ValueError(f"unknown fact `{token}`; {hint}")
        return Condition("fact", token)

    def _peek(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""


def _tokens(text: str) -> Iterator[str]:
    at, end = 0, len(text.rstrip())
    while at < end:
        found = _TOKEN.match(text, at)
        if found is None:
            raise ValueError(f"{text[at:].strip()[:20]!r} is no part of a condition")
        yield found.group(1)
        at = found.end()
