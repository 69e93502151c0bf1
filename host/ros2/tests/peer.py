"""The other end of the tests: another implementation of DDS (Eclipse Cyclone DDS), on this machine only.

One argument, a job as JSON; one line of JSON on standard output.
"""

import json
import os
import random
import select
import socket
import sys
import time
from dataclasses import asdict, dataclass
from types import new_class

# Before Cyclone is loaded: 127.0.0.1 only, no multicast, peers by their well-known ports.
os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.idl import IdlStruct  # noqa: E402
from cyclonedds.idl.types import array, float64, int32, sequence, uint8, uint16, uint32, uint64  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402

PATIENCE_S = 60


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


@dataclass
class Image(IdlStruct, typename="sensor_msgs::msg::dds_::Image_"):
    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: sequence[uint8]


@dataclass
class Slip(IdlStruct, typename="gripline_msgs::msg::dds_::Slip_"):
    header: Header
    fingertip: uint8
    frame: uint64
    state: uint8
    slip_evidence: float64
    stick_ratio: float64
    contact: uint16
    stick: uint16
    witness_stick_ratio: float64
    witness_unrest: float64
    witness_shear_follows: float64
    witness_motion: float64
    time_to_slip: float64
    line: float64
    health: sequence[str]
    faults: sequence[str]


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class ControlRequest(IdlStruct, typename="gripline_msgs::srv::dds_::Control_Request_"):
    client: str
    request: uint64
    take_over: bool


@dataclass
class SetFloorRequest(IdlStruct, typename="gripline_msgs::srv::dds_::SetFloor_Request_"):
    client: str
    request: uint64
    take_over: bool
    floor: float64


@dataclass
class Response(IdlStruct, typename="gripline_msgs::srv::dds_::Control_Response_"):
    done: bool
    why: str
    message: str
    owner: str
    took: float64
    client: str
    request: uint64


# What rmw_cyclonedds_cpp puts before a request and its response: the lower half of the client's identity, the number.
@dataclass
class CycloneControlRequest(IdlStruct, typename="gripline_msgs::srv::dds_::Control_Request_"):
    half: array[uint8, 8]
    number_high: int32
    number_low: uint32
    client: str
    request: uint64
    take_over: bool


@dataclass
class CycloneSetFloorRequest(IdlStruct, typename="gripline_msgs::srv::dds_::SetFloor_Request_"):
    half: array[uint8, 8]
    number_high: int32
    number_low: uint32
    client: str
    request: uint64
    take_over: bool
    floor: float64


@dataclass
class CycloneResponse(IdlStruct, typename="gripline_msgs::srv::dds_::Control_Response_"):
    half: array[uint8, 8]
    number_high: int32
    number_low: uint32
    done: bool
    why: str
    message: str
    owner: str
    took: float64
    client: str
    request: uint64


def struct(name, typename, fields):
    """A type by its fields."""
    return dataclass(new_class(name, (IdlStruct,), {"typename": typename}, lambda body: body.update(__annotations__=fields)))


def named(cls, kind):
    """The same fields under the type's name of another service."""
    return struct(cls.__name__ + kind, f"gripline_msgs::srv::dds_::{kind}_Response_", dict(cls.__annotations__))


MESSAGES = {"wrench": WrenchStamped, "force_map": Image, "slip": Slip, "diagnostics": DiagnosticArray}
# Deep, because Python may be slow.
SENSOR = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(200))
STATE = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(5),
)
SERVICE = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.History.KeepLast(10),
    Policy.DataRepresentation(use_cdrv0_representation=True),
)


def until(done):
    """Waits; fails when it takes too long."""
    end = time.time() + PATIENCE_S
    while not done():
        if time.time() > end:
            sys.exit("it took too long")
        time.sleep(0.005)


def plain(value):
    """Without NaN, which JSON does not know: null."""
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list):
        return [plain(part) for part in value]
    return None if value != value else value


def reader(participant, kind, name):
    qos = STATE if kind == "diagnostics" else SENSOR
    return DataReader(participant, Topic(participant, "rt" + name, MESSAGES[kind]), qos=qos)


def read(job):
    """Some messages of each topic, and when its reader was there."""
    participant = DomainParticipant(job["domain"])
    joined = time.time()
    readers = [reader(participant, kind, name) for kind, name in job["topics"]]
    found = [[] for _ in readers]

    def look():
        for place, topic in enumerate(readers):
            for sample in topic.take(N=50):
                if sample.sample_info.valid_data:
                    found[place].append(asdict(sample))
        return all(len(samples) >= job["count"] for samples in found)

    until(look)
    # What was kept for who joins late comes at once, one after the other.
    time.sleep(0.3)
    look()
    for samples in found:
        for sample in samples:
            if "data" in sample:
                sample["data"] = bytes(sample["data"]).hex()
    return {"joined": joined, "found": found}


