"""OPC UA before a cell in memory, by asyncua's client: who comes in, and what calls do."""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
from asyncua import Client, ua
from asyncua.crypto.security_policies import (
    SecurityPolicyAes256Sha256RsaPss,
    SecurityPolicyBasic256Sha256,
)
from fake_plant import alarm_notice, idle_state, part_result
from opcua_bench import ANSWER_WALL_S, RUN, Bench, Heard, Vision, make_certificate

from controller.plant.plant import Offer
from controller.plant.wires.opcua import door
from controller.plant.wires.opcua import space as opcua_space
from controller.plant.wires.opcua.certificates import MAX_REJECTED_COUNT, CertificateFolder
from controller.plant.wires.opcua.door import (
    MAX_CALL_COUNT,
    MAX_CHUNK_BYTES,
    MAX_CONNECTION_COUNT,
    MAX_UNNAMED_MESSAGE_COUNT,
    MAX_UNNAMED_WALL_S,
    MIN_PUBLISHING_MS,
)
from controller.plant.wires.opcua.vision import Refusal

pytestmark = pytest.mark.asyncio(loop_scope="module")

AUTOMATIC = "VisionStateMachine/AutomaticModeStateMachine"
STATE_CHANGED, ERROR, RESOLVED, INFORMATION = 1018, 1019, 1020, 1038
RECIPE_PREPARED, JOB_STARTED, READY, RESULT_READY = 1022, 1013, 1023, 1024
ALL = (
    STATE_CHANGED,
    ERROR,
    RESOLVED,
    INFORMATION,
    RECIPE_PREPARED,
    JOB_STARTED,
    READY,
    RESULT_READY,
)


def int32(value: int) -> ua.Variant:
    return ua.Variant(value, ua.VariantType.Int32)


def uint32(value: int) -> ua.Variant:
    return ua.Variant(value, ua.VariantType.UInt32)


def plain(values: list[Any]) -> list[Any]:
    """Return values of an array of variants, which asyncua leaves as variants."""
    return [one.Value if isinstance(one, ua.Variant) else one for one in values]


def no_parameters(*given: Any) -> ua.Variant:
    return ua.Variant([ua.Variant(one) for one in given], ua.VariantType.Variant, is_array=True)


@pytest_asyncio.fixture(loop_scope="module", scope="module")
async def served(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Bench]:
    bench = Bench(tmp_path_factory.mktemp("opcua"))
    async with bench.serving():
        yield bench


@pytest_asyncio.fixture(loop_scope="module")
async def bench(served: Bench) -> Bench:
    return await served.fresh()


@pytest_asyncio.fixture(loop_scope="module")
async def vision(bench: Bench) -> AsyncIterator[Vision]:
    async with await bench.client() as client:
        yield await Vision.found(client)


@pytest_asyncio.fixture(loop_scope="module")
async def heard(vision: Vision) -> AsyncIterator[Heard]:
    heard = Heard()
    subscription = await vision.client.create_subscription(MIN_PUBLISHING_MS, heard)
    types = [vision.client.get_node(ua.NodeId(n, vision.namespace)) for n in ALL]
    await subscription.subscribe_events(vision.node, types)
    yield heard
    await subscription.delete()


async def prepare(vision: Vision, key: str = "holder") -> list[Any]:
    return await vision.call(
        "RecipeManagement/PrepareRecipe", ua.RecipeIdExternalDataType(Id=key), None
    )


async def start(vision: Vision, meas: str = "PO-1", serial: str = "SN-1", recipe: str = "") -> Any:
    return await vision.call(
        f"{AUTOMATIC}/StartSingleJob",
        ua.MeasIdDataType(Id=meas) if meas else None,
        ua.PartIdDataType(Id=serial) if serial else None,
        ua.RecipeIdExternalDataType(Id=recipe) if recipe else None,
        None,
        no_parameters(),
    )


async def stop(vision: Vision, method: str = "Stop") -> int:
    return await vision.call(f"{AUTOMATIC}/{method}", int32(7), "shift ends")


# who comes in


@pytest.mark.parametrize("policy", [SecurityPolicyBasic256Sha256, SecurityPolicyAes256Sha256RsaPss])
async def test_a_plant_account_comes_in_by_both_policies(bench: Bench, policy: type) -> None:
    async with await bench.client(policy=policy) as client:
        assert (await (await Vision.found(client)).state())[0] == "Operational"


@pytest.mark.parametrize(("name", "password"), [("mes", "wrong password"), ("ada", "x" * 12)])
async def test_a_wrong_name_or_password_is_refused(bench: Bench, name: str, password: str) -> None:
    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        await (await bench.client(name=name, password=password)).connect()


