"""Sentences in JSON: the English stays where it is, its key and values stand beside it.

A JSON object that has sentences in it gets a member `SAID`: by the English of each sentence its
key and values. A reader that does not know of it sees English alone; an object without it, from
before there were keys, is read as English.
"""

import re
from collections.abc import Iterator, Mapping
from string import Formatter
from typing import Any, Final

from ._message import Message

SAID: Final = "said"
# Environment variable by which whoever starts `cellctl` has refusals on stderr as JSON, with keys.
KEYS_ASKED: Final = "CELLCTL_KEYS"
# Format of a blank: sign, zeros, two digits of width, thousands, decimals, kind.
FORMAT: Final = re.compile(r"[-+ ]?0?\d{0,2},?(\.\d{1,2})?[a-zA-Z%]?")


def sentences_in(content: object) -> Iterator[Message]:
    """Yield the sentences within JSON values, names of members left out."""
    yield from (text for text in texts_in(content) if isinstance(text, Message))


def said_in(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the member `SAID` for a JSON object; empty if no sentence in it has values."""
    said = {str.__str__(one): as_json(one) for one in sentences_in(content) if one.values}
    return {SAID: said} if said else {}


def with_said(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return a JSON object with the keys and values of its sentences beside them."""
    return {**content, **said_in(content)}


def from_said(content: Any) -> Any:  # noqa: ANN401  (JSON)
    """Return a JSON object whose sentences have their keys and values again.

    Parameters
    ----------
    content : as `with_said` made it, or any other JSON, which stays as it is

    Raises
    ------
    ValueError : keys and values do not make the sentence
    """
    if not isinstance(content, Mapping) or SAID not in content:
        return content
    if not isinstance(content[SAID], Mapping):
        raise ValueError(f"no sentences: {content[SAID]!r}")
    said = {text: of_json(one) for text, one in content[SAID].items()}
    return restored({name: value for name, value in content.items() if name != SAID}, said)


def as_json(message: Message) -> dict[str, Any]:
    """Return key and values of a sentence as JSON."""
    values = {
        name: as_json(one) if isinstance(one, Message) else one
        for name, one in message.values.items()
    }
    found: dict[str, Any] = {"key": message.key}
    if message.many:
        found["many"] = message.many
    return {**found, "values": values} if values else found


def of_json(content: Mapping[str, Any]) -> Message:
    """Return the sentence of a key and values.

    Raises
    ------
    ValueError : a blank without its value, a format that no template has, or something else than
        key and values
    """
    try:
        for template in (content["key"], content.get("many", "")):
            for _, _, spec, _ in Formatter().parse(template):
                if spec and not FORMAT.fullmatch(spec):  # its width would take memory
                    raise ValueError(f"{template!r}: no template has the format {spec!r}")
        values = {
            name: of_json(one) if isinstance(one, Mapping) else one
            for name, one in content.get("values", {}).items()
        }
        return Message(content["key"], values, content.get("many", ""))
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"no key with values: {content!r}") from error


def texts_in(content: object) -> Iterator[str]:
    """Yield the texts within JSON values, names of members left out."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, Mapping):
        for value in content.values():
            yield from texts_in(value)
    elif isinstance(content, list | tuple) and not _has_figures(content):
        for value in content:
            yield from texts_in(value)


def restored(content: Any, said: Mapping[str, Message]) -> Any:  # noqa: ANN401  (JSON)
    """Return JSON values with sentences in place of their English.

    Parameters
    ----------
    content : JSON values
    said : sentences by their English
    """
    if isinstance(content, str):
        return said.get(content, content)
    if isinstance(content, Mapping):
        return {name: restored(value, said) for name, value in content.items()}
    if isinstance(content, list | tuple) and not _has_figures(content):
        return type(content)(restored(value, said) for value in content)
    return content


def _has_figures(content: list[Any] | tuple[Any, ...]) -> bool:
    """Return whether a list is one of figures, points or matrices, as its first one is.

    Outlines and meshes have very many, and are left out whole.
    """
    first: object = content
    while isinstance(first, list | tuple) and first:
        first = first[0]
    return isinstance(first, int | float)
