"""The methods that clients call: arguments checked, answered as OPC 40100-1 wants them."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

from asyncua import Server, ua

from controller.plant.model import PartResult
from controller.plant.plant import Offer, PlantError, UnknownError

from .door import account
from .space import CellSpace
from .values import (
    JUDGED,
    RESULT_COMPLETED,
    RESULT_FAILED,
    active_configuration,
    configuration,
    hash_of,
    id_of,
    internal_recipe,
    is_record,
    offered,
    record,
    records,
    result_fields,
    result_key,
    result_record,
)
from .vision import NotDoneError, Refusal, VisionSystem

log = logging.getLogger(__name__)

Answer = tuple[ua.Variant, ...]

# Records in one answer: 200 of some 700 bytes fill two chunks.
MAX_LIST_COUNT: Final = 200
PAGE_COUNT: Final = 200
# A list is looked for this long, whatever the client would wait.
LIST_MAX_WALL_S: Final = 5.0

MACHINE: Final = "VisionStateMachine"
AUTOMATIC: Final = f"{MACHINE}/AutomaticModeStateMachine"

INT32: Final = ua.VariantType.Int32
UINT32: Final = ua.VariantType.UInt32


@dataclass(frozen=True, slots=True)
class Method:
    """A method.

    Attributes
    ----------
    path : below the vision system
    takes : type of each argument: a record's name, or a Python type
    does : what answers, without `Error`, which is put behind
    nothing : what is answered where it is refused
    """

    path: str
    takes: tuple[str | type, ...]
    does: Callable[..., Awaitable[Answer]]
    nothing: Callable[[], Answer]


async def link(server: Server, space: CellSpace, vision: VisionSystem) -> None:
    """Put each method behind its node.

    Parameters
    ----------
    server, space : where the nodes are
    vision : the vision system that the methods call
    """
    for method in _Methods(vision).all():
        server.link_method(await space.child(method.path), _callback(method, vision))


def _callback(method: Method, vision: VisionSystem) -> Callable[..., Awaitable[Any]]:
    name = method.path.rpartition("/")[2]

    async def call(_: ua.NodeId, *given: ua.Variant) -> Any:
        if len(given) < len(method.takes):
            return ua.StatusCode(ua.StatusCodes.BadArgumentsMissing)
        if len(given) > len(method.takes):
            return ua.StatusCode(ua.StatusCodes.BadTooManyArguments)
        values = [variant.Value for variant in given]
        if not all(_fits(value, kind) for value, kind in zip(values, method.takes, strict=True)):
            return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
        try:
            answer = await method.does(*values)
            error = Refusal.DONE
        except NotDoneError as refused:
            answer, error = method.nothing(), refused.refusal
            log.info("%s of %s is refused: %s", name, account.get(), refused)
            await vision.said(f"{name}: {refused}")
        return [*answer, ua.Variant(int(error), INT32)]

    return call


def _fits(value: Any, kind: str | type) -> bool:
    if isinstance(kind, str):
        return is_record(value, kind)
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    return value is None or isinstance(value, kind)


class _Methods:
    """What the methods do.

    Parameters
    ----------
    vision : the vision system
    """

    def __init__(self, vision: VisionSystem) -> None:
        self._vision = vision
        self._plant = vision.plant

    def all(self) -> tuple[Method, ...]:
        """Return every method that is offered."""
        ids = ("RecipeIdExternalDataType", "RecipeIdInternalDataType")
        job = ("MeasIdDataType", "PartIdDataType", ids[0], "ProductIdDataType", list)
        cause = (int, str)
        result = ("ResultIdDataType", int)
        recipes, configurations, results = (
            "RecipeManagement",
            "ConfigurationManagement",
            "ResultManagement",
        )
        # arguments that narrow the list of results, then how many of it
        narrowing = (
            int, *job[:2], *ids, "ConfigurationIdDataType", "ConfigurationIdDataType",
            "ProductIdDataType", "JobIdDataType", int, int, int,
        )  # fmt: skip
        return (
            Method(f"{MACHINE}/Halt", cause, self.halt, _none),
            Method(f"{MACHINE}/Reset", cause, self.reset, _none),
            Method(f"{AUTOMATIC}/Stop", cause, self.stop, _none),
            Method(f"{AUTOMATIC}/Abort", cause, self.abort, _none),
            Method(f"{AUTOMATIC}/StartSingleJob", job, self.start_single, _no_job),
            Method(f"{AUTOMATIC}/StartContinuous", job, self.start_continuous, _no_job),
            Method(
                f"{recipes}/GetRecipeListFiltered",
                (ids[0], "ProductIdDataType", int, int, int, int),
                self.recipe_list,
                _no_list,
            ),
            Method(f"{recipes}/PrepareRecipe", ids, self.prepare, _not_prepared),
            Method(f"{recipes}/UnprepareRecipe", ids, self.unprepare, _no_recipe),
            Method(
                f"{configurations}/GetConfigurationList",
                (int, int, int),
                self.configuration_list,
                _no_list,
            ),
            Method(
                f"{configurations}/GetConfigurationById",
                ("ConfigurationIdDataType", int),
                self.configuration_by_id,
                self._no_configuration,
            ),
            Method(
                f"{configurations}/ActivateConfiguration",
                ("ConfigurationIdDataType",),
                self.activate_configuration,
                _none,
            ),
            Method(f"{results}/GetResultById", result, self.result_by_id, _no_result),
            Method(
                f"{results}/GetResultComponentsById", result, self.result_components, _no_components
            ),
            Method(f"{results}/GetResultListFiltered", narrowing, self.result_list, _no_list),
        )

    # the state machine

    async def halt(self, cause: int, described: str | None) -> Answer:
        """Halt."""
        await self._vision.halt(account.get(), _why(cause, described))
        return ()

    async def reset(self, cause: int, described: str | None) -> Answer:
        """Reset."""
        del cause, described
        await self._vision.reset()
        return ()

    async def stop(self, cause: int, described: str | None) -> Answer:
        """Stop."""
        await self._vision.stop("Stop", account.get(), _why(cause, described))
        return ()

    async def abort(self, cause: int, described: str | None) -> Answer:
        """Abort."""
        await self._vision.stop("Abort", account.get(), _why(cause, described))
        return ()

    async def start_single(
        self, meas: Any, part: Any, recipe: Any, product: Any, parameters: list[Any] | None
    ) -> Answer:
        """StartSingleJob: an order of one part; PartId is its serial number."""
        del product, parameters
        number = await self._vision.start(
            "single", account.get(), id_of(meas), id_of(recipe), id_of(part), 1
        )
        return (ua.Variant(record("JobIdDataType", Id=number)),)

    async def start_continuous(
        self, meas: Any, part: Any, recipe: Any, product: Any, parameters: list[Any] | None
    ) -> Answer:
        """StartContinuous: an order of `Parameters[0]` parts, or of the recipe's own number."""
        del product
        if id_of(part):
            raise NotDoneError(Refusal.ARGUMENT, "a PartId belongs to StartSingleJob")
        number = await self._vision.start(
            "continuous", account.get(), id_of(meas), id_of(recipe), "", _quantity(parameters)
        )
        return (ua.Variant(record("JobIdDataType", Id=number)),)

    # recipes

    async def recipe_list(
        self, external: Any, product: Any, prepared: int, most: int, first: int, wait_ms: int
    ) -> Answer:
        """GetRecipeListFiltered."""
        del product, wait_ms
        wanted = {0: False, 1: True}.get(int(prepared))
        found = [
            offered(offer)
            for offer in await self._offers()
            if id_of(external) in ("", offer.key)
            and wanted in (None, self._vision.is_prepared(offer))
        ]
        return _list(found, most, first)

    async def prepare(self, external: Any, internal: Any) -> Answer:
        """PrepareRecipe: by name, by name and hash, or by both records."""
        offer = await self._offer(external, internal)
        await self._vision.prepare_recipe(offer)
        return (
            ua.Variant(internal_recipe(offer.key, offer.sha256, offer.name)),
            ua.Variant(True, ua.VariantType.Boolean),
        )

    async def unprepare(self, external: Any, internal: Any) -> Answer:
        """UnprepareRecipe."""
        offer = await self._offer(external, internal)
        await self._vision.unprepare_recipe(offer)
        return (ua.Variant(internal_recipe(offer.key, offer.sha256, offer.name)),)

    # configurations: the cell file, one and active

    async def configuration_list(self, most: int, first: int, wait_ms: int) -> Answer:
        """GetConfigurationList."""
        del wait_ms
        return _list([self._configuration()], most, first)

    async def configuration_by_id(self, wanted: Any, wait_ms: int) -> Answer:
        """GetConfigurationById."""
        del wait_ms
        self._require_active(wanted)
        return (_handle(), ua.Variant(self._configuration()))

    async def activate_configuration(self, wanted: Any) -> Answer:
        """ActivateConfiguration: the cell file is active; another takes a person."""
        self._require_active(wanted)
        return ()

    # results

    async def result_by_id(self, wanted: Any, wait_ms: int) -> Answer:
        """GetResultById."""
        del wait_ms
        fields = result_fields(await self._result(wanted))
        return (_handle(), ua.Variant(result_record(fields)))

    async def result_components(self, wanted: Any, wait_ms: int) -> Answer:
        """GetResultComponentsById."""
        del wait_ms
        return _components(result_fields(await self._result(wanted)))

    async def result_list(self, *arguments: Any) -> Answer:
        """GetResultListFiltered: oldest first, without their content."""
        *narrowing, most, first, wait_ms = arguments
        limit = min(most or MAX_LIST_COUNT, MAX_LIST_COUNT)
        wanted_s = min(wait_ms / 1e3 if wait_ms > 0 else LIST_MAX_WALL_S, LIST_MAX_WALL_S)
        found: list[PartResult] = []
        is_complete, skipped, after = False, 0, 0
        try:
            async with asyncio.timeout(wanted_s):
                while not is_complete and len(found) <= limit:
                    page = await self._plant.parts(after, PAGE_COUNT)
                    is_complete = not page
                    for result in page:
                        after = result.seq
                        if not _is_wanted(result, *narrowing):
                            continue
                        if skipped < first:
                            skipped += 1
                        else:
                            found.append(result)
        except TimeoutError:
            log.info("GetResultListFiltered: not all results were looked through in time")
        except PlantError as error:
            raise NotDoneError(Refusal.REFUSED, str(error)) from error
        shown = [result_record(result_fields(one, with_content=False)) for one in found[:limit]]
        return (
            ua.Variant(is_complete and len(found) <= limit, ua.VariantType.Boolean),
            ua.Variant(len(shown), UINT32),
            _handle(),
            records(shown),
        )

    # within

    async def _offers(self) -> tuple[Offer, ...]:
        try:
            return await self._plant.recipes()
        except PlantError as error:
            raise NotDoneError(Refusal.REFUSED, str(error)) from error

    async def _offer(self, external: Any, internal: Any) -> Offer:
        keys = {key for key in (id_of(external), id_of(internal)) if key}
        if len(keys) != 1:
            raise NotDoneError(
                Refusal.ARGUMENT,
                "ExternalId and InternalId name two recipes" if keys else "no recipe is named",
            )
        key = keys.pop()
        for offer in await self._offers():
            if offer.key == key:
                break
        else:
            raise NotDoneError(Refusal.UNKNOWN, f"there is no recipe {key!r:.100}")
        for given in (external, internal):
            if hash_of(given) not in ("", offer.sha256):
                raise NotDoneError(
                    Refusal.UNKNOWN,
                    f"{key} is another recipe by now: its SHA-256 begins with {offer.sha256[:12]},"
                    f" {hash_of(given)[:12]} was asked for",
                )
        return offer

    async def _result(self, wanted: Any) -> PartResult:
        try:
            return await self._plant.part(*result_key(id_of(wanted)))
        except UnknownError as error:
            raise NotDoneError(Refusal.UNKNOWN, str(error)) from error
        except PlantError as error:
            raise NotDoneError(Refusal.REFUSED, str(error)) from error

    def _configuration(self) -> Any:
        return active_configuration(self._plant.cell, self._plant.cell_file_sha256)

    def _no_configuration(self) -> Answer:
        none = configuration("", None)
        found = self._configuration()
        found.InternalId = none
        return (_handle(), ua.Variant(found))

    def _require_active(self, wanted: Any) -> None:
        plant = self._plant
        if id_of(wanted) == plant.cell and hash_of(wanted) in ("", plant.cell_file_sha256):
            return
        raise NotDoneError(
            Refusal.UNKNOWN,
            f"there is no configuration {id_of(wanted)!r:.100} of this hash; the one there is, the"
            f" cell file of {plant.cell}, is active",
        )


