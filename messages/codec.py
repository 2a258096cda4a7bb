"""Codec of packets: bytes and back, strictly, with msgpack.

A packet on the wire is one msgpack map: ``"packet"`` (name of the topic), one key per field of its
class and ``"version"``; ``docs/protocol.md`` describes the format for other programs.

Strategy:

1. msgspec builds a decoder from each class of ``packets.py``. A new packet or field needs no change
   here.
2. :func:`encode` does not check values.
3. :func:`decode` trusts no sender: any bytes give a packet or a :class:`PacketError`. Compiled code
   does the checks except five, which follow here: that no key with a default was left out, that no
   key came twice (by the number of pairs), that all vectors have one length, that a contact is
   whole, and that names are printable, because they reach logs and terminals.
4. The reason of a rejection is determined only afterwards, by decoding the frame again without a
   schema. Its memory is bounded by the size of the frame (``MAX_BYTES``) and the length that an
   array or map may state. The reasons, in the order of the checks:

   ========= =====================================================================================
   malformed not one msgpack map with text keys: cut short, trailing bytes, too large or too deep
   version   another version of the wire format
   keys      a key is missing, unknown or duplicate, or it is another packet than expected
   value     a value has the wrong type, range or length, a name has a control or format
             character, two vectors differ in length, or half of a contact is missing
   ========= =====================================================================================

Not-a-number and infinity *are* decoded, but not in a scene: device and environment reject and count
them.
"""

import re
import reprlib
from collections.abc import Callable, Mapping
from itertools import chain
from math import isfinite
from operator import attrgetter
from typing import Any, NamedTuple

import msgpack
from msgspec import MsgspecError, Raw, defstruct
from msgspec.msgpack import Decoder, Encoder
from msgspec.structs import fields

from forcebound.errors import PacketError
from forcebound.messages.packets import (
    MAX_LENGTH,
    NAMES,
    TOPIC_OF,
    TOPICS,
    VERSION,
    EnvironmentReply,
    Packet,
    Scene,
    Vector,
    field_types,
)

MAX_BYTES = 4096  # the largest packet, telemetry of six axes with 32 reasons, has less than 2000
MAX_SCENE_BYTES = 32768  # of a scene, which no loop waits for; 64 boxes have less than 12000

# ValueError: text that is not UTF-8.
_REFUSALS = (MsgspecError, ValueError, RecursionError, OverflowError)


class _Form(NamedTuple):
    """Remaining checks of a decoded packet."""

    head: bytes  # of the map, as most encoders write it
    head_length: int
    keys: tuple[str, ...]
    vectors: tuple[str, ...]  # the first is never nil
    vectors_of: Callable[[Packet], tuple[Any, ...]] | None  # None: there is none to compare
    names: tuple[str, ...]
    decode_rest: Callable[[bytes | memoryview], object]  # raises if a key with a default is missing
    check: Callable[[Any], None] | None  # what only this packet must fulfil


def _check_contact(reply: EnvironmentReply) -> None:
    proxy, normal = reply.proxy, reply.normal
    if proxy is None is normal:
        return
    if proxy is None or normal is None:
        half = "proxy" if normal is None else "normal"
        message = f"environment_reply: expected proxy and normal, or neither, got {half} alone"
        raise PacketError("value", message)
    if not len(proxy) == len(normal) == len(reply.force):
        raise _axes_error(reply, _FORMS[EnvironmentReply])


def _check_objects(scene: Scene) -> None:
    for each in scene.objects:
        for text in (each.name, each.file):
            if text is not None and not text.isprintable():
                raise _name_text_error(scene, "objects", text)
        numbers = (each.position, each.orientation, each.size, *each.points)
        if not all(map(isfinite, chain.from_iterable(numbers))):
            message = f"scene: objects must have finite numbers, got {reprlib.repr(each)}"
            raise PacketError("value", message)


