"""Prints every message of an MCAP file as a line of JSON; of bytes the first two, as hexadecimal digits."""

import json
import sys

from google.protobuf.json_format import MessageToDict
from google.protobuf.message import Message
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2


def plain(value):
    if isinstance(value, Message):
        fields = MessageToDict(value, preserving_proto_field_name=True)
        if "data" in fields:
            fields["data"] = value.data[:2].hex()
        return fields
    if hasattr(value, "__slots__"):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, (list, tuple)) or type(value).__name__ == "array":
        return [plain(one) for one in value]
    return value


with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[Protobuf(), Ros2()])
    for schema, channel, message, decoded in reader.iter_decoded_messages():
        assert schema.name.split("/")[-1].split(".")[-1] == type(decoded).__name__.split(".")[-1].split("/")[-1], schema
        print(json.dumps({"topic": channel.topic, "time_ns": message.log_time, "message": plain(decoded)}))
