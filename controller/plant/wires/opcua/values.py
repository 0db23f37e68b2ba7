"""The records of OPC 40100-1 made of ours, and what clients' arguments say.

The record types come from the NodeSet when it is loaded: `ua.JobIdDataType` is there from then on.
"""

from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any, Final

from asyncua import ua

from controller.plant.model import PartResult
from controller.plant.plant import Offer, UnknownError

HASH: Final = "SHA-256"
NO_TIME: Final = datetime(1601, 1, 1, tzinfo=UTC)  # OPC UA's null date
# OPC 40100-1, 12.19
RESULT_COMPLETED: Final = 1
RESULT_FAILED: Final = 4
JUDGED: Final = ("pass", "fail", "indeterminate")


def record(name: str, **fields: Any) -> Any:
    """Return a record of a type of the NodeSet."""
    return getattr(ua, name)(**fields)


def text(value: Any) -> ua.LocalizedText | None:
    """Return a text; None for none."""
    return ua.LocalizedText(str(value)) if value else None


def is_record(value: Any, name: str) -> bool:
    """Return whether an argument is a record of a type, or null."""
    is_null = value is None or (isinstance(value, ua.ExtensionObject) and value.TypeId.is_null())
    return is_null or isinstance(value, getattr(ua, name))


def id_of(value: Any) -> str:
    """Return the Id of a record, without blanks around; empty for none."""
    return str(getattr(value, "Id", None) or "").strip()


def hash_of(value: Any) -> str:
    """Return the hash of a record in hexadecimal; empty for none."""
    found = getattr(value, "Hash", None)
    return found.hex() if isinstance(found, bytes) else ""


def _named(name: str, key: str, sha256: str | None, description: str = "") -> Any:
    return record(
        name,
        Id=key,
        Hash=bytes.fromhex(sha256) if sha256 else None,
        HashAlgorithm=HASH if sha256 else None,
        Description=text(description),
    )


def external_recipe(key: str) -> Any:
    """Return a recipe as clients name it."""
    return _named("RecipeIdExternalDataType", key, None)


def internal_recipe(key: str, sha256: str | None, description: str = "") -> Any:
    """Return a recipe with the hash of its file.

    Parameters
    ----------
    key : its name in an order
    sha256 : in hexadecimal; None where it is not known
    description : what a person reads
    """
    return _named("RecipeIdInternalDataType", key, sha256, description)


def offered(offer: Offer) -> Any:
    """Return a recipe of the cell's offers."""
    described = f"{offer.name}: {offer.problem}" if offer.problem else offer.name
    return internal_recipe(offer.key, offer.sha256, described)


def configuration(cell: str, sha256: str | None) -> Any:
    """Return the identity of a configuration: the cell file by its hash."""
    return _named("ConfigurationIdDataType", cell, sha256)


def active_configuration(cell: str, sha256: str) -> Any:
    """Return the configuration of the cell."""
    return record(
        "ConfigurationDataType",
        HasTransferableDataOnFile=False,
        ExternalId=None,
        InternalId=configuration(cell, sha256),
        LastModified=NO_TIME,
    )


def result_id(result: PartResult) -> str:
    """Return what a result is known by."""
    return f"{result.run}/{result.part}/{result.revision}"


def result_key(said: str) -> tuple[str, int, int | None]:
    """Return run, part and revision of a ResultId; without a revision, the last one is meant.

    Raises
    ------
    UnknownError : it is none
    """
    run, *numbers = said.split("/")
    if run and len(numbers) in (1, 2) and all(one.isascii() and one.isdigit() for one in numbers):
        part, *revision = (int(one[:9]) for one in numbers)
        return run, part, revision[0] if revision else None
    raise UnknownError(f"{said!r:.100} is no ResultId; one is RUN/PART/REVISION")


def result_fields(result: PartResult, *, with_content: bool = True) -> dict[str, Any]:
    """Return the fields of a ResultDataType, by name.

    `ResultContent` is the JSON of the result, its verdict, and the compared fraction. A part that
    fails is a completed result; failed is an inspection without a verdict.
    """
    content = [
        ua.Variant(result.model_dump_json(by_alias=True), ua.VariantType.String),
        ua.Variant(result.verdict, ua.VariantType.String),
        ua.Variant(result.compared_fraction, ua.VariantType.Double)
        if result.compared_fraction is not None
        else ua.Variant(),
    ]
    order = result.order
    return {
        "ResultId": record("ResultIdDataType", Id=result_id(result)),
        "HasTransferableDataOnFile": False,
        "IsPartial": False,
        "IsSimulated": result.is_emulated or result.is_dry,
        "ResultState": RESULT_COMPLETED if result.verdict in JUDGED else RESULT_FAILED,
        "MeasId": record("MeasIdDataType", Id=order, Description=None) if order else None,
        "PartId": record("PartIdDataType", Id=result.serial, Description=None)
        if result.serial
        else None,
        "ExternalRecipeId": external_recipe(result.recipe),
        "InternalRecipeId": internal_recipe(result.recipe, result.recipe_sha256),
        "ProductId": None,
        "ExternalConfigurationId": None,
        # which cell file a past run had is not told: its hash stays out
        "InternalConfigurationId": configuration(result.cell, None),
        "JobId": record("JobIdDataType", Id=order or result.run),
        "CreationTime": result.ended,
        "ProcessingTimes": record(
            "ProcessingTimesDataType",
            StartTime=result.begun,
            EndTime=result.ended,
            AcquisitionDuration=None,
            ProcessingDuration=None,
        ),
        "ResultContent": content if with_content else None,
    }


def result_record(fields: dict[str, Any]) -> Any:
    """Return a ResultDataType."""
    return record("ResultDataType", **fields)


def records(found: Iterable[Any]) -> ua.Variant:
    """Return an array of records, which may be empty."""
    return ua.Variant(list(found), ua.VariantType.ExtensionObject, is_array=True)
