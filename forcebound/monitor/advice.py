"""What the words mean by which nodes count what they refuse, and what to do about it.

To add a reason for a refused packet, or a kind of notice of the remote link: one line in a table.
"""

from typing import NamedTuple


class Advice(NamedTuple):
    """What a word means, and what to do."""

    meaning: str
    action: str


_OTHER_SOFTWARE = "find who sends it: a node of your own, or of another version of forcebound"
_CHECK_ENCODER = "compare the sender with docs/protocol.md and its golden bytes"

# By reason of a packet that was refused: the codec's, the safety chain's, the controller's.
REASONS: dict[str, Advice] = {
    "malformed": Advice("not one msgpack map with text keys", _OTHER_SOFTWARE),
    "version": Advice(
        "another version of the wire format", "run the same version of forcebound on both ends"
    ),
    "keys": Advice("a key is missing, unknown or twice, or another packet", _CHECK_ENCODER),
    "value": Advice("a value of a wrong type, range or length", _CHECK_ENCODER),
    "unexpected": Advice("a packet that the device takes from nobody", _OTHER_SOFTWARE),
    "wrong_length": Advice(
        "a force with another number of axes than the device has",
        "let the environment answer with one number per axis",
    ),
    "not_finite": Advice(
        "a force that is infinite or not a number",
        "look for a division by zero in the environment; forcebound check environment",
    ),
    "too_old": Advice(
        "an answer to a state older than device.age_limit",
        "shorten the delay on the way, or raise device.age_limit (the law stays certified)",
    ),
    "not_newer": Advice(
        "an answer that a newer one has overtaken, or a copy",
        "usual with jitter, reordering or duplicates; else a sender repeats itself",
    ),
    "from_the_future": Advice(
        "an answer to a tick that has not been",
        "end who still answers for a former run, and environments that count ticks themselves",
    ),
    "wrong_echo": Advice(
        "an answer that does not echo device_time_ns as it came",
        "let the environment echo device_seq and device_time_ns unchanged (docs/protocol.md)",
    ),
    "second_environment": Advice(
        "an answer of an environment that does not serve this graph",
        "end the one that is not wanted; the other one takes over when the first is gone for 1 s",
    ),
}

UNKNOWN_REASON = Advice("a reason of a newer version", "see docs/protocol.md of that version")

# By kind of notice of the link to another machine (forcebound.network.remote.KINDS); those that
# are no problem are not here.
NOTICES: dict[str, Advice] = {
    "refused_here": Advice(
        "a peer was refused: its key is not in our list",
        "if it is wanted, add its key to remote.environment_keys (at an environment: graph_key)",
    ),
    "refused_there": Advice(
        "we were refused: our key is not in the list there, or its port is full",
        "add our public key there: forcebound keys show NAME",
    ),
    "wrong_key_of_ours": Advice(
        "a peer expects another public key of ours",
        "give it the present one: forcebound keys show NAME",
    ),
    "wrong_key_there": Advice(
        "the listener ended our handshake, most likely for another key of its own",
        "copy its present public key to this machine",
    ),
    "other_security": Advice(
        "one end uses keys and the other does not", "use the same remote: section on both machines"
    ),
    "handshake_timeout": Advice(
        "a peer was silent or too slow in its handshake",
        "is something else, such as a browser or a port scan, connecting to this port?",
    ),
    "handshake_failed": Advice(
        "what came is no handshake of this link",
        "does the other end use keys, too (the same remote: section)? Who listens cannot tell a "
        "peer without keys from another program; its own log can. Else: who else uses this port?",
    ),
    "too_many_connections": Advice(
        "the port has as many connections as it takes", "end the peers that are not wanted"
    ),
    "protocol_error": Advice(
        "a peer sent a message that is too large, or broke the protocol", _OTHER_SOFTWARE
    ),
    "no_answer": Advice(
        "nobody answers at the address",
        "start the other end; check remote.address, remote.port and the next port in firewalls",
    ),
}
