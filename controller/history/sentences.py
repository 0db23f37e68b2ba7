"""The sentences of the store: keys and values, by the English that its other tables have."""

import json
from collections.abc import Iterable, Mapping
from hashlib import sha256
from typing import Any, Final, TypeVar

from sqlalchemy import Connection, insert, select

from messages import Message
from messages.form import as_json, of_json, restored, sentences_in, texts_in

from .tables import SENTENCES

T = TypeVar("T")
ASKED_MAX_COUNT: Final = 500  # of one query: SQLite before 3.32 takes 999 values


def without_sentences(db: Connection, values: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return rows with the English of their sentences alone, as drivers of databases take it.

    Key and values of each sentence are written, unless the store has them.

    Parameters
    ----------
    db : open for writing
    values : rows, by name of the column
    """
    every = list(values)
    wanted = {_digest(one): one for one in sentences_in(every) if one.values}
    new = wanted.keys() - _known(db, wanted).keys()
    rows = [{"key": key, "said": json.dumps(as_json(wanted[key]))} for key in sorted(new)]
    if rows:
        db.execute(insert(SENTENCES), rows)
    return [
        {name: str.__str__(one) if isinstance(one, Message) else one for name, one in row.items()}
        for row in every
    ]


def with_sentences(db: Connection, content: T) -> T:
    """Return JSON values with their sentences; one without a key stays English.

    Parameters
    ----------
    db : open for reading
    content : what was read of other tables
    """
    wanted = {_digest(text): text for text in texts_in(content)}
    said = {wanted[key]: of_json(json.loads(one)) for key, one in _known(db, wanted).items()}
    found: T = restored(content, said)
    return found


def _digest(text: str) -> str:
    return sha256(text.encode("utf-8", "backslashreplace")).hexdigest()


def _known(db: Connection, keys: Iterable[str]) -> dict[str, str]:
    """Return what the store has, by key."""
    every = sorted(keys)
    found: dict[str, str] = {}
    for first in range(0, len(every), ASKED_MAX_COUNT):
        some = every[first : first + ASKED_MAX_COUNT]
        query = select(SENTENCES.c.key, SENTENCES.c.said).where(SENTENCES.c.key.in_(some))
        found |= {str(key): str(said) for key, said in db.execute(query)}
    return found
