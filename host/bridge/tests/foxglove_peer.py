"""A client of Foxglove's WebSocket that shares no code with the server. Prints what it saw as JSON when the run ends.

Arguments: the address; with a second argument, `stall`, it subscribes to everything and then reads nothing until its
standard input ends.
"""

import base64
import json
import os
import socket
import struct
import sys

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

PROTOCOL = "foxglove.sdk.v1"


def subscribe(client, channels):
    ids = [{"id": 100 + channel["id"], "channelId": channel["id"]} for channel in channels]
    client.send(json.dumps({"op": "subscribe", "subscriptions": ids}))


def greeting(client):
    """The server's information and its channels, by their subscriptions."""
    info = json.loads(client.recv(timeout=30))
    assert info["op"] == "serverInfo", info
    advertised = json.loads(client.recv(timeout=30))
    assert advertised["op"] == "advertise", advertised
    return info, {100 + channel["id"]: channel for channel in advertised["channels"]}


def schema_bytes(channel):
    text = channel["schema"]
    return base64.b64decode(text) if channel["encoding"] == "protobuf" else text.encode()


def reader(channel):
    """Reads messages by the schema that the channel names."""
    if channel["encoding"] == "json":
        return json.loads
    files = descriptor_pb2.FileDescriptorSet.FromString(schema_bytes(channel))
    pool = descriptor_pool.DescriptorPool()
    waiting = {file.name: file for file in files.file}

    def add(name):
        file = waiting.pop(name, None)
        if file is not None:
            for needed in file.dependency:
                add(needed)
            pool.Add(file)

    for name in list(waiting):
        add(name)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"])).FromString


def body(topic, message):
    """What the test wants of a message."""
    if topic.endswith("/status"):
        return message
    if topic.endswith("/events"):
        return {"message": message.message, "level": message.level}
    stamp = message.timestamp.seconds * 10**9 + message.timestamp.nanos
    if topic.endswith("/force_map"):
        assert [(f.name, f.offset) for f in message.fields] == [("fx", 0), ("fy", 4), ("fz", 8)]
        cells = list(struct.iter_unpack("<fff", message.data))
        return {"stamp": stamp, "cells": len(cells), "sum": [sum(axis) for axis in zip(*cells)]}
    grey = message.data
    return {
        "stamp": stamp,
        "encoding": message.encoding,
        "size": [message.width, message.height, message.step, len(grey)],
        "mean": sum(grey) / len(grey),
    }


def read(uri):
    with connect(uri, subprotocols=[PROTOCOL], max_size=None, compression=None, proxy=None) as client:
        assert client.subprotocol == PROTOCOL, client.subprotocol
        info, channels = greeting(client)
        readers = {number: reader(channel) for number, channel in channels.items()}
        seen = {channel["topic"]: [] for channel in channels.values()}
        subscribe(client, channels.values())
        raw = []
        try:
            for frame in client:
                if isinstance(frame, bytes):
                    raw.append(frame)
        except ConnectionClosed:
            pass
    # Only now, so that a slow test machine does not make a slow client.
    for frame in raw:
        kind, number, time_ns = struct.unpack_from("<BIQ", frame)
        assert kind == 1, frame[:20]
        topic = channels[number]["topic"]
        seen[topic].append([time_ns, body(topic, readers[number](frame[13:]))])
    told = [
        {
            "topic": channel["topic"],
            "encoding": channel["encoding"],
            "schema_name": channel["schemaName"],
            "schema": list(schema_bytes(channel)),
        }
        for channel in channels.values()
    ]
    print(json.dumps({"info": info, "channels": told, "seen": seen}))


def stall(address):
    host, port = address.rsplit(":", 1)
    small = socket.socket()
    small.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    small.connect((host, int(port)))
    # A queue of one: then the library stops reading.
    client = connect(
        f"ws://{address}", sock=small, subprotocols=[PROTOCOL], max_size=None, max_queue=1, compression=None, proxy=None
    )
    _, channels = greeting(client)
    subscribe(client, channels.values())
    print("{}", flush=True)
    sys.stdin.read()
    # It is not polite either.
    small.close()
    os._exit(0)


if len(sys.argv) > 2:
    stall(sys.argv[1])
else:
    read(f"ws://{sys.argv[1]}")
