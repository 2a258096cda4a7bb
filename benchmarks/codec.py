"""Benchmark of the codec against bare msgpack: ``python benchmarks/codec.py [--json]``.

For every packet of one axis: encode plus decode with all its checks, against ``msgpack.packb`` plus
``unpackb`` of the same map, which is what it costs without any check. Absolute times mean nothing
on a shared machine, so the two are measured in turns, and their ratio is judged. The
target is a ratio of at most 4.

* warm: the median of rounds of many calls;
* cold: the median of single calls, each after memory larger than the inner caches was written:
  closer to what a process pays that runs once a millisecond.

Last, what the fields of the telemetry cost its sender that only `forcebound replay --verify` reads.
"""

import json
import statistics
import sys
from collections.abc import Callable
from time import perf_counter_ns

import click
import msgpack
from msgspec import defstruct
from msgspec.msgpack import Encoder

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

TARGET = 4.0
NOW = 1_234_567_890_123_456  # ns, two weeks after a start
SAMPLES: tuple[Packet, ...] = (
    DeviceState(4321, NOW, 4.3, (0.01203,), (0.0523,), (1.25,)),
    EnvironmentQuery(4321, NOW, 4321, NOW, 4.3, (0.01203,), (0.0523,), "wall"),
    EnvironmentReply(4321, NOW, 4321, NOW, 4321, NOW, (1.25,), "wall"),
    ForceCommand(4321, NOW, 4321, NOW, (1.25,)),
    Telemetry(
        seq=4321,
        time_ns=NOW,
        elapsed=4.3,
        position=(0.01203,),
        commanded_force=(20.3,),
        applied_force=(1.25,),
        force_limit=1.25,
        estimated_energy=0.0021,
        true_energy=0.0032,
        true_position=(0.012041,),
        hand_force=(1.31,),
        engagement=1.0,
        device_seq=4321,
        loop_delay=0.0004,
        deadline_misses=0,
        rejected={"age": 3},
        read_ns=NOW,
        write_ns=NOW,
    ),
)
FOR_VERIFICATION = (
    *("read_ns", "write_ns", "joints", "torques", "cut_ns", "cut_position", "ahead_ns"),
)

Work = Callable[[], object]


def compare(packet: Packet, rounds: int, calls: int) -> dict[str, float]:
    """Return the cost of a codec round trip of ``packet``, in µs, bare and ours, warm and cold."""
    kind = type(packet)
    data = encode(packet)
    message = msgpack.unpackb(data)

    def ours() -> None:
        decode(encode(packet), kind)

    def bare() -> None:
        msgpack.unpackb(msgpack.packb(message))

    warm = [(_per_call(ours, calls), _per_call(bare, calls)) for _ in range(rounds)]
    cold = [(_cold(ours), _cold(bare)) for _ in range(rounds * 20)]
    result: dict[str, float] = {"bytes": len(data)}
    for name, pairs in (("warm", warm), ("cold", cold)):
        ours_us = statistics.median(pair[0] for pair in pairs)
        bare_us = statistics.median(pair[1] for pair in pairs)
        result |= {
            f"{name}_us": ours_us,
            f"{name}_msgpack_us": bare_us,
            f"{name}_ratio": ours_us / bare_us,
        }
    return result


def cost_of_verification(rounds: int, calls: int) -> dict[str, float]:
    """Return the bytes of those fields of the telemetry, and the µs to encode them, in turns."""
    packet = SAMPLES[-1]
    kept = {name: getattr(packet, name) for name in packet.__struct_fields__}
    for name in FOR_VERIFICATION:
        del kept[name]
    less = defstruct("Less", list(kept), gc=False, tag="telemetry", tag_field="packet")(**kept)
    encoder = Encoder()

    def turn(measure: Callable[[Work], float]) -> float:
        return measure(lambda: encoder.encode(packet)) - measure(lambda: encoder.encode(less))

    return {
        "bytes": len(encoder.encode(packet)) - len(encoder.encode(less)),
        "warm_us": statistics.median(turn(lambda w: _per_call(w, calls)) for _ in range(rounds)),
        "cold_us": statistics.median(turn(_cold) for _ in range(rounds * 20)),
    }


def _per_call(work: Work, calls: int) -> float:
    start = perf_counter_ns()
    for _ in range(calls):
        work()
    return (perf_counter_ns() - start) / calls / 1e3


_ballast = bytearray(4 << 20)  # larger than the inner caches of usual processors


def _cold(work: Work) -> float:
    _ballast[::64] = bytes(len(_ballast) // 64)
    start = perf_counter_ns()
    work()
    return (perf_counter_ns() - start) / 1e3


@click.command()
@click.option("--rounds", default=25, show_default=True, help="Rounds of each packet.")
@click.option("--calls", default=1000, show_default=True, help="Warm calls in a round.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document.")
def main(rounds: int, calls: int, as_json: bool) -> None:
    """Compare the codec with bare msgpack; status 1 if it costs more than the target allows."""
    results = {TOPIC_OF[type(packet)]: compare(packet, rounds, calls) for packet in SAMPLES}
    more = cost_of_verification(rounds, calls)
    worst = max(result["warm_ratio"] for result in results.values())
    if as_json:
        document = {"target_ratio": TARGET, "worst_ratio": worst, "packets": results}
        document["telemetry_for_verification"] = more
        click.echo(json.dumps(document, indent=2))
    else:
        click.echo(
            "encode + decode of one axis, µs      warm  msgpack  ratio    cold  msgpack  ratio"
        )
        for topic, result in results.items():
            figures = "  ".join(
                f"{result[f'{name}_us']:6.2f}  {result[f'{name}_msgpack_us']:7.2f}"
                f"  {result[f'{name}_ratio']:5.2f}"
                for name in ("warm", "cold")
            )
            click.echo(f"{topic:20} {result['bytes']:4.0f} bytes  {figures}")
        click.echo(f"worst warm ratio {worst:.2f}; target: at most {TARGET:.0f}")
        click.echo(
            f"telemetry's fields for `replay --verify`: {more['bytes']:.0f} bytes, to encode"
            f" {more['warm_us']:.2f} µs warm, {more['cold_us']:.2f} µs cold"
        )
    sys.exit(0 if worst <= TARGET else 1)


if __name__ == "__main__":
    main()