async def test_nobody_comes_in_without_a_name(bench: Bench) -> None:
    client = await bench.client(name=None)
    with pytest.raises((ua.UaError, ValueError)):
        await client.connect()
    await client.connect_socket()
    try:
        await client.send_hello()
        await client.open_secure_channel()
        await client.create_session()
        request = ua.ActivateSessionParameters()
        request.UserIdentityToken = ua.AnonymousIdentityToken()
        request.ClientSignature.Algorithm = client.security_policy.AsymmetricSignatureURI
        challenge = client.security_policy.peer_certificate + client._server_nonce
        request.ClientSignature.Signature = (
            client.security_policy.asymmetric_cryptography.signature(challenge)
        )
        with pytest.raises(ua.uaerrors.BadIdentityTokenRejected):
            await client.uaclient.activate_session(request)
    finally:
        client.disconnect_socket()


async def test_no_endpoint_is_open_and_without_encryption_there_is_discovery_alone(
    bench: Bench,
) -> None:
    client = Client(bench.wire.url)
    endpoints = await client.connect_and_get_server_endpoints()
    assert {(e.SecurityMode.name, e.SecurityPolicyUri.rpartition("#")[2]) for e in endpoints} == {
        ("SignAndEncrypt", "Basic256Sha256"),
        ("SignAndEncrypt", "Aes256_Sha256_RsaPss"),
    }
    tokens = {token.TokenType.name for e in endpoints for token in e.UserIdentityTokens}
    assert tokens == {"UserName"}
    assert {e.Server.ApplicationUri for e in endpoints} == {"urn:cellctl:cell-3"}


async def unencrypted(bench: Bench) -> Client:
    client = Client(bench.wire.url)
    await client.connect_socket()
    await client.send_hello()
    await client.open_secure_channel()
    return client


async def test_a_password_in_plain_text_opens_no_session(bench: Bench) -> None:
    client = await unencrypted(bench)
    try:
        params = ua.CreateSessionParameters()
        params.ClientNonce = b"n" * 32
        params.EndpointUrl = bench.wire.url
        params.RequestedSessionTimeout = 60_000
        with pytest.raises(ua.uaerrors.BadSecurityModeInsufficient):
            await client.uaclient.create_session(params)
    finally:
        client.disconnect_socket()


async def test_a_stranger_registers_no_server(bench: Bench) -> None:
    client = await unencrypted(bench)
    try:
        server = ua.RegisteredServer()
        server.ServerUri = "urn:stranger"
        server.ServerNames = [ua.LocalizedText("stranger")]
        with pytest.raises(ua.uaerrors.BadServiceUnsupported):
            await client.uaclient.register_server(server)
    finally:
        client.disconnect_socket()


async def test_signing_alone_is_not_enough(bench: Bench) -> None:
    with pytest.raises(ua.UaError, match="No matching endpoints"):
        await bench.client(mode=ua.MessageSecurityMode.Sign)
    client = await bench.client()
    client.security_policy.Mode = ua.MessageSecurityMode.Sign
    with pytest.raises((ua.UaError, ConnectionError)):
        await client.connect()


async def test_the_certificate_of_another_is_turned_away_and_let_in_once_a_person_moves_it(
    bench: Bench, tmp_path: Path
) -> None:
    files = make_certificate(tmp_path, "stranger")
    with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
        await (await bench.client(files=files)).connect()
    der = files[0].read_bytes()
    rejected = bench.folder / "rejected" / f"{hashlib.sha256(der).hexdigest()[:16]}.der"
    assert rejected.read_bytes() == der
    rejected.rename(bench.folder / "trusted" / "stranger.der")
    async with await bench.client(files=files) as client:
        await Vision.found(client)
    (bench.folder / "trusted" / "stranger.der").unlink()
    with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
        await (await bench.client(files=files)).connect()


