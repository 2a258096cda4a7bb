"""What does a tick of the servo cost? The real device node on real sockets; one contestant.

``device`` runs the device node of a stiff wall; ``controller`` takes its states and telemetry and
answers each state with a force, so that the whole safety chain and the bounder have work to do. A
tick costs what lies between its two wake-ups and the return to sleep: read and publish the state;
receive, decode, read, chain, bound, write and publish the telemetry. The waits do not count.

::

    python -m forcebound.benchmark.servo_tick ROLE FOLDER CORE POLICY PERIOD_NS COUNT
"""

import os
import signal
import sys
import time

from forcebound.benchmark.workers import READY, WARMUP, write_times
from forcebound.devices.phantom import PhantomPremium15
from forcebound.environments.wall import Wall
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import TOPIC_OF, DeviceState, ForceCommand, Packet, Telemetry
from forcebound.network.sockets import Network, wait
from forcebound.nodes.device import DeviceNode, ServoSettings, dissipation_of
from forcebound.operators.sinusoidal import SinusoidalHand
from forcebound.realtime import Settings, die_with_parent, enter, freeze_garbage, wait_until

_SPIN_NS = Settings().spin_ns


def _endpoint(folder: str, kind: type[Packet]) -> str:
    return f"ipc://{folder}/{TOPIC_OF[kind]}"


def _serve(folder: str, network: Network) -> None:
    states = network.subscriber(_endpoint(folder, DeviceState), newest_only=True)
    telemetry = network.subscriber(_endpoint(folder, Telemetry), newest_only=False)
    commands = network.publisher(_endpoint(folder, ForceCommand))
    wall = Wall()
    seq = 0
    while True:
        wait((states, telemetry), None)
        telemetry.receive()
        for data in states.receive():
            state = decode(data, DeviceState)
            assert type(state) is DeviceState
            force = wall.force(state.position, state.velocity, state.elapsed)
            now = time.monotonic_ns()
            commands.send(encode(ForceCommand(seq, now, state.seq, state.time_ns, force)))
            seq += 1


def _drive(folder: str, network: Network, period_ns: int, count: int) -> None:
    """Run ``count`` ticks that count and write their durations to standard output."""
    states = network.publisher(_endpoint(folder, DeviceState))
    telemetry = network.publisher(_endpoint(folder, Telemetry))
    commands = network.subscriber(_endpoint(folder, ForceCommand), newest_only=True)
    model, servo = PhantomPremium15(), ServoSettings(rate=1e9 / period_ns)
    device = model.open(SinusoidalHand(), servo.longest_hold)
    node = DeviceNode(device, dissipation_of(model, servo), servo)
    node.engage()
    freeze_garbage()
    durations_ns = [0] * count
    index = -WARMUP
    missed = processor_ns = begin_ns = spent_ns = answers = 0
    deadline_ns = time.monotonic_ns() + round(READY * 1e9)
    while index < count:
        now = wait_until(node.wake_ns, _SPIN_NS)
        received = [decode(data, ForceCommand) for data in commands.receive()]
        for packet in node.step(now, received):
            is_write = type(packet) is Telemetry
            (telemetry if is_write else states).send(encode(packet))
            spent_ns += time.monotonic_ns() - now
            if not is_write:
                continue
            if index >= 0:
                durations_ns[index] = spent_ns
            spent_ns = 0
            answers += len(received)
            if index >= 0 or answers:
                index += 1
            elif now > deadline_ns:
                sys.exit("the servo got no answer: the answering process is missing")
            if index == 0:
                missed, answers = node.deadline_misses, 1
                processor_ns, begin_ns = time.process_time_ns(), now
    write_times(
        durations_ns,
        node.deadline_misses - missed,
        time.process_time_ns() - processor_ns,
        time.monotonic_ns() - begin_ns,
    )


def main(role: str, folder: str, core: int, policy: str, period_ns: int, count: int) -> None:
    """Be one of the two processes; only the device ends by itself."""
    die_with_parent(signal.SIGKILL)
    enter(Settings(policy=policy, core=core), role)
    network = Network()
    if role == "device":
        _drive(folder, network, period_ns, count)
        os._exit(0)  # nothing of the sockets is worth waiting for
    _serve(folder, network)


if __name__ == "__main__":
    _role, _folder, _core, _policy, _period_ns, _count = sys.argv[1:]
    main(_role, _folder, int(_core), _policy, int(_period_ns), int(_count))
