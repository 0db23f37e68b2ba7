"""Fields of pydantic models that hold sentences; drivers, which know no pydantic, need no model."""

from typing import Annotated, Any

from pydantic import ValidatorFunctionWrapHandler, WrapValidator

from ._message import Message


def _keep(value: Any, check: ValidatorFunctionWrapHandler) -> str:  # noqa: ANN401  (before it is checked)
    text: str = check(value)
    return value if isinstance(value, Message) else text


# A text that keeps its key and values; pydantic makes a plain `str` of any other.
Sentence = Annotated[str, WrapValidator(_keep)]
