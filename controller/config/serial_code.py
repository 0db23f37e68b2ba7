"""The code on a part, or beside it, that has the part's serial number (ADR 129)."""

import re
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from .yaml_models import Section

# Signs of a form: `#` a digit, `@` a letter, `*` any others; at most two of the last, as each way
# to share a text among them is tried.
_SIGNS = {"#": "[0-9]", "@": "[A-Za-z]", "*": ".*"}
_FORM = r"^[^*]*(\*[^*]*){0,2}$"


class SerialCodeSection(Section):
    """The code that the cell's cameras read the part's serial number from.

    Attributes
    ----------
    code : symbology
    at : where it is: on the part, or on a card, a label or a carrier beside it on the table; then
        only one part of the batch may lie there
    field : field with the number, where the code has several: an application identifier of GS1, as
        21, or a data identifier of ISO 15434, as S; empty: the number is all that the code says
    form : form that the number must have: `#` a digit, `@` a letter, `*` any signs or none, all
        else itself, as in SN-####; empty for any
    """

    code: Literal["data_matrix", "qr"]
    at: Literal["part", "beside"] = "part"
    field: Annotated[str, Field(pattern=r"^([0-9]{2,4}|[0-9]{0,3}[A-Z])?$")] = ""
    form: Annotated[str, Field(max_length=80, pattern=_FORM)] = ""

    def number_in(self, text: str, fields: Mapping[str, str]) -> str | None:
        """Return the number that a code has; None if it has no such field.

        Parameters
        ----------
        text : all that the code says
        fields : its fields by their identifier; empty without any
        """
        return fields.get(self.field) if self.field else text

    @property
    def example(self) -> str:
        """What such a code may say: a first number, for emulated parts; empty for ISO 15434."""
        form = (self.form or "E####").replace("@", "A")
        form = form[:-1] + "####" if form.endswith("*") else form
        number = form.replace("*", "")
        head = number.rstrip("#")
        if len(number) > len(head):
            number = f"{head}{1:0{len(number) - len(head)}d}"
        number = number.replace("#", "0")
        if not self.field:
            return number
        return f"({self.field}){number}" if self.field.isdigit() else ""

    def why_not(self, number: str) -> str:
        """Return the reason why a number is not of the recipe's form; empty if it is."""
        form = "".join(_SIGNS.get(sign, re.escape(sign)) for sign in self.form)
        if not self.form or re.fullmatch(form, number):
            return ""
        return f"{number:.40}: the recipe asks for the form {self.form}"
