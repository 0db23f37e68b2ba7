"""The kind of YAML file given, by its keys: for the message if it is the wrong kind."""

from typing import Any


def is_recipe(tree: Any) -> bool:  # noqa: ANN401 - a YAML value is any value
    """Return whether a YAML tree looks like a recipe: it has a name, and names a part's file."""
    return isinstance(tree, dict) and "name" in tree and isinstance(tree.get("part"), str)


def is_cell_file(tree: Any) -> bool:  # noqa: ANN401
    """Return whether a YAML tree looks like a cell file: it has devices."""
    return isinstance(tree, dict) and "devices" in tree and "part" not in tree
