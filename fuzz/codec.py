"""Fuzz target of the codec: any bytes give a packet, which encodes back, or a PacketError.

Run by ``make fuzz``; one input again: ``python fuzz/codec.py FILE``.
"""

import sys

import atheris

with atheris.instrument_imports(include=["forcebound.messages", "msgpack"]):  # pyright: ignore[reportAttributeAccessIssue]
    from forcebound.errors import PacketError
    from forcebound.messages.codec import decode, encode
    from forcebound.messages.packets import TOPIC_OF

REASONS = {"malformed", "version", "value"}


def one(data: bytes) -> None:
    """Decode as any packet and as each kind; see the head of this file."""
    for expected in (None, *TOPIC_OF):
        try:
            packet = decode(data, expected)
        except PacketError as error:
            assert error.reason in REASONS, error.reason
            assert len(str(error)) < 2000, len(str(error))
            continue
        assert expected in (None, type(packet))
        again = decode(encode(packet))
        assert repr(again) == repr(packet), (packet, again)  # repr: not-a-number equals itself


if __name__ == "__main__":
    atheris.Setup(sys.argv, one)
    atheris.Fuzz()