async def test_strangers_do_not_fill_the_log(
    bench: Bench,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(door, "WARN_WALL_S", 3600.0)
    files = make_certificate(tmp_path, "stranger")
    for _ in range(5):
        with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
            await (await bench.client(files=files)).connect()
    said = [one for one in caplog.records if "is turned away" in one.getMessage()]
    assert len(said) <= 1


async def test_messages_before_a_log_in_are_few(bench: Bench, vision: Vision) -> None:
    host, _, port = bench.wire.url.removeprefix("opc.tcp://").partition("/")[0].rpartition(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    url = b"opc.tcp://x"
    hello = b"".join(n.to_bytes(4, "little") for n in (0, 65_535, 65_535, 0, 0, len(url))) + url
    message = b"HELF" + (8 + len(hello)).to_bytes(4, "little") + hello
    writer.write(message * 2 * MAX_UNNAMED_MESSAGE_COUNT)
    answer = await asyncio.wait_for(reader.read(), ANSWER_WALL_S)  # until it is closed
    assert answer.count(b"ACKF") <= MAX_UNNAMED_MESSAGE_COUNT
    writer.close()
    assert (await vision.state())[0] == "Operational"


async def test_a_trusted_certificate_that_is_only_named_lets_nobody_in(
    bench: Bench, tmp_path: Path
) -> None:
    other = make_certificate(tmp_path, "second")
    (bench.folder / "trusted" / "second.der").write_bytes(other[0].read_bytes())
    client = await bench.client(files=other)
    await client.connect_socket()
    try:
        await client.send_hello()
        await client.open_secure_channel()
        params = ua.CreateSessionParameters()
        params.ClientNonce = b"n" * 32
        params.ClientCertificate = bench.trusted[0].read_bytes()
        params.EndpointUrl = bench.wire.url
        with pytest.raises(ua.uaerrors.BadCertificateInvalid):
            await client.uaclient.create_session(params)
    finally:
        client.disconnect_socket()
        (bench.folder / "trusted" / "second.der").unlink()


@pytest.mark.parametrize(
    ("changes", "said"), [({"days": -1}, "valid from"), ({"bits": 1024}, "2048")]
)
async def test_a_certificate_that_is_over_or_weak_is_not_trusted(
    tmp_path: Path, changes: dict[str, int], said: str
) -> None:
    folder = CertificateFolder(tmp_path / "opcua")
    folder.own("urn:cellctl:cell-3", ("127.0.0.1",))
    certificate, _ = make_certificate(tmp_path, "old", **changes)
    (tmp_path / "opcua/trusted/old.der").write_bytes(certificate.read_bytes())
    assert said in folder.refusal(certificate.read_bytes())


async def test_the_folder_of_rejected_certificates_does_not_grow_without_end(
    tmp_path: Path,
) -> None:
    folder = CertificateFolder(tmp_path / "opcua")
    folder.own("urn:cellctl:cell-3", ("127.0.0.1",))
    rejected = tmp_path / "opcua/rejected"
    for number in range(MAX_REJECTED_COUNT):
        (rejected / f"{number}.der").write_bytes(b"")
    certificate, _ = make_certificate(tmp_path, "one-more")
    assert "is full" in folder.refusal(certificate.read_bytes())
    assert len(list(rejected.iterdir())) == MAX_REJECTED_COUNT


async def test_the_private_key_is_this_users_alone(bench: Bench) -> None:
    key = bench.folder / "own" / "key.pem"
    assert key.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize(
    "stray",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"HELF" + b"\xff" * 4,
        b"MSGF" + (1 << 31).to_bytes(4, "little") + b"\0" * 100_000,
        b"\0" * 200_000,
        b"HELF" + (8).to_bytes(4, "little"),
        b"OPNF" + (20).to_bytes(4, "little") + b"\xff" * 12,
    ],
    ids=["http", "length", "endless chunk", "zeros", "empty hello", "no channel"],
)
async def test_bytes_that_are_no_message_end_their_connection_and_nothing_else(
    bench: Bench, vision: Vision, stray: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    # some are waited on for more: as long as one may take to log in
    server = bench.wire._vision._events._server.iserver  # type: ignore[union-attr]
    assert server.max_pending_activation_seconds == MAX_UNNAMED_WALL_S
    monkeypatch.setattr(server, "max_pending_activation_seconds", 0.5)
    address = bench.wire.url.removeprefix("opc.tcp://").partition("/")[0].rpartition(":")
    reader, writer = await asyncio.open_connection(address[0], int(address[2]))
    writer.write(stray)
    with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
        await asyncio.wait_for(reader.readexactly(MAX_CHUNK_BYTES), ANSWER_WALL_S)
    writer.close()
    assert (await vision.state())[0] == "Operational"


async def test_a_client_that_asks_and_does_not_read_is_cut_off(
    bench: Bench, vision: Vision
) -> None:
    clients = bench.wire._vision._events._server.bserver.clients  # type: ignore[union-attr]
    client = await bench.client()
    await client.connect()
    before = len(clients)
    client.uaclient.protocol.transport.pause_reading()
    large = client.get_node(ua.ObjectIds.OpcUa_BinarySchema)  # some hundred kilobytes
    asked = [asyncio.ensure_future(large.read_value()) for _ in range(100)]
    async with asyncio.timeout(ANSWER_WALL_S):
        while len(clients) == before:  # noqa: ASYNC110 - the server has no event for it
            await asyncio.sleep(0.01)
    client.disconnect_socket()
    for one in asked:
        one.cancel()
    await asyncio.gather(*asked, return_exceptions=True)
    assert (await vision.state())[0] == "Operational"


async def test_more_connections_than_the_limit_are_closed_and_those_there_go_on(
    bench: Bench, vision: Vision
) -> None:
    host, _, port = bench.wire.url.removeprefix("opc.tcp://").partition("/")[0].rpartition(":")
    opened = [await asyncio.open_connection(host, int(port)) for _ in range(MAX_CONNECTION_COUNT)]
    closed, _ = await asyncio.wait(
        [asyncio.ensure_future(reader.read(1)) for reader, _ in opened],
        timeout=ANSWER_WALL_S,
        return_when=asyncio.FIRST_COMPLETED,
    )
    assert closed, "the client has one of them"
    assert (await vision.state())[0] == "Operational"
    for _, writer in opened:
        writer.close()


async def test_too_many_failed_log_ins_have_to_wait(bench: Bench, tmp_path: Path) -> None:
    files = make_certificate(tmp_path, "guesser")
    trusted = bench.folder / "trusted" / "guesser.der"
    trusted.write_bytes(files[0].read_bytes())
    for _ in range(5):
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await (await bench.client(files=files, password="guess guess")).connect()
    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        await (await bench.client(files=files)).connect()
    trusted.unlink()
    async with await bench.client() as client:
        await Vision.found(client)


# what clients may not do


async def test_nothing_is_written_and_no_node_added(bench: Bench, vision: Vision) -> None:
    client = vision.client
    for path in (
        "VisionStateMachine/0:CurrentState",
        "SystemState",
        "ConfigurationManagement/ActiveConfiguration",
    ):
        node = await vision.child(path)
        before = await node.read_value()
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await node.write_value(before)
        level = await node.read_attribute(ua.AttributeIds.AccessLevel)
        assert level.Value.Value == ua.AccessLevel.CurrentRead.mask
    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        await client.nodes.objects.add_object(1, "mine")
    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        await client.delete_nodes([vision.node])
    assert bench.plant.told == []


async def test_a_subscription_of_another_session_is_out_of_reach(
    bench: Bench, heard: Heard, vision: Vision
) -> None:
    numbers = list(bench.wire._vision._events._server.iserver.subscription_service.subscriptions)  # type: ignore[union-attr]
    async with await bench.client() as other:
        for code in await other.uaclient.delete_subscriptions(numbers):
            assert code.value == ua.StatusCodes.BadSubscriptionIdInvalid
    await bench.wire.deliver(part_result(1))
    assert (await heard.of(RESULT_READY)).Message.Text.startswith("part 1")


async def test_a_client_is_not_told_faster_than_the_limit(vision: Vision) -> None:
    subscription = await vision.client.create_subscription(1, Heard())
    assert subscription.parameters.RequestedPublishingInterval == MIN_PUBLISHING_MS
    await subscription.delete()


# what is there


async def test_the_nodesets_are_those_that_were_published() -> None:
    # first 16 digits, noted when the files were taken from the package
    known = {
        "MachineVision": "3e67454155a9618e",
        "PackML": "79016b1468d3288d",
        "Di": "40a02d98a8b2a014",
        "Machinery": "1bc4ba9f70d07c51",
        "IA": "8ac55e581540258e",
    }
    assert set(opcua_space.FILES) == set(known)
    for name, digest in known.items():
        data = (opcua_space.FOLDER / f"Opc.Ua.{name}.NodeSet2.xml").read_bytes()
        assert hashlib.sha256(data).hexdigest().startswith(digest), name
        assert b"OPC Foundation MIT License 1.00" in data[:2000]


async def test_the_cell_is_among_the_machines_with_its_identification(vision: Vision) -> None:
    client = vision.client
    machinery = await client.get_namespace_index(opcua_space.MACHINERY)
    devices = await client.get_namespace_index(opcua_space.DEVICES)
    machines = await client.nodes.objects.get_child(f"{machinery}:Machines")
    assert vision.node in await machines.get_children()
    found = {}
    for name in ("Manufacturer", "ProductInstanceUri", "SerialNumber", "SoftwareRevision"):
        node = await vision.child(f"{devices}:Identification/{devices}:{name}")
        found[name] = await node.read_value()
    assert found["ProductInstanceUri"] == "urn:cellctl:cell-3"
    assert found["SerialNumber"] == "cell-3"
    assert found["SoftwareRevision"] == "0.2.0"
    assert found["Manufacturer"].Text == "cellctl"


async def test_the_state_is_told_in_the_words_of_machinery_packml_and_e10(
    bench: Bench, vision: Vision
) -> None:
    machinery = await vision.client.get_namespace_index(opcua_space.MACHINERY)
    item = await vision.child(
        f"{machinery}:MachineryBuildingBlocks/{machinery}:MachineryItemState/0:CurrentState"
    )
    packml = await vision.child("1:PackMLStatus/1:StateCurrent")
    system = await vision.child("SystemState")
    await bench.run(None)
    assert (await item.read_value()).Text == "Executing"
    assert await packml.read_value() == 6
    assert (await system.read_value()).State.name == "PRD_1"
    await bench.become(idle_state(state="left", packml="Aborted", message="a part is in gripper 2"))
    assert (await item.read_value()).Text == "OutOfService"
    assert await packml.read_value() == 9
    found = await system.read_value()
    assert (found.State.name, found.StateDescription) == ("UDT_5", "a part is in gripper 2")


# recipes and configurations


async def recipes(vision: Vision, prepared: int = 2, most: int = 0, first: int = 0) -> list[Any]:
    return await vision.call(
        "RecipeManagement/GetRecipeListFiltered",
        None, None, int32(prepared), uint32(most), uint32(first), int32(0),
    )  # fmt: skip


async def test_recipes_are_listed_with_their_hash_and_what_is_wrong_with_them(
    bench: Bench, vision: Vision
) -> None:
    is_complete, count, _, found, error = await recipes(vision)
    assert (is_complete, count, error) == (True, 3, Refusal.DONE)
    for recipe, offer in zip(found, bench.plant.offers, strict=True):
        assert (recipe.Id, recipe.Hash.hex()) == (offer.key, offer.sha256)
        assert offer.problem in recipe.Description.Text
    assert [one.Id for one in (await recipes(vision, most=1, first=1))[3]] == ["plate"]
    assert (await recipes(vision, most=1))[0] is False
    assert (await recipes(vision, prepared=1))[3] == []
    await prepare(vision, "plate")
    assert [one.Id for one in (await recipes(vision, prepared=1))[3]] == ["plate"]


async def test_a_recipe_that_is_unknown_broken_or_of_another_hash_is_not_prepared(
    vision: Vision, heard: Heard
) -> None:
    assert (await prepare(vision, "no such"))[2] == Refusal.UNKNOWN
    assert (await prepare(vision, "broken"))[2] == Refusal.REFUSED
    assert "unknown key" in (await heard.of(INFORMATION)).Message.Text or heard.all
    other = ua.RecipeIdInternalDataType(Id="holder", Hash=b"\0" * 32)
    done = await vision.call("RecipeManagement/PrepareRecipe", None, other)
    assert done[2] == Refusal.UNKNOWN
    assert await vision.state() == ("Operational", "Initialized")


async def test_a_prepared_recipe_makes_ready_and_an_unprepared_one_initialized(
    vision: Vision, heard: Heard
) -> None:
    internal, is_completed, error = await prepare(vision)
    assert (internal.Id, is_completed, error) == ("holder", True, Refusal.DONE)
    assert (await heard.of(RECIPE_PREPARED)).InternalId.Id == "holder"
    changed = await heard.of(STATE_CHANGED)
    assert (changed.FromState.Text, changed.ToState.Text) == ("Initialized", "Ready")
    assert changed.Transition.Text == "InitializedToReadyRecipe"
    assert await vision.state() == ("Operational", "Ready")
    node = await vision.child(f"{AUTOMATIC}/0:LastTransition/0:Number")
    assert await node.read_value() == 561
    done = await vision.call(
        "RecipeManagement/UnprepareRecipe", ua.RecipeIdExternalDataType(Id="holder"), None
    )
    assert done[1] == Refusal.DONE
    assert await vision.state() == ("Operational", "Initialized")


async def test_the_configuration_is_the_cell_file_by_its_hash(bench: Bench, vision: Vision) -> None:
    on = "ConfigurationManagement"
    listed = await vision.call(f"{on}/GetConfigurationList", uint32(0), uint32(0), int32(0))
    own = listed[3][0].InternalId
    assert (own.Id, own.Hash.hex()) == ("cell-3", bench.plant.cell_file_sha256)
    active = await (await vision.child(f"{on}/ActiveConfiguration")).read_value()
    assert active.InternalId == own
    found = await vision.call(f"{on}/GetConfigurationById", own, int32(0))
    assert (found[1].InternalId, found[2]) == (own, Refusal.DONE)
    assert await vision.call(f"{on}/ActivateConfiguration", own) == Refusal.DONE
    own.Hash = b"\0" * 32
    assert await vision.call(f"{on}/ActivateConfiguration", own) == Refusal.UNKNOWN


# jobs


async def test_a_job_is_an_order_of_one_part_with_its_serial_number(
    bench: Bench, vision: Vision, heard: Heard
) -> None:
    await prepare(vision)
    job, error = await start(vision)
    assert (job.Id, error) == ("PO-1", Refusal.DONE)
    assert await vision.state() == ("Operational", "SingleExecution")
    order = await bench.plant.order_of("PO-1")
    assert (order.request.recipe, order.request.serials) == ("holder", ("SN-1",))
    assert order.source == "mes by OPC UA"
    assert (await heard.of(JOB_STARTED)).JobId.Id == "PO-1"
    bench.plant.change_order("PO-1", state="running")
    await bench.run("PO-1")
    result = bench.plant.finish(part_result(1, order="PO-1", serial="SN-1"))
    await bench.wire.deliver(result)
    ready = await heard.of(RESULT_READY)
    assert ready.ResultId.Id == f"{RUN}/1/1"
    assert (ready.PartId.Id, ready.JobId.Id, ready.MeasId.Id) == ("SN-1", "PO-1", "PO-1")
    assert (ready.IsSimulated, ready.IsPartial, ready.ResultState) == (True, False, 1)
    own = json.loads(result.model_dump_json(by_alias=True))
    content = plain(ready.ResultContent)
    assert json.loads(content[0]) == own
    assert content[1:] == [result.verdict, result.compared_fraction]
    await bench.run("PO-1", state="complete", packml="Complete")
    assert await vision.state() == ("Operational", "Ready")
    assert (await heard.of(READY)).JobId.Id == "PO-1"
    await bench.become(idle_state())
    bench.plant.change_order("PO-1", state="done")
    assert await vision.state() == ("Operational", "Ready"), "the job is shown once"


async def test_events_come_at_the_server_as_well_and_as_the_same(
    bench: Bench, vision: Vision, heard: Heard
) -> None:
    at_server = Heard()
    client = vision.client
    subscription = await client.create_subscription(MIN_PUBLISHING_MS, at_server)
    types = [client.get_node(ua.NodeId(RESULT_READY, vision.namespace))]
    await subscription.subscribe_events(client.nodes.server, types)
    await bench.wire.deliver(part_result(1))
    first, second = await heard.of(RESULT_READY), await at_server.of(RESULT_READY)
    assert first.EventId == second.EventId
    assert first.SourceNode == second.SourceNode == vision.node.nodeid
    await subscription.delete()


async def test_a_job_needs_a_prepared_recipe_and_the_one_that_was_prepared(
    bench: Bench, vision: Vision
) -> None:
    assert (await start(vision))[1] == Refusal.STATE
    await prepare(vision)
    assert (await start(vision, recipe="plate"))[1] == Refusal.STATE
    offers = bench.plant.offers
    try:
        bench.plant.offers = (Offer("holder", "holder", "99" * 32, 3, ""), *offers[1:])
        assert (await start(vision))[1] == Refusal.STATE
    finally:
        bench.plant.offers = offers
    assert bench.plant.told == []
    assert (await start(vision, recipe="holder"))[1] == Refusal.DONE


async def test_a_measurement_id_starts_one_job(bench: Bench, vision: Vision) -> None:
    await prepare(vision)
    assert (await start(vision))[1] == Refusal.DONE
    assert (await start(vision))[1] == Refusal.STATE, "one is running"
    bench.plant.change_order("PO-1", state="running")
    await bench.run("PO-1")
    bench.plant.change_order("PO-1", state="done")
    await bench.become(idle_state())
    assert (await start(vision))[1] == Refusal.ARGUMENT, "a replayed call"
    orders = [one for one in bench.plant.told if one[0] == "order"]
    assert len(orders) == 1
    job, error = await start(vision, meas="")
    assert error == Refusal.DONE
    assert job.Id.startswith("opcua-")


async def test_a_call_that_waits_holds_up_nothing_else_of_its_client(
    bench: Bench, vision: Vision, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_go_on = asyncio.Event()
    offers = bench.plant.offers

    async def slow() -> Any:
        await may_go_on.wait()
        return offers

    monkeypatch.setattr(bench.plant, "recipes", slow)
    waiting = [asyncio.create_task(recipes(vision)) for _ in range(MAX_CALL_COUNT)]
    assert (await vision.state())[0] == "Operational"
    with pytest.raises(ua.uaerrors.BadTooManyOperations):
        await recipes(vision)
    may_go_on.set()
    assert [answer[1] for answer in await asyncio.gather(*waiting)] == [3] * MAX_CALL_COUNT


async def test_an_order_that_the_cell_refuses_leaves_the_machine_ready_and_says_why(
    bench: Bench, vision: Vision, heard: Heard
) -> None:
    await prepare(vision)
    await bench.become(idle_state(may_start="never"))
    job, error = await start(vision)
    assert (job.Id, error) == ("", Refusal.REFUSED)
    assert "orders of a plant" in (await heard.of(INFORMATION)).Message.Text
    assert await vision.state() == ("Operational", "Ready")


async def test_a_job_that_waits_for_a_person_has_not_begun_and_is_taken_back_by_stop(
    bench: Bench, vision: Vision, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = bench.plant.order

    async def asked(number: str, request: Any, source: str) -> Any:
        await taken(number, request, source)
        return bench.plant.change_order(number, state="asked", reason="a person releases it")

    monkeypatch.setattr(bench.plant, "order", asked)
    await prepare(vision)
    job, error = await start(vision)
    assert (job.Id, error) == ("PO-1", Refusal.DONE)
    assert await vision.state() == ("Operational", "Ready")
    assert await stop(vision) == Refusal.DONE
    assert bench.plant.told[-1] == ("withdraw", "PO-1", "mes by OPC UA")


async def test_many_parts_are_a_continuous_job(bench: Bench, vision: Vision) -> None:
    await prepare(vision)

    async def many(meas: str, *parameters: Any) -> Any:
        return await vision.call(
            f"{AUTOMATIC}/StartContinuous",
            ua.MeasIdDataType(Id=meas), None, None, None, no_parameters(*parameters),
        )  # fmt: skip

    assert (await many("PO-0", "many"))[1] == Refusal.ARGUMENT
    assert (await many("PO-0", -5))[1] == Refusal.ARGUMENT
    assert (await many("PO-0", 10**9))[1] == Refusal.ARGUMENT
    assert (await many("PO-2", 12))[1] == Refusal.DONE
    assert (await bench.plant.order_of("PO-2")).request.quantity == 12
    assert await vision.state() == ("Operational", "ContinuousExecution")


@pytest.mark.parametrize("serial", ["SN\n1", "x" * 81])
async def test_a_serial_number_that_cannot_be_kept_is_refused(
    bench: Bench, vision: Vision, serial: str
) -> None:
    await prepare(vision)
    assert (await start(vision, serial=serial))[1] == Refusal.ARGUMENT
    assert bench.plant.told == []


@pytest.mark.parametrize(("method", "number"), [("Stop", 761), ("Abort", 762)])
async def test_a_job_is_stopped_midway(
    bench: Bench, vision: Vision, method: str, number: int
) -> None:
    await prepare(vision)
    await start(vision)
    bench.plant.change_order("PO-1", state="running")
    await bench.run("PO-1")
    assert await stop(vision, method) == Refusal.DONE
    assert bench.plant.told[-1] == (method.lower(), "shift ends (cause 7)", "mes by OPC UA")
    assert await vision.state() == ("Operational", "Ready")
    node = await vision.child(f"{AUTOMATIC}/0:LastTransition/0:Number")
    assert await node.read_value() == number


async def test_nothing_is_stopped_where_nothing_runs(bench: Bench, vision: Vision) -> None:
    assert await stop(vision) == Refusal.STATE
    await prepare(vision)
    assert await stop(vision) == Refusal.STATE
    assert bench.plant.told == []


async def test_halt_stops_and_refuses_starts_until_reset_also_in_another_life_of_the_bridge(
    bench: Bench, vision: Vision
) -> None:
    await prepare(vision)
    await start(vision)
    bench.plant.change_order("PO-1", state="running")
    await bench.run("PO-1")
    halted = await vision.call("VisionStateMachine/Halt", int32(1), "cleaning")
    assert halted == Refusal.DONE
    assert bench.plant.told[-1][0] == "stop"
    assert await vision.state() == ("Halted", None)
    bench.plant.change_order("PO-1", state="stopped")
    await bench.become(idle_state())
    assert await vision.state() == ("Halted", None)
    assert (await start(vision, meas="PO-2"))[1] == Refusal.STATE
    assert json.loads((bench.folder / "kept.json").read_text())["is_halted"] is True
    assert await vision.call("VisionStateMachine/Reset", int32(1), "clean") == Refusal.DONE
    assert await vision.state() == ("Operational", "Initialized")


async def test_an_error_of_the_cell_is_left_by_a_person_alone(
    bench: Bench, vision: Vision, heard: Heard
) -> None:
    await prepare(vision)
    await bench.become(idle_state(state="left", packml="Aborted", message="a part is in gripper 2"))
    assert await vision.state() == ("Error", None)
    assert (await heard.of(ERROR)).Message.Text == "a part is in gripper 2"
    assert await vision.call("VisionStateMachine/Reset", int32(1), "") == Refusal.REFUSED
    assert (await start(vision))[1] == Refusal.STATE
    assert await vision.state() == ("Error", None)
    await bench.become(idle_state())
    assert await vision.state() == ("Operational", "Ready")
    await heard.of(RESOLVED)


async def test_an_alarm_is_told(bench: Bench, heard: Heard) -> None:
    await bench.wire.deliver(alarm_notice())
    message = (await heard.of(INFORMATION)).Message.Text
    assert message == "alarm 201 estop raised: the emergency stop is pressed"


# results


async def result_by_id(vision: Vision, said: str) -> list[Any]:
    return await vision.call(
        "ResultManagement/GetResultById", ua.ResultIdDataType(Id=said), int32(0)
    )


async def test_a_result_is_found_by_its_id_and_the_last_revision_without_one(
    bench: Bench, vision: Vision
) -> None:
    first = bench.plant.finish(part_result(1))
    second = bench.plant.finish(part_result(1, revision=2, seq=200, disposition="reject"))
    for said, own in (("/1/1", first), ("/1/2", second), ("/1", second)):
        _, found, error = await result_by_id(vision, RUN + said)
        assert error == Refusal.DONE
        assert found.ResultId.Id == f"{RUN}/1/{own.revision}"
        content = json.loads(plain(found.ResultContent)[0])
        assert content == json.loads(own.model_dump_json(by_alias=True))
        assert found.InternalRecipeId.Hash.hex() == own.recipe_sha256
        assert (found.CreationTime, found.ProcessingTimes.StartTime) == (own.ended, own.begun)
    components = await vision.call(
        "ResultManagement/GetResultComponentsById", ua.ResultIdDataType(Id=f"{RUN}/1/1"), int32(0)
    )
    assert components[-1] == Refusal.DONE
    assert json.loads(plain(components[15])[0])["revision"] == 1


@pytest.mark.parametrize("said", ["", "x", f"{RUN}/2/1", f"{RUN}/1/9", f"{RUN}/-1/1", "a/b/c/d"])
async def test_a_result_that_is_not_there_is_unknown(
    bench: Bench, vision: Vision, said: str
) -> None:
    bench.plant.finish(part_result(1))
    assert (await result_by_id(vision, said))[2] == Refusal.UNKNOWN


async def test_a_part_that_fails_is_a_completed_result_and_one_without_a_verdict_a_failed(
    bench: Bench, vision: Vision
) -> None:
    bench.plant.finish(part_result(1, verdict="fail"))
    bench.plant.finish(part_result(2, verdict="no verdict", compared_fraction=None))
    assert (await result_by_id(vision, f"{RUN}/1/1"))[1].ResultState == 1
    found = (await result_by_id(vision, f"{RUN}/2/1"))[1]
    assert found.ResultState == 4
    assert plain(found.ResultContent)[2] is None


async def results(vision: Vision, *, most: int = 0, first: int = 0, **wanted: Any) -> list[Any]:
    names = (
        "MeasId", "PartId", "ExternalRecipeId", "InternalRecipeId", "ExternalConfigurationId",
        "InternalConfigurationId", "ProductId", "JobId",
    )  # fmt: skip
    return await vision.call(
        "ResultManagement/GetResultListFiltered",
        int32(wanted.get("ResultState", 0)), *(wanted.get(name) for name in names),
        uint32(most), uint32(first), int32(0),
    )  # fmt: skip


async def test_results_are_listed_by_what_narrows_them_and_page_by_page(
    bench: Bench, vision: Vision
) -> None:
    for part in range(1, 8):
        verdict = "no verdict" if part == 4 else "pass"
        bench.plant.finish(part_result(part, verdict=verdict, order=f"PO-{part % 2}"))
    is_complete, count, _, found, error = await results(vision)
    assert (is_complete, count, error) == (True, 7, Refusal.DONE)
    assert [one.PartId.Id for one in found] == [f"SN-{part:04}" for part in range(1, 8)]
    assert all(one.ResultContent is None for one in found)
    page = await results(vision, most=2, first=5)
    assert (page[0], [one.PartId.Id for one in page[3]]) == (True, ["SN-0006", "SN-0007"])
    assert (await results(vision, most=2))[0] is False

    async def parts(**wanted: Any) -> list[int]:
        return [int(one.ResultId.Id.split("/")[1]) for one in (await results(vision, **wanted))[3]]

    assert await parts(PartId=ua.PartIdDataType(Id="SN-0003")) == [3]
    assert await parts(JobId=ua.JobIdDataType(Id="PO-0")) == [2, 4, 6]
    assert await parts(MeasId=ua.MeasIdDataType(Id="PO-0"), ResultState=1) == [2, 6]
    assert await parts(ResultState=4) == [4]
    assert await parts(ExternalRecipeId=ua.RecipeIdExternalDataType(Id="plate")) == []


# calls that are no calls


async def test_a_call_with_wrong_arguments_is_refused_before_anything_is_done(
    bench: Bench, vision: Vision
) -> None:
    on = await vision.child(AUTOMATIC)
    method = f"{vision.namespace}:Stop"
    for arguments in ((), (int32(1),), (int32(1), "a", "b"), ("a", "b"), (int32(1), int32(1))):
        with pytest.raises(ua.UaStatusCodeError):
            await on.call_method(method, *arguments)
    with pytest.raises(ua.uaerrors.BadInvalidArgument):
        await vision.call(
            f"{AUTOMATIC}/StartSingleJob",
            ua.PartIdDataType(Id="x"), None, None, None, no_parameters(),
        )  # fmt: skip
    assert bench.plant.told == []


async def test_a_notice_is_kept_while_the_server_is_not_up(tmp_path: Path) -> None:
    with pytest.raises(ConnectionError):
        await Bench(tmp_path).wire.deliver(part_result(1))
