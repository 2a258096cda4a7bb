"""Codec of packets: bytes and back, strictly, with msgpack.

A packet on the wire is one msgpack map: ``"packet"`` (name of the topic), one key per field of its
class and ``"version"``; ``docs/protocol.md`` describes the format for other programs.

Strategy:

1. msgspec builds a decoder from each class of ``packets.py``. A new packet or field needs no change
   here.
2. :func:`encode` does not check values.
3. :func:`decode` trusts no sender: any bytes give a packet or a :class:`PacketError`. Compiled code
   does the checks except three, which follow here: that all vectors have one length, that a contact
   is complete, and that names are printable, because they reach logs and terminals.
4. The reason of a rejection is determined only afterwards:

   ========= =====================================================================================
   malformed not one msgpack map with text keys: cut short, trailing bytes, too large or too deep
   version   another version of the wire format
   value     a key is missing, it is another packet than expected, a value has the wrong type, range
             or length, a name has a control or format character, two vectors differ in length, or
             half of a contact is missing
   ========= =====================================================================================

Not-a-number and infinity *are* decoded, but not in a scene: device and environment reject and count
them.
"""

import reprlib
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Any, NamedTuple

from msgspec import MsgspecError, Struct, UnsetType, ValidationError
from msgspec.msgpack import Decoder, Encoder

from forcebound.errors import PacketError
from forcebound.messages.packets import (
    NAMES,
    TOPIC_OF,
    VERSION,
    EnvironmentReply,
    Packet,
    Scene,
    Vector,
    field_types,
)

MAX_BYTES = 8192  # a reply of eight axes with 128 signals of the longest names has less than 6500
MAX_SCENE_BYTES = 32768  # of a scene, which no loop waits for; 64 boxes have less than 12000
MAX_FAULT = 300  # characters of a library's message in that of a PacketError

# ValueError: text that is not UTF-8.
_REFUSALS = (MsgspecError, ValueError, RecursionError, OverflowError)


class _Rules(NamedTuple):
    """Remaining checks of a decoded packet."""

    vectors: tuple[str, ...]  # the first is never nil
    vectors_of: Callable[[Packet], tuple[Any, ...]] | None  # None: there is none to compare
    names: tuple[str, ...]
    check: Callable[[Any], None] | None  # what only this packet must fulfil


def _check_contact(reply: EnvironmentReply) -> None:
    if (reply.proxy is None) is not (reply.normal is None):
        half = "proxy" if reply.normal is None else "normal"
        message = f"environment_reply: expected proxy and normal, or neither, got {half} alone"
        raise PacketError("value", message)


def _check_proxies(scene: Scene) -> None:
    for hand in scene.proxies:
        if not hand.isprintable():
            raise _name_text_error(scene, "proxies", hand)


_CHECKS: dict[type[Packet], Callable[[Any], None]] = {
    EnvironmentReply: _check_contact,
    Scene: _check_proxies,
}


def _rules_of(kind: type[Packet]) -> _Rules:
    types = field_types(kind)
    hints = (Vector, Vector | None, Vector | UnsetType)
    vectors = tuple(name for name, hint in types.items() if hint in hints)
    vectors_of = attrgetter(*vectors) if len(vectors) > 1 else None
    names = tuple(name for name in types if name in NAMES)
    return _Rules(vectors, vectors_of, names, _CHECKS.get(kind))


def plain(value: Any) -> float | dict[Any, Any]:
    """Return a value of a type unknown to msgspec (a numpy float) as a plain one, or TypeError."""
    if isinstance(value, float):
        return float(value)
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"packets hold numbers, tuples and mappings, got {reprlib.repr(value)}")


class _Head(Struct):
    """The keys by which a frame that was refused is classified."""

    version: Any = VERSION


_RULES = {kind: _rules_of(kind) for kind in TOPIC_OF}
_DECODE: dict[type[Packet] | None, Callable[[bytes], Packet]] = {
    None: Decoder(Packet).decode,
    **{kind: Decoder(kind).decode for kind in TOPIC_OF},
}
_DECODE_HEAD = Decoder(_Head).decode
_LONGEST: dict[type[Packet] | None, int] = {
    **dict.fromkeys(TOPIC_OF, MAX_BYTES),
    **dict.fromkeys((None, Scene), MAX_SCENE_BYTES),
}

#: A packet as bytes; its values are not checked. TypeError for a value that msgpack does not know.
encode: Callable[[Packet], bytes] = Encoder(enc_hook=plain).encode


def decode(data: bytes, expected: type[Packet] | None = None) -> Packet:
    """Return the packet in ``data``, one whole frame; ``expected``: the only class accepted.

    Raises:
        PacketError: If it is anything else; ``reason`` as in the table at the head of this module,
            the message says what was expected and what came.
    """
    if len(data) > _LONGEST[expected]:
        raise _length_error(data, expected)
    try:
        packet = _DECODE[expected](data)
    except _REFUSALS as error:
        raise _refusal(data, expected, error) from None
    kind = type(packet)
    if expected is None and len(data) > _LONGEST[kind]:
        raise _length_error(data, kind)
    rules = _RULES[kind]
    if rules.vectors_of is not None:
        first, *others = rules.vectors_of(packet)
        axes = len(first)
        for vector in others:
            if vector and len(vector) != axes:
                raise _axes_error(packet, rules)
    for name in rules.names:
        text = getattr(packet, name)
        if text and not text.isprintable():
            raise _name_text_error(packet, name, text)
    if rules.check is not None:
        rules.check(packet)
    return packet


def _length_error(data: bytes, expected: type[Packet] | None) -> PacketError:
    message = f"expected at most {_LONGEST[expected]} bytes, got {len(data)}"
    return PacketError("malformed", message)


def _refusal(data: bytes, expected: type[Packet] | None, error: Exception) -> PacketError:
    name = "a packet" if expected is None else TOPIC_OF[expected]
    try:
        version = _DECODE_HEAD(data).version
    except _REFUSALS as fault:
        return PacketError("malformed", f"{name}: expected one msgpack map: {_printable(fault)}")
    if version != VERSION or type(version) is not int:
        got = reprlib.repr(version)
        words = f"expected version {VERSION} of the wire format, got {got}"
        return PacketError("version", f"{words}: use one version of forcebound on both ends")
    reason = "value" if isinstance(error, ValidationError) else "malformed"
    return PacketError(reason, f"{name}: {_printable(error)}")


def _printable(error: Exception) -> str:
    """Return the message of a library, which may quote what came."""
    return "".join(each if each.isprintable() else "?" for each in str(error)[:MAX_FAULT])


def _axes_error(packet: Packet, rules: _Rules) -> PacketError:
    axes = [f"{name}: {len(getattr(packet, name) or ())}" for name in rules.vectors]
    return PacketError(
        "value",
        f"{TOPIC_OF[type(packet)]}: expected vectors of one length, got axes {', '.join(axes)}",
    )


def _name_text_error(packet: Packet, name: str, text: str) -> PacketError:
    return PacketError(
        "value",
        f"{TOPIC_OF[type(packet)]}: {name} must be printable text on one line, got "
        f"{reprlib.repr(text)}",
    )
