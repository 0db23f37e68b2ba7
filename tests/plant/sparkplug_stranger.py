"""A host that nobody here wrote: pysparkplug reads all that the node says, a JSON object a line.

``PYTHON sparkplug_stranger.py PORT``, in an environment of its own: pysparkplug pins an old paho. A
line ``rebirth GROUP NODE`` on standard input asks a node for its births.
"""

import json
import sys

import pysparkplug
from paho.mqtt.client import Client, MQTTMessage

births = {}


def told(_client: Client, _userdata: object, message: MQTTMessage) -> None:
    if "/STATE/" in message.topic:
        return
    # aliases of node and device are kept apart here, and unique in both
    kind = message.topic.split("/")[2]
    birth = births.get("DBIRTH" if kind.startswith("D") else "NBIRTH")
    found = pysparkplug.Message.from_mqtt_message(message, birth=birth)
    payload = found.payload
    if kind in ("NBIRTH", "DBIRTH"):
        births[kind] = payload
    metrics = [payload.bd_seq_metric] if kind == "NDEATH" else payload.metrics
    line = {
        "kind": kind,
        "topic": message.topic,
        "qos": message.qos,
        "retain": bool(message.retain),
        "seq": getattr(payload, "seq", None),
        "timestamp": payload.timestamp,
        "metrics": {one.name: None if one.is_null else one.value for one in metrics},
        "historical": any(one.is_historical for one in metrics),
    }
    sys.stdout.write(json.dumps(line, default=str) + "\n")
    sys.stdout.flush()


client = Client("sparkplug-stranger")
client.on_message = told
client.on_connect = lambda *_: client.subscribe("spBv1.0/#", 1)
client.connect("127.0.0.1", int(sys.argv[1]))
client.loop_start()
for order in sys.stdin:
    _, group, node = order.split()
    metric = pysparkplug.Metric(
        timestamp=pysparkplug.get_current_timestamp(),
        name="Node Control/Rebirth",
        datatype=pysparkplug.DataType.BOOLEAN,
        value=True,
    )
    command = pysparkplug.NCmd(timestamp=pysparkplug.get_current_timestamp(), metrics=(metric,))
    client.publish(f"spBv1.0/{group}/NCMD/{node}", command.encode(include_dtypes=True))
