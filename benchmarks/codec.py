"""Encoding and decoding the packets of one axis with all checks, against bare msgpack without any.

*Warm*: many calls one after the other. *Cold*: single calls, each after memory larger than the
inner caches was written: closer to what a process pays that runs once a millisecond. Last, what the
fields of the telemetry cost its sender that only `forcebound replay --verify` reads.
"""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgpack
from msgspec import defstruct
from msgspec.msgpack import Encoder

from benchmarks.harness import Contestant, Figure, Result, alternate, at, compare, timed
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import (
    TOPIC_OF,
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    ForceCommand,
    Packet,
    Telemetry,
)
from forcebound.observe.measure import Round, Timing

DURATION = 15.0
ASKED = "telemetry of one axis encoded and decoded, with all checks"
TARGET = 4.0
GOLDEN = Path(__file__).parent.parent / "tests" / "golden"
SENT_EACH_TICK = (DeviceState, EnvironmentQuery, EnvironmentReply, ForceCommand, Telemetry)
FOR_VERIFICATION = {
    *("read_ns", "write_ns", "joints", "torques", "cut_ns", "cut_position", "ahead_ns"),
}
CALLS, ROUNDS = 500, 10  # warm calls of one measurement, rounds of each contestant

Work = Callable[[], object]
_ballast = bytearray(4 << 20)  # larger than the inner caches of usual processors


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    contestants: dict[str, Contestant] = {}
    samples = [_golden(kind) for kind in SENT_EACH_TICK]
    telemetry = samples[-1]
    for packet in samples:
        data, message = encode(packet), msgpack.unpackb(encode(packet))
        works: dict[str, Work] = {
            "": partial(_there_and_back, packet),
            ", msgpack": partial(_there_and_back_bare, message),
        }
        for name, work in works.items():
            label = f"{TOPIC_OF[type(packet)]} ({len(data)} B){name}"
            contestants |= {
                f"{label}, warm": partial(_warm, work),
                f"{label}, cold": partial(_cold, work),
            }
    less, encoder = _without_verification(telemetry), Encoder()
    contestants["encode telemetry"] = partial(_warm, partial(encoder.encode, telemetry))
    contestants["encode without --verify"] = partial(_warm, partial(encoder.encode, less))
    found = alternate(duration, rate, contestants, ROUNDS)
    of_packets, whole, cut = found[:-2], found[-2], found[-1]
    warm = [(ours, bare) for ours, bare in zip(of_packets[::4], of_packets[2::4], strict=True)]
    cold = [(ours, bare) for ours, bare in zip(of_packets[1::4], of_packets[3::4], strict=True)]
    size = len(encoder.encode(telemetry)) - len(encoder.encode(less))
    last = len(warm) - 1  # telemetry
    return found, [
        at(warm[last][0], "p50", is_shown=True),
        *(
            compare(*pair, "p50", TARGET, "bare msgpack" if number == last else "")
            for number, pair in enumerate(warm)
        ),
        *(compare(*pair, "p50") for pair in cold),
        compare(whole, cut),
        Figure("telemetry's fields for replay --verify", size, "B"),
    ]


def _there_and_back(packet: Packet) -> object:
    return decode(encode(packet), type(packet))


def _there_and_back_bare(message: object) -> object:
    return msgpack.unpackb(msgpack.packb(message))


def _golden(kind: type[Packet]) -> Packet:
    """Return the packet of a type that the tests have bytes of."""
    lines = (GOLDEN / f"{TOPIC_OF[kind]}.hex").read_text()
    return decode(bytes.fromhex(re.sub("#.*", "", lines)), kind)


def _without_verification(packet: Packet) -> object:
    names = [name for name in packet.__struct_fields__ if name not in FOR_VERIFICATION]
    kept = {name: getattr(packet, name) for name in names}
    return defstruct("Less", list(kept), gc=False, tag="telemetry", tag_field="packet")(**kept)


def _warm(work: Work, timing: Timing) -> Round:
    def several() -> None:
        for _ in range(CALLS):
            work()

    return Round([timed(several) // CALLS for _ in range(5)])


def _cold(work: Work, timing: Timing) -> Round:
    times_ns = []
    for _ in range(20):
        _ballast[::64] = bytes(len(_ballast) // 64)
        times_ns.append(timed(work))
    return Round(times_ns)
