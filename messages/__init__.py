"""Sentences for people as data: a key with its values, and the English sentence that they make.

A sentence is made by `say`, once, where it arises. It is a `str`, its English, so that whoever
wants English alone need not know of this package. Its key is the English template, as gettext has
it. `words` has it in other languages; `form` keeps key and values beside the sentence in JSON;
`fields` keeps them in models. Drivers and controller both make sentences, so it stands below both.

A plain text without values, such as a name or the word of an enumeration, is its own key.
"""

from ._message import Message, Value, joined, key, say, say_counted

__all__ = ["Message", "Value", "joined", "key", "say", "say_counted"]
