"""The edge node by the rules of Sparkplug 3.0.0; a test has the name of the rule, `tck-id-...`.

Read back here with our own decoder; `test_sparkplug_stranger.py` has one that nobody here wrote.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

pytest.importorskip("aiomqtt", reason="the extra `mqtt` is not installed")

from fake_plant import AT, alarm_notice, idle_state, part_result
from hypothesis import example, given
from hypothesis import strategies as st

from controller.plant.wires.mqtt.node import (
    ALIASES,
    METRICS,
    EdgeNode,
    as_ms,
    notice_values,
    state_values,
)
from controller.plant.wires.mqtt.payload import (
    MAX_METRICS,
    DataType,
    Metric,
    PayloadError,
    SparkplugPayload,
    Value,
    decode,
    encode,
)

GOLDEN = tomllib.loads(
    (Path(__file__).parents[1] / "golden" / "sparkplug.toml").read_text(encoding="utf-8")
)
NOW = as_ms(AT)


@pytest.fixture
def node() -> EdgeNode:
    one = EdgeNode("plant", "cell-3", "vision")
    one.note(state_values(idle_state()), NOW)
    return one


def next_data(node: EdgeNode, part: int, *, is_historical: bool = False) -> SparkplugPayload:
    node.note(notice_values(part_result(part)), NOW + part)
    message = node.data(NOW + part, is_historical=is_historical)
    assert message is not None
    assert message.topic == "spBv1.0/plant/DDATA/cell-3/vision"
    return decode(message.payload)


def command(*metrics: Metric) -> bytes:
    return encode(SparkplugPayload(NOW, None, metrics))


def rebirth(*, value: bool = True) -> bytes:
    return command(Metric("Node Control/Rebirth", None, NOW, DataType.BOOLEAN, value))


def test_tck_id_payloads_ndeath_seq_and_bdseq(node: EdgeNode) -> None:
    will = node.connect()
    found = decode(will.payload)
    assert will.topic == "spBv1.0/plant/NDEATH/cell-3"
    assert found.seq is None
    assert [(one.name, one.kind, one.value) for one in found.metrics] == [
        ("bdSeq", DataType.INT64, 0)
    ]


def test_tck_id_payloads_ndeath_will_message_qos_and_retain(node: EdgeNode) -> None:
    will = node.connect()
    assert (will.qos, will.is_retained) == (1, False)


def test_tck_id_topics_nbirth_bdseq_increment_on_every_connect_and_back_to_zero(
    node: EdgeNode,
) -> None:
    numbers = [decode(node.connect().payload).metrics[0].value for _ in range(258)]
    assert numbers == [*range(256), 0, 1]


def test_tck_id_topics_nbirth_bdseq_matching_the_will(node: EdgeNode) -> None:
    for _ in range(3):
        will = decode(node.connect().payload)
        birth = decode(node.births(NOW)[0].payload)
        assert birth.metrics[0].value == will.metrics[0].value
        assert (birth.metrics[0].name, birth.metrics[0].kind) == ("bdSeq", DataType.INT64)


def test_tck_id_payloads_nbirth_seq_timestamp_qos_and_retain(node: EdgeNode) -> None:
    node.connect()
    message, _ = node.births(NOW)
    found = decode(message.payload)
    assert message.topic == "spBv1.0/plant/NBIRTH/cell-3"
    assert (found.seq, found.at_ms, message.qos, message.is_retained) == (0, NOW, 0, False)


def test_tck_id_topics_nbirth_rebirth_metric_false_and_without_alias(node: EdgeNode) -> None:
    # tck-id-operational-behavior-data-commands-rebirth-name-aliases
    node.connect()
    found = decode(node.births(NOW)[0].payload)
    (metric,) = (one for one in found.metrics if one.name == "Node Control/Rebirth")
    assert (metric.kind, metric.value, metric.alias) == (DataType.BOOLEAN, False, None)


def test_tck_id_payloads_dbirth_order_seq_qos_and_retain(node: EdgeNode) -> None:
    node.connect()
    first, second = node.births(NOW)
    assert ["NBIRTH" in first.topic, second.topic] == [True, "spBv1.0/plant/DBIRTH/cell-3/vision"]
    assert (decode(second.payload).seq, second.qos, second.is_retained) == (1, 0, False)


def test_tck_id_topics_dbirth_metric_reqs_every_metric_it_will_ever_report_on(
    node: EdgeNode,
) -> None:
    node.connect()
    found = decode(node.births(NOW)[1].payload)
    values = {
        **state_values(idle_state()),
        **notice_values(part_result()),
        **notice_values(alarm_notice()),
    }
    assert {one.name for one in found.metrics} == {*values, "Properties/Software"}
    # tck-id-payloads-metric-datatype-req, tck-id-payloads-name-birth-data-requirement
    assert all(one.kind is not None and one.at_ms for one in found.metrics)
    by_name = {one.name: one.value for one in found.metrics}
    assert (by_name["State"], by_name["Ready"], by_name["Part/Json"]) == ("free", True, None)


def test_tck_id_case_sensitivity_metric_names() -> None:
    assert len({name.lower() for name in METRICS}) == len(METRICS)


def test_tck_id_payloads_alias_uniqueness_and_birth_requirement(node: EdgeNode) -> None:
    node.connect()
    metrics = [one for message in node.births(NOW) for one in decode(message.payload).metrics]
    aliases = [one.alias for one in metrics if one.name != "Node Control/Rebirth"]
    assert None not in aliases
    assert len(set(aliases)) == len(aliases)


def test_tck_id_payloads_alias_data_cmd_requirement(node: EdgeNode) -> None:
    node.connect()
    node.births(NOW)
    found = next_data(node, 1)
    assert all(one.name is None and one.alias is not None for one in found.metrics)
    assert all(one.at_ms == NOW + 1 for one in found.metrics)


def test_tck_id_payloads_sequence_num_incrementing_and_zero_after_255(node: EdgeNode) -> None:
    node.connect()
    births = [decode(message.payload).seq for message in node.births(NOW)]
    numbers = [next_data(node, part).seq for part in range(1, 300)]
    assert births + numbers == [place % 256 for place in range(301)]


def test_tck_id_payloads_ddata_qos_and_retain(node: EdgeNode) -> None:
    node.connect()
    node.births(NOW)
    node.note({"State": "execute_presenting"}, NOW)
    message = node.data(NOW)
    assert message is not None
    assert (message.qos, message.is_retained) == (0, False)


def test_tck_id_topics_ddata_payload_changed_metrics_alone(node: EdgeNode) -> None:
    node.connect()
    node.births(NOW)
    assert node.data(NOW) is None
    node.note({**state_values(idle_state()), "Ready": False}, NOW + 5)
    message = node.data(NOW + 5)
    assert message is not None
    (metric,) = decode(message.payload).metrics
    assert (metric.alias, metric.value) == (ALIASES["Ready"], False)
    assert node.data(NOW + 6) is None


def test_tck_id_operational_behavior_data_commands_rebirth_action_3_same_bdseq_and_seq_zero(
    node: EdgeNode,
) -> None:
    node.connect()
    node.connect()
    before = decode(node.births(NOW)[0].payload)
    next_data(node, 1)
    assert node.is_rebirth(rebirth())
    after = [decode(message.payload) for message in node.births(NOW)]
    assert after[0].metrics[0].value == before.metrics[0].value == 1
    assert [one.seq for one in after] == [0, 1]
    by_name = {one.name: one.value for one in after[1].metrics}
    assert by_name["Part/Serial"] == "SN-0001"  # what was told since is in the births


@pytest.mark.parametrize(
    "payload",
    [
        rebirth(value=False),
        command(Metric("Node Control/Reboot", None, NOW, DataType.BOOLEAN, value=True)),
        command(Metric("Device Control/Start", None, NOW, DataType.BOOLEAN, value=True)),
        command(Metric("Node Control/Rebirth", None, NOW, DataType.INT32, 1)),
        command(Metric(None, ALIASES["State"], NOW, DataType.STRING, "execute")),
        command(),
        b"",
        b"true",
        b"\xff" * 40,
        rebirth()[:-1],
        rebirth() * 101,
        b"\x12" + b"\xff" * 9 + b"\x01",
        rebirth() + b"\x12\x80\x80\x80\x80\x40",
        b"x" * 100_000,
    ],
)
def test_no_other_command_does_anything(node: EdgeNode, payload: bytes) -> None:
    assert not node.is_rebirth(payload)


def test_data_that_a_newer_result_follows_are_historical(node: EdgeNode) -> None:
    node.connect()
    node.births(NOW)
    assert all(one.is_historical for one in next_data(node, 1, is_historical=True).metrics)
    assert not any(one.is_historical for one in next_data(node, 2).metrics)


VALUES = st.one_of(
    st.tuples(st.just(DataType.INT32), st.integers(-(2**31), 2**31 - 1)),
    st.tuples(st.just(DataType.INT64), st.integers(-(2**63), 2**63 - 1)),
    st.tuples(st.just(DataType.DATE_TIME), st.integers(0, 2**63 - 1)),
    st.tuples(st.just(DataType.DOUBLE), st.floats(allow_nan=False)),
    st.tuples(st.just(DataType.BOOLEAN), st.booleans()),
    st.tuples(st.just(DataType.STRING), st.text()),
    st.tuples(st.sampled_from(DataType), st.none()),
)
UINT64 = st.integers(0, 2**64 - 1)


@given(
    st.lists(st.tuples(st.none() | st.text(), st.none() | UINT64, VALUES, st.booleans())),
    st.none() | UINT64,
    st.none() | UINT64,
)
def test_what_is_encoded_is_decoded_again(
    rows: list[tuple[str | None, int | None, tuple[DataType, Value], bool]],
    at_ms: int | None,
    seq: int | None,
) -> None:
    metrics = tuple(
        Metric(name, alias, at_ms, kind, value, is_historical)
        for name, alias, (kind, value), is_historical in rows
    )
    payload = SparkplugPayload(at_ms, seq, metrics)
    assert decode(encode(payload)) == payload


@given(st.binary(max_size=300))
@example(rebirth())
def test_no_bytes_from_outside_end_in_anything_but_a_payload_or_an_error(data: bytes) -> None:
    try:
        found = decode(data)
    except PayloadError:
        return
    assert len(found.metrics) <= MAX_METRICS


@pytest.mark.parametrize("name", sorted(GOLDEN["payload"]))
def test_payloads_of_a_stranger_are_read_as_they_were_meant(name: str) -> None:
    golden = GOLDEN["payload"][name]
    found = decode(bytes.fromhex(golden["bytes"]))
    assert (found.at_ms, found.seq) == (golden["timestamp"], golden.get("seq"))
    assert [
        (one.name, one.alias, one.kind.name if one.kind else None, one.value)
        for one in found.metrics
    ] == [
        (one.get("name"), one.get("alias"), one.get("datatype"), one.get("value"))
        for one in golden["metrics"]
    ]
