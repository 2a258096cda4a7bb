"""JSON schemas of recorded packets, with units, for Foxglove and PlotJuggler.

They use one type per field, since Foxglove rejects a list of types, and say nothing of arrays
within arrays (the points of a path), which it rejects, too.
"""

from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec

from forcebound.messages.packets import (
    MAX_AXES,
    Packet,
    Point,
    Quaternion,
    Vector,
    field_types,
)
from forcebound.topology import HAND

DESCRIPTIONS: dict[str, str] = {
    "hand": "hand to whose loop the packet belongs; absent: the only one, or all",
    "seq": "count of this packet at its sender, from 0",
    "time_ns": "sender's monotonic clock, ns",
    "elapsed": "time since the force engaged for the first time, s; 0 before",
    "position": "position read, m; grows into the environment",
    "velocity": "velocity, m/s; filtered backward difference of the readings",
    "force": "force, N; positive resists motion in the positive direction",
    "device_seq": "seq of the device state that is answered",
    "device_time_ns": "time_ns of the device state that is answered, device's clock, ns",
    "query_seq": "seq of the query that is answered",
    "query_time_ns": "time_ns of the query that is answered, controller's clock, ns",
    "reply_time_ns": "device_time_ns of the environment's reply in use, device's clock, ns",
    "commanded_force": "commanded force, N; after age limit and engage ramp, before saturation",
    "applied_force": "applied force, N; written to the motor; of an arm what its torques give",
    "force_limit": "limit force, N; largest magnitude that law and saturation allow",
    "estimated_energy": "energy in the ledger of the law, J",
    "true_energy": "energy that the hand has put into a simulated device, J; ground truth",
    "true_position": "unquantised position of a simulated device, m",
    "hand_force": "force of the simulated hand on the device, N",
    "engagement": "factor of the engage ramp, 0 to 1",
    "loop_delay": "time from the answered device state to this write, s",
    "deadline_misses": "ticks skipped so far",
    "rejected": "packets rejected so far, by reason",
    "read_ns": "when the position was read, device's clock, ns",
    "write_ns": "from when on the force acts, device's clock, ns",
    "ahead_ns": "by which the bounder's clock is ahead of the device's, ns: what was uncertain",
    "reply_age": "time from the state that the environment's reply in use answers to this write, s",
    "joints": "angles of an arm, rad",
    "torques": "torques of an arm, N m; written to its motors",
    "cut_ns": "when the watchdog dropped the force before this one, device's clock, ns",
    "cut_position": "position when the watchdog dropped the force, m; of an arm its angles",
    "orientation": "orientation of the tip, unit quaternion w x y z",
    "buttons": "buttons of the device; bit i: button i is down",
    "proxy": "where the tip would be if it could enter nothing, m; absent: free motion",
    "normal": "outward unit normal at the proxy",
    "objects": "what there is to draw, m",
    "proxies": "where the virtual tips are, m, by hand; a hand in free motion has none",
    "environment": "name of an environment; in a query, of the serving one",
    "node": "process that sent the event",
    "event": "kind of event, one word",
    "is_fault": "whether the event is a fault",
    "message": "description for people",
    "data": "details for programs",
}  # meaning and unit of the packets' fields, for the schemas

#: Fields that a message may lack beside those without a value, and what that means.
ABSENT: dict[str, Any] = {"hand": HAND, "proxies": {}}

_UNITS_OF = {
    "s": ("elapsed", "loop_delay", "reply_age"),
    "m": ("position", "true_position", "proxy", "proxies", "objects", "cut_position"),
    "rad": ("joints",),
    "N m": ("torques",),
    "m/s": ("velocity",),
    "N": ("force", "commanded_force", "applied_force", "force_limit", "hand_force"),
    "J": ("estimated_energy", "true_energy"),
}
_UNIT_OF = {name: unit for unit, names in _UNITS_OF.items() for name in names}

#: Unit of each field; "" for a count, a share or a text.
UNITS: dict[str, str] = {
    name: "ns" if name.endswith("_ns") else _UNIT_OF.get(name, "") for name in DESCRIPTIONS
}


def schema(packet: type[Packet]) -> dict[str, Any]:
    """Return the jsonschema of a packet: types, units and meaning of its fields."""
    types = field_types(packet)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"forcebound.{packet.__name__}",
        "description": (packet.__doc__ or "").strip().splitlines()[0],
        "type": "object",
        "properties": {
            name: _field_schema(hint) | {"description": DESCRIPTIONS[name]}
            for name, hint in types.items()
        },
        "required": [n for n, hint in types.items() if not is_optional(hint) and n not in ABSENT],
    }


def is_optional(hint: Any) -> bool:
    """Return whether a field may have no value."""
    return type(None) in get_args(hint)


def plain_type(hint: Any) -> Any:
    """Return the type of a field that has a value."""
    return get_args(hint)[0] if is_optional(hint) else hint


def _field_schema(hint: Any) -> dict[str, Any]:
    plain = plain_type(hint)
    if plain is int:
        return {"type": "integer"}
    if plain is float:
        return {"type": "number"}
    if plain is bool:
        return {"type": "boolean"}
    if plain is str:
        return {"type": "string"}
    if plain == Vector:
        return _numbers(1, MAX_AXES)
    if plain in (Point, Quaternion):
        return _numbers(len(get_args(plain)), len(get_args(plain)))
    if get_origin(plain) is Literal:
        return {"type": "string"}
    if get_origin(plain) is tuple:
        return {"type": "array", "items": _object_schema(get_args(plain)[0])}
    # Foxglove reads ``properties`` of every object, also of an empty one.
    _, entry = get_args(plain)
    return {"type": "object", "properties": {}, "additionalProperties": _field_schema(entry)}


def _numbers(fewest: int, most: int) -> dict[str, Any]:
    return {"type": "array", "items": {"type": "number"}, "minItems": fewest, "maxItems": most}


def _object_schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    hints = get_type_hints(kind)
    described = {name: _field_schema(hints[name]) for name in hints if name != "points"}
    required = [field.name for field in msgspec.structs.fields(kind) if field.required]
    return {"type": "object", "properties": described, "required": required}