def follow(job):
    """Takes every message as it comes, as a node's callback does, until standard input ends; how many there were of each topic."""
    participant = DomainParticipant(job["domain"])
    readers = [reader(participant, kind, name) for kind, name in job["topics"]]
    waiting = WaitSet(participant)
    for topic in readers:
        waiting.attach(ReadCondition(topic, ViewState.Any | InstanceState.Any | SampleState.Any))
    taken = [0] * len(readers)
    while not select.select([sys.stdin], [], [], 0)[0]:
        waiting.wait(duration(milliseconds=200))
        for place, topic in enumerate(readers):
            taken[place] += sum(sample.sample_info.valid_data for sample in topic.take(N=50))
    return taken


class Service:
    """A client of one service, in either mapping."""

    def __init__(self, participant, mapping, name, kind):
        self.cyclone = mapping == "cyclonedds"
        request = {
            (False, "Control"): ControlRequest,
            (False, "SetFloor"): SetFloorRequest,
            (True, "Control"): CycloneControlRequest,
            (True, "SetFloor"): CycloneSetFloorRequest,
        }[self.cyclone, kind]
        response = CycloneResponse if self.cyclone else Response
        if kind != "Control":
            response = named(response, kind)
        self.request = request
        self.writer = DataWriter(participant, Topic(participant, f"rq{name}Request", request), qos=SERVICE)
        self.reader = DataReader(participant, Topic(participant, f"rr{name}Reply", response), qos=SERVICE)
        self.number = 0

    def ready(self):
        return self.writer.get_matched_subscriptions() and self.reader.get_matched_publications()

    def call(self, fields):
        """Asks and waits for the answer to this very request."""
        self.number += 1
        header = {"half": list(range(8)), "number_high": 0, "number_low": self.number} if self.cyclone else {}
        self.writer.write(self.request(**header, **fields))
        found = []

        def look():
            for sample in self.reader.take(N=10):
                if not sample.sample_info.valid_data:
                    continue
                answer = asdict(sample)
                if self.cyclone:
                    # Each answer names the request that it is for.
                    assert list(answer.pop("half")) == list(range(8)), answer
                    if (answer.pop("number_high"), answer.pop("number_low")) != (0, self.number):
                        continue
                found.append(answer)
            return found

        until(look)
        return found[0]


def call(job):
    """Services one after the other."""
    participant = DomainParticipant(job["domain"])
    services = {
        name: Service(participant, job["mapping"], name, "SetFloor" if name.endswith("floor") else "Control")
        for name in {name for name, _ in job["calls"]}
    }
    until(lambda: all(service.ready() for service in services.values()))
    # RustDDS may know a reader a little later than the reader knows it.
    time.sleep(1)
    return [services[name].call(fields) for name, fields in job["calls"]]


def garbage(job):
    """Requests that are none: bodies of any bytes under the right type name, and datagrams of any bytes at every port."""
    chance = random.Random(job["seed"])
    participant = DomainParticipant(job["domain"])
    writers = []
    for kind in ["Control", "SetFloor"]:
        for size in [1, 3, 8, 17, 64, 300]:
            name = job["control"] if kind == "Control" else job["set_floor"]
            typename = f"gripline_msgs::srv::dds_::{kind}_Request_"
            cls = struct(f"Garbage{kind}{size}", typename, {"bytes": array[uint8, size]})
            writer = DataWriter(participant, Topic(participant, f"rq{name}Request", cls), qos=SERVICE)
            writers.append((writer, cls, size))
    until(lambda: all(writer.get_matched_subscriptions() for writer, _, _ in writers))
    time.sleep(0.5)
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ports = [7400 + 250 * job["domain"] + offset for offset in range(0, 30)]
    end, sent = time.time() + job["seconds"], 0
    while time.time() < end:
        for writer, cls, size in writers:
            body = [chance.randrange(256) for _ in range(size)]
            # A string that says to be four gigabytes long.
            if chance.randrange(4) == 0:
                body[:4] = [255] * len(body[:4])
            writer.write(cls(bytes=body))
            sent += 1
        for port in ports:
            body = bytearray(chance.randbytes(chance.randrange(200)))
            # Every other one begins as RTPS does.
            if chance.randrange(2):
                body = bytearray(b"RTPS\x02\x04\x01\x10") + bytearray(chance.randbytes(12)) + body
            udp.sendto(body, ("127.0.0.1", port))
            sent += 1
        time.sleep(0.002)
    return {"sent": sent}


if __name__ == "__main__":
    JOB = json.loads(sys.argv[1])
    print(json.dumps(plain({"read": read, "follow": follow, "call": call, "garbage": garbage}[JOB["job"]](JOB)), allow_nan=False))