def _why(cause: int, described: str | None) -> str:
    said = "".join(letter for letter in (described or "")[:200] if letter.isprintable()).strip()
    return f"{said} (cause {cause})" if said else f"cause {cause}"


def _quantity(parameters: list[Any] | None) -> int | None:
    if not parameters:
        return None
    given = parameters[0]
    value = given.Value if isinstance(given, ua.Variant) else given
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise NotDoneError(
            Refusal.ARGUMENT, f"Parameters[0] is the number of parts, not {value!r:.40}"
        )
    return value


def _is_wanted(
    result: PartResult,
    state: int,
    meas: Any,
    part: Any,
    external: Any,
    internal: Any,
    external_configuration: Any,
    internal_configuration: Any,
    product: Any,
    job: Any,
) -> bool:
    del external_configuration, product
    own = RESULT_COMPLETED if result.verdict in JUDGED else RESULT_FAILED
    return (
        state in (0, own)
        and id_of(meas) in ("", result.order)
        and id_of(part) in ("", result.serial)
        and id_of(external) in ("", result.recipe)
        and id_of(internal) in ("", result.recipe)
        and hash_of(internal) in ("", result.recipe_sha256)
        and id_of(internal_configuration) in ("", result.cell)
        and id_of(job) in ("", result.order or result.run)
    )


