"""How packets become bytes and back: strictly, with msgpack.

A packet on the wire is one msgpack map: ``"packet"`` (name of the topic), ``"version"`` and one key
per field of its dataclass; ``docs/protocol.md`` is the page for those who write a peer.

Strategy:

1. One table, made at import from the dataclasses, says for each packet its keys and how to read
   each value. A new packet or field needs no line here. Nothing is looked up in a dataclass, and
   nothing is copied without need, while the graph runs: both functions run about once a
   millisecond in each process, with cold caches, where a call costs several times its usual price.
2. :func:`encode` trusts its own side: it does not check values.
3. :func:`decode` trusts nobody: any bytes give a packet or a :class:`PacketError`. What could make
   msgpack allocate much is bounded before it starts: the size of the whole (``MAX_BYTES``), and the
   length that an array or map may claim. The reasons, in the order of the checks:

   ========= =====================================================================================
   malformed not one msgpack map with text keys: cut short, trailing bytes, too large or too deep
   version   another version of the wire format
   keys      a key is missing, unknown or given twice, or it is another packet than expected
   value     a value has the wrong type, range or length, or two vectors differ in length
   ========= =====================================================================================

Not-a-number and infinity *are* decoded: the safety chain of the device refuses and counts them.
"""

import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import msgpack

from forcebound.errors import PacketError
from forcebound.messages.packets import MAX_AXES, TOPIC_OF, TOPICS, VERSION, Packet, Vector

MAX_BYTES = 4096  # the largest packet, telemetry of six axes with 32 reasons, has less than 2000
MAX_LENGTH = 64  # of any array or map on the wire
MAX_COUNT = 2**63 - 1  # the largest 64-bit integer that every language has

_Reader: TypeAlias = Callable[[Any], Any]


class _UnfitError(Exception):
    """A value is not what it must be; the argument says what it must be."""


def _read_count(value: Any) -> int:
    if type(value) is int and 0 <= value <= MAX_COUNT:
        return value
    raise _UnfitError(f"an integer from 0 to {MAX_COUNT}")


def _read_number(value: Any) -> float:
    if type(value) is float:
        return value
    if type(value) is int:  # some encoders, such as JavaScript's, write 0.0 as the integer 0
        return float(value)
    raise _UnfitError("a number")


def _read_vector(value: Any) -> Vector:
    if type(value) is tuple and 1 <= len(value) <= MAX_AXES:
        for number in value:
            if type(number) is not float:
                break
        else:
            return value
        if all(type(number) is float or type(number) is int for number in value):
            return tuple(map(float, value))
    raise _UnfitError(f"an array of 1 to {MAX_AXES} numbers")


def _read_counts(value: Any) -> dict[str, int]:
    if type(value) is dict and all(
        type(key) is str and type(count) is int and 0 <= count <= MAX_COUNT
        for key, count in value.items()
    ):
        return value
    raise _UnfitError(f"a map from names to integers from 0 to {MAX_COUNT}")


def _optional(read: _Reader) -> _Reader:
    def read_optional(value: Any) -> Any:
        if value is None:
            return None
        try:
            return read(value)
        except _UnfitError as error:
            raise _UnfitError(f"{error} or nil") from None

    return read_optional


# By the type of the field; another kind of field needs its reader here.
_READERS: dict[Any, _Reader] = {
    int: _read_count,
    float: _read_number,
    Vector: _read_vector,
    Mapping[str, int]: _read_counts,
    int | None: _optional(_read_count),
    float | None: _optional(_read_number),
    Vector | None: _optional(_read_vector),
}


@dataclass(frozen=True, slots=True)
class _Form:
    """How one packet looks on the wire."""

    packet: type[Packet]
    topic: str
    keys: tuple[str, ...]  # all of them, in the order in which they are written
    to_map: Callable[[Packet], dict[str, Any]]
    readers: tuple[tuple[str, _Reader], ...]  # of all keys but the first two
    first_vector: str  # never nil
    other_vectors: tuple[str, ...]  # must be as long as the first