_CHECKS: dict[type[Packet], Callable[[Any], None]] = {
    EnvironmentReply: _check_contact,
    Scene: _check_objects,
}


def _form(kind: type[Packet]) -> _Form:
    types = field_types(kind)
    keys = ("packet", *types, "version")
    head = msgpack.Packer().pack_map_header(len(keys))
    vectors = tuple(name for name, hint in types.items() if hint in (Vector, Vector | None))
    # A reply, which mostly has one, is left to its check: that is 0.3 µs less.
    has_others = len(vectors) > 1 and kind is not EnvironmentReply
    vectors_of = attrgetter(*vectors) if has_others else None
    names = tuple(name for name in types if name in NAMES)
    rest = ("packet", *(field.name for field in fields(kind) if not field.required))
    decode_rest = Decoder(defstruct("Rest", [(name, Raw) for name in rest], gc=False)).decode
    return _Form(head, len(head), keys, vectors, vectors_of, names, decode_rest, _CHECKS.get(kind))


def plain(value: Any) -> float | dict[Any, Any]:
    """Return a value of a type unknown to msgspec (a numpy float, for example) as a plain one.

    Raises:
        TypeError: If there is none.
    """
    if isinstance(value, float):
        return float(value)
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"packets hold numbers, tuples and mappings, got {reprlib.repr(value)}")


_FORMS = {kind: _form(kind) for kind in TOPIC_OF}
_DECODE: dict[type[Packet] | None, Callable[[bytes | memoryview], Packet]] = {
    None: Decoder(Packet).decode,
    **{kind: Decoder(kind).decode for kind in TOPIC_OF},
}
_LONGEST: dict[type[Packet] | None, int] = {
    **dict.fromkeys(TOPIC_OF, MAX_BYTES),
    **dict.fromkeys((None, Scene), MAX_SCENE_BYTES),
}

#: As :func:`encode`, for the loop: whether it is a packet at all is not checked either.
encode_unchecked: Callable[[Packet], bytes] = Encoder(enc_hook=plain).encode


def encode(packet: Packet) -> bytes:
    """Return ``packet`` as bytes; its values are not checked.

    Raises:
        KeyError: If ``packet`` is not an instance of one of the classes of ``TOPICS``.
        TypeError: If a value has a type that msgpack does not know.
    """
    if type(packet) not in TOPIC_OF:
        raise KeyError(type(packet))
    return encode_unchecked(packet)


def decode(data: bytes | memoryview, expected: type[Packet] | None = None) -> Packet:
    """Return the packet in ``data``.

    Args:
        data: One whole frame, contiguous.
        expected: The only class of packet that is accepted; None: any.

    Raises:
        PacketError: If ``data`` is anything else; ``reason`` as in the table at the head of this
            module, the message says what was expected and what came.
    """
    if len(data) > _LONGEST[expected]:
        raise _length_error(data, expected)
    try:
        packet = _DECODE[expected](data)
        form = _FORMS[type(packet)]
        form.decode_rest(data)
    except _REFUSALS as error:
        raise _refusal(data, expected, str(error)) from None
    if len(data) > _LONGEST[type(packet)]:
        raise _length_error(data, type(packet))
    if data[: form.head_length] != form.head and _pair_count(data) != len(form.keys):
        raise _refusal(data, expected, "")
    if form.vectors_of is not None:
        first, *others = form.vectors_of(packet)
        axes = len(first)
        for vector in others:
            if vector is not None and len(vector) != axes:
                raise _axes_error(packet, form)
    for name in form.names:
        text = getattr(packet, name)
        if text is not None and not text.isprintable():
            raise _name_text_error(packet, name, text)
    if form.check is not None:
        form.check(packet)
    return packet


def _length_error(data: bytes | memoryview, expected: type[Packet] | None) -> PacketError:
    message = f"expected at most {_LONGEST[expected]} bytes, got {len(data)}"
    return PacketError("malformed", message)


