"""Codec of packets: bytes and back, strictly, with msgpack.

A packet on the wire is one msgpack map: ``"packet"`` (name of the topic), one key per field of its
class and ``"version"``; ``docs/protocol.md`` describes the format for other programs.

Strategy:

1. msgspec builds a decoder from each class of ``packets.py``. A new packet or field needs no change
   here.
2. :func:`encode` does not check values.
3. :func:`decode` trusts no sender: any bytes give a packet or a :class:`PacketError`. Compiled code
   does the checks except four, which follow here: that ``packet`` and ``version`` were present,
   that no key came twice (by the number of pairs), that all vectors have one length, and that
   names are printable, because they reach logs and terminals.
4. The reason of a rejection is determined only afterwards, by decoding the frame again without a
   schema. Its memory is bounded by the size of the frame (``MAX_BYTES``) and the length that an
   array or map may state. The reasons, in the order of the checks:

   ========= =====================================================================================
   malformed not one msgpack map with text keys: cut short, trailing bytes, too large or too deep
   version   another version of the wire format
   keys      a key is missing, unknown or duplicate, or it is another packet than expected
   value     a value has the wrong type, range or length, a name has a control or format
             character, or two vectors differ in length
   ========= =====================================================================================

Not-a-number and infinity *are* decoded: device and environment reject and count them.
"""

import re
import reprlib
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Any, NamedTuple

import msgpack
from msgspec import MsgspecError, Struct
from msgspec.msgpack import Decoder, Encoder

from forcebound.errors import PacketError
from forcebound.messages.packets import (
    MAX_LENGTH,
    NAMES,
    TOPIC_OF,
    TOPICS,
    VERSION,
    Packet,
    Vector,
    field_types,
)

MAX_BYTES = 4096  # the largest packet, telemetry of six axes with 32 reasons, has less than 2000

# ValueError: text that is not UTF-8.
_REFUSALS = (MsgspecError, ValueError, RecursionError, OverflowError)


class _Head(Struct, gc=False):
    """Keys that the decoder of a packet would let pass if they were missing."""

    packet: str
    version: int


class _Form(NamedTuple):
    """Remaining checks of a decoded packet."""

    head: bytes  # of the map, as most encoders write it
    head_length: int
    keys: tuple[str, ...]
    vectors: tuple[str, ...]  # the first is never nil
    vectors_of: Callable[[Packet], tuple[Any, ...]] | None  # None: there is only one
    names: tuple[str, ...]


def _form(kind: type[Packet]) -> _Form:
    types = field_types(kind)
    keys = ("packet", *types, "version")
    head = msgpack.Packer().pack_map_header(len(keys))
    vectors = tuple(name for name, hint in types.items() if hint in (Vector, Vector | None))
    vectors_of = attrgetter(*vectors) if len(vectors) > 1 else None
    names = tuple(name for name in types if name in NAMES)
    return _Form(head, len(head), keys, vectors, vectors_of, names)


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
_DECODE_HEAD = Decoder(_Head).decode

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
    if len(data) > MAX_BYTES:
        raise PacketError("malformed", f"expected at most {MAX_BYTES} bytes, got {len(data)}")
    try:
        packet = _DECODE[expected](data)
        _DECODE_HEAD(data)
    except _REFUSALS as error:
        raise _refusal(data, expected, str(error)) from None
    form = _FORMS[type(packet)]
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
    return packet


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
    # msgspec writes "Expected `float`, got `bool` - at `$.force[0]`".
    match = re.fullmatch(r"Expected (.*?)(?:, got .*)? - at `\$\.((\w+).*)`", fault)
    if match is None:
        return fault
    expected, path, name = match.groups()
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
    return PacketError("version", f"expected version {VERSION} of the wire format, got {version}")


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