def _form(topic: str, packet: type[Packet]) -> _Form:
    types = {field.name: field.type for field in fields(packet)}
    vectors = [name for name, kind in types.items() if kind in (Vector, Vector | None)]
    # Written out once per class, as dataclasses do with __init__: a loop over names costs 3 times
    # as much. The names are those of our own fields.
    pairs = ", ".join(f"{name!r}: packet.{name}" for name in types)
    to_map = eval(f"lambda packet: {{'packet': {topic!r}, 'version': {VERSION}, {pairs}}}")
    return _Form(
        packet=packet,
        topic=topic,
        keys=("packet", "version", *types),
        to_map=to_map,
        readers=tuple((name, _READERS[kind]) for name, kind in types.items()),
        first_vector=vectors[0],
        other_vectors=tuple(vectors[1:]),
    )


_FORMS = {topic: _form(topic, packet) for topic, packet in TOPICS.items()}
_FORM_OF = {form.packet: form for form in _FORMS.values()}

_packer = msgpack.Packer()


def encode(packet: Packet) -> bytes:
    """Return ``packet`` as bytes; its values are not checked.

    Raises:
        KeyError: If ``packet`` is not an instance of one of the classes of ``TOPICS``.
        TypeError: If a value has a type that msgpack does not know.
    """
    data: bytes = _packer.pack(_FORM_OF[type(packet)].to_map(packet))
    return data


def decode(data: bytes | memoryview, expected: type[Packet] | None = None) -> Packet:
    """Return the packet that ``data`` holds.

    Args:
        data: One whole frame, contiguous.
        expected: The only class of packet that is accepted; None: any.

    Raises:
        PacketError: If ``data`` is anything else; ``reason`` as in the table at the head of this
            module, the message says what was expected and what came.
    """
    message = _unpack(data)
    version = message.get("version")
    if type(version) is not int or version != VERSION:
        raise _version_error(message)
    topic = message.get("packet")
    form = _FORMS.get(topic) if type(topic) is str else None
    if form is None or (expected is not None and form.packet is not expected):
        raise _name_error(topic, expected)
    if len(message) != len(form.keys) or _pair_count(data) != len(form.keys):
        raise _keys_error(form, message)
    values = []
    name = ""
    try:
        for name, read in form.readers:
            values.append(read(message[name]))
    except KeyError:
        raise _keys_error(form, message) from None
    except _UnfitError as error:
        got = reprlib.repr(message[name])
        raise PacketError("value", f"{form.topic}: {name} must be {error}, got {got}") from None
    if form.other_vectors:
        _check_axes(form, message)
    return form.packet(*values)


def _unpack(data: bytes | memoryview) -> dict[str, Any]:
    if len(data) > MAX_BYTES:
        raise PacketError("malformed", f"expected at most {MAX_BYTES} bytes, got {len(data)}")
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


def _pair_count(data: bytes | memoryview) -> int:
    """Return how many pairs the map ``data`` claims, which a key given twice does not show."""
    first = data[0]
    if first < 0xDE:  # the count is in the first byte
        return first & 0x0F
    return int.from_bytes(data[1:3] if first == 0xDE else data[1:5], "big")


def _check_axes(form: _Form, message: dict[str, Any]) -> None:
    axes = len(message[form.first_vector])
    for name in form.other_vectors:
        vector = message[name]
        if vector is not None and len(vector) != axes:
            raise PacketError(
                "value",
                f"{form.topic}: expected vectors of one length, "
                f"got {axes} axes in {form.first_vector} and {len(vector)} in {name}",
            )


def _version_error(message: dict[str, Any]) -> PacketError:
    if "version" not in message:
        return PacketError("keys", f"expected the key 'version', got {_listed(message)}")
    version = reprlib.repr(message["version"])
    return PacketError("version", f"expected version {VERSION} of the wire format, got {version}")


def _name_error(topic: Any, expected: type[Packet] | None) -> PacketError:
    names = f"'{TOPIC_OF[expected]}'" if expected is not None else f"one of {_listed(TOPICS)}"
    return PacketError("keys", f"expected as 'packet' {names}, got {reprlib.repr(topic)}")


def _keys_error(form: _Form, message: dict[str, Any]) -> PacketError:
    missing = [key for key in form.keys if key not in message]
    unknown = [key for key in message if key not in form.keys]
    faults = [f"missing {_listed(missing)}"] if missing else []
    if unknown:
        faults.append(f"unknown {_listed(unknown)}")
    got = " and ".join(faults) or "a key given twice"
    return PacketError("keys", f"{form.topic}: expected the keys {_listed(form.keys)}, got {got}")


def _listed(names: Any) -> str:
    return ", ".join(reprlib.repr(name) for name in names) or "none"