def _pair_count(data: bytes | memoryview) -> int:
    """Return the number of pairs that the head of the map ``data`` states."""
    first = data[0]
    if first < 0xDE:  # the count is in the first byte
        return first & 0x0F
    return int.from_bytes(data[1:3] if first == 0xDE else data[1:5], "big")


def _refusal(data: bytes | memoryview, expected: type[Packet] | None, fault: str) -> PacketError:
    """Return why ``data`` is rejected; ``fault`` is the message of msgspec."""
    try:
        message = _unpack(data)
    except PacketError as error:
        return error
    version = message.get("version")
    if type(version) is not int or version != VERSION:
        return _version_error(message)
    topic = message.get("packet")
    kind = TOPICS[topic].packet if type(topic) is str and topic in TOPICS else None
    if kind is None or (expected is not None and kind is not expected):
        return _name_error(topic, expected)
    keys = _FORMS[kind].keys
    if message.keys() != set(keys) or _pair_count(data) != len(keys):
        return _keys_error(TOPIC_OF[kind], keys, message)
    return PacketError("value", f"{topic}: {_value_fault(fault, message)}")


def _unpack(data: bytes | memoryview) -> dict[str, Any]:
    try:
        message = msgpack.unpackb(
            data,
            use_list=False,
            strict_map_key=True,
            max_array_len=MAX_LENGTH,
            max_map_len=MAX_LENGTH,
        )
    except (ValueError, OverflowError, RecursionError) as error:
        # ValueError is msgpack's own base for cut, trailing, too deep and forbidden input, and of
        # text that is not UTF-8; OverflowError comes from time stamps out of range.
        detail = str(error) or type(error).__name__
        raise PacketError(
            "malformed", f"expected one msgpack map, got {len(data)} bytes that are not: {detail}"
        ) from None
    if type(message) is not dict:
        raise PacketError("malformed", f"expected a msgpack map, got {reprlib.repr(message)}")
    return message


def _value_fault(fault: str, message: dict[str, Any]) -> str:
    # msgspec writes "Expected `float`, got `bool` - at `$.force[0]`", and of an object of a scene
    # "Object missing required field `name` - at `$.objects[0]`".
    match = re.fullmatch(r"(?:Expected )?(.*?)(?:, got .*)? - at `\$\.((\w+).*)`", fault)
    if match is None:
        return fault
    expected, path, name = match.groups()
    if not fault.startswith("Expected "):
        expected = f"an object with its keys alone ({expected})"
    return f"{path} must be {expected}, got {reprlib.repr(message[name])}"


def _axes_error(packet: Packet, form: _Form) -> PacketError:
    axes = [f"{name}: {len(getattr(packet, name) or ())}" for name in form.vectors]
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


def _version_error(message: dict[str, Any]) -> PacketError:
    if "version" not in message:
        return PacketError("keys", f"expected the key 'version', got {_listed(message)}")
    version = reprlib.repr(message["version"])
    words = f"expected version {VERSION} of the wire format, got {version}"
    return PacketError("version", f"{words}: use one version of forcebound on both ends")


def _name_error(topic: Any, expected: type[Packet] | None) -> PacketError:
    names = f"'{TOPIC_OF[expected]}'" if expected is not None else f"one of {_listed(TOPICS)}"
    return PacketError("keys", f"expected as 'packet' {names}, got {reprlib.repr(topic)}")


def _keys_error(topic: str, keys: tuple[str, ...], message: dict[str, Any]) -> PacketError:
    missing = [key for key in keys if key not in message]
    unknown = [key for key in message if key not in keys]
    faults = [f"missing {_listed(missing)}"] if missing else []
    if unknown:
        faults.append(f"unknown {_listed(unknown)}")
    got = " and ".join(faults) or "a duplicate key"
    return PacketError("keys", f"{topic}: expected the keys {_listed(keys)}, got {got}")


def _listed(names: Any) -> str:
    return ", ".join(reprlib.repr(name) for name in names) or "none"