def _handle() -> ua.Variant:
    """Return the handle of an answer: none is kept, so none has to be released."""
    return ua.Variant(0, UINT32)


def _list(found: list[Any], most: int, first: int) -> Answer:
    shown = found[first : first + min(most or MAX_LIST_COUNT, MAX_LIST_COUNT)]
    return (
        ua.Variant(first + len(shown) >= len(found), ua.VariantType.Boolean),
        ua.Variant(len(shown), UINT32),
        _handle(),
        records(shown),
    )


def _components(fields: dict[str, Any]) -> Answer:
    """Return the fields of a result as arguments of their own, in the order of the method."""
    kinds = {
        "ResultState": INT32,
        "CreationTime": ua.VariantType.DateTime,
        "HasTransferableDataOnFile": ua.VariantType.Boolean,
        "IsPartial": ua.VariantType.Boolean,
        "IsSimulated": ua.VariantType.Boolean,
    }
    found: list[ua.Variant] = []
    for name, value in fields.items():
        if name == "ResultId":
            continue
        if name == "ResultContent":
            found.append(ua.Variant(value or [], ua.VariantType.Variant, is_array=True))
        elif value is None:
            found.append(ua.Variant())
        else:
            found.append(ua.Variant(value, kinds.get(name, ua.VariantType.ExtensionObject)))
        if name == "HasTransferableDataOnFile":
            found.append(_handle())
    return tuple(found)


def _none() -> Answer:
    return ()


def _no_job() -> Answer:
    return (ua.Variant(record("JobIdDataType", Id="")),)


def _no_recipe() -> Answer:
    return (ua.Variant(internal_recipe("", None)),)


def _not_prepared() -> Answer:
    return (*_no_recipe(), ua.Variant(False, ua.VariantType.Boolean))


def _no_list() -> Answer:
    return _list([], 0, 0)


def _no_result() -> Answer:
    return (_handle(), ua.Variant())


def _no_components() -> Answer:
    return tuple(ua.Variant() for _ in range(16))
