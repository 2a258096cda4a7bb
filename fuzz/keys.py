"""Fuzz target of key files: any bytes give keys or a ConfigError, and hide no other key.

Run by ``make fuzz``; one input again: ``python fuzz/keys.py FILE``.
"""

import sys
import tempfile
from pathlib import Path

import atheris
import zmq

with atheris.instrument_imports(  # pyright: ignore[reportAttributeAccessIssue]
    include=["forcebound.network.keys", "zmq.auth.certs", "zmq.utils.z85"]
):
    from forcebound.errors import ConfigError
    from forcebound.network.keys import check_key, key_pair, list_keys, new_key, public_key

FOLDER = Path(tempfile.mkdtemp(prefix="forcebound-fuzz-"))
MADE = new_key("sound", FOLDER)
FILES = (FOLDER / "found.key", FOLDER / "found.key_secret")


def one(data: bytes) -> None:
    """Read it as a public and as a secret key, and as what a launch file names."""
    for file in FILES:
        file.write_bytes(data)
        file.chmod(0o600)
        for read in (public_key, key_pair):
            try:
                found = read("found", FOLDER)
            except ConfigError as error:
                assert len(str(error)) < 10_000, len(str(error))
                continue
            key = found if isinstance(found, str) else found.public
            zmq.curve_public(key.encode("ascii"))  # libzmq takes it for a key
        assert {entry.name: entry.public for entry in list_keys(FOLDER)}["sound"] == MADE.public
        file.unlink()
    try:
        check_key(data.decode("utf-8", "replace"))
    except ConfigError as error:
        assert len(str(error)) < 20_000 + 4 * len(data), len(str(error))


if __name__ == "__main__":
    atheris.Setup(sys.argv, one)
    atheris.Fuzz()
