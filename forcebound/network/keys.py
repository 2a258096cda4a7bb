"""CURVE key pairs in files; only the owner may read the secret ones.

A pair ``NAME`` is two files in the key folder, in the format of ``zmq.auth`` (ZPL)::

    NAME.key         the public key, 40 characters of Z85: give it to the other machine
    NAME.key_secret  both keys: stays on this machine

The key folder is ``$FORCEBOUND_KEYS``, else ``$XDG_CONFIG_HOME/forcebound/keys``, else
``~/.config/forcebound/keys``.

``zmq.auth.create_certificates`` alone writes secrets that everybody may read, and over existing
files. Here it runs under umask 077 in a folder that only the owner may enter, and nothing is
overwritten. As ssh does, a secret that others may read is refused, and so is a public key that
others can replace.
"""

import os
import re
import stat
import struct
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import zmq
from zmq.auth import create_certificates, load_certificate
from zmq.utils import z85

from forcebound.errors import ConfigError
from forcebound.files import open_file, reason
from forcebound.folders import home_folder

PUBLIC = ".key"
SECRET = ".key_secret"
KEY_LENGTH = 40  # characters of Z85 for 32 bytes
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,38}")  # shorter than a key: never taken for one


@dataclass(frozen=True)
class KeyPair:
    """A named pair of keys, each 40 characters of Z85. The secret key is never shown."""

    name: str
    public: str
    secret: str = field(repr=False)


@dataclass(frozen=True)
class KeyEntry:
    """One name of the key folder."""

    name: str
    public: str  # empty if it cannot be used
    has_secret: bool  # whether this machine holds the secret
    problem: str = ""  # why the key cannot be used
    action: str = ""  # what to do about it; empty if the problem states it


def check_key(key: str) -> None:
    """Check that a text may be a name of a key, or is a public key; else ConfigError."""
    if not _is_key(key):
        _check_name(key)


def key_folder(variables: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of the keys; it need not exist. ConfigError without a home folder."""
    if variables.get("FORCEBOUND_KEYS"):
        return Path(os.path.expanduser(variables["FORCEBOUND_KEYS"]))
    config = Path(variables.get("XDG_CONFIG_HOME", ""))
    base = config if config.is_absolute() else home_folder() / ".config"  # by the XDG standard
    return base / "forcebound" / "keys"


def new_key(name: str, folder: Path | None = None) -> KeyPair:
    """Make a key pair and write its two files.

    Raises:
        ConfigError: If the name is invalid, a file exists already or cannot be written.
    """
    folder = folder or key_folder()
    _check_name(name)
    files = (folder / f"{name}{SECRET}", folder / f"{name}{PUBLIC}")
    for file in files:
        if os.path.lexists(file):
            raise ConfigError(f"{file} exists and is not overwritten: choose another name")
    umask = os.umask(0o077)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _check_mode(folder)
        create_certificates(folder, name)
    except OSError as error:
        for file in files:  # leave no half of a pair
            with suppress(OSError):
                file.unlink()
        raise ConfigError(f"cannot write the key {name} to {folder}: {error.strerror}") from None
    finally:
        os.umask(umask)
    return key_pair(name, folder)


def public_key(key: str, folder: Path | None = None) -> str:
    """Return a public key, 40 characters of Z85, for its name or for such a key itself.

    Raises:
        ConfigError: If there is no such key, or others may change it.
    """
    if _is_key(key):
        return key
    folder = folder or key_folder()
    if has_secret(key, folder) and not os.path.exists(folder / f"{key}{PUBLIC}"):
        return key_pair(key, folder).public
    advice = (
        f"copy {key}{PUBLIC} from the machine that made it (`forcebound keys new {key}`), or write "
        f"the {KEY_LENGTH} characters of the key in place of its name"
    )
    return _read(folder, key, PUBLIC, advice)[0]


def key_pair(key: str, folder: Path | None = None) -> KeyPair:
    """Return the key pair of a name or a public key; this machine must hold its secret.

    Raises:
        ConfigError: If the secret is not here, is damaged, or others may read it.
    """
    folder = folder or key_folder()
    name = key
    if _is_key(key):
        name = next((e.name for e in list_keys(folder) if e.public == key and e.has_secret), "")
        if not name:
            raise ConfigError(f"the secret of the public key {key} is in no file of {folder}")
    advice = (
        f"make a pair with `forcebound keys new {name}`; if it is another machine's, this end "
        "needs a pair of its own"
    )
    public, secret = _read(folder, name, SECRET, advice)
    file = folder / f"{name}{SECRET}"
    if secret is None:
        raise ConfigError(f"{file}: no secret-key in it", "make a pair with `forcebound keys new`")
    if zmq.curve_public(secret.encode("ascii")).decode("ascii") != public:
        raise ConfigError(f"{file}: public-key and secret-key are not of one pair")
    return KeyPair(name, public, secret)


def has_secret(key: str, folder: Path | None = None) -> bool:
    """Return whether this machine holds the secret of a key, named or given as a public key."""
    folder = folder or key_folder()
    if not _is_key(key):
        return os.path.exists(folder / f"{key}{SECRET}")
    return any(entry.public == key and entry.has_secret for entry in list_keys(folder))


def list_keys(folder: Path | None = None) -> list[KeyEntry]:
    """Return the keys of a folder by name; a key that cannot be used has a ``problem``."""
    folder = folder or key_folder()
    names = {file.stem for ending in (PUBLIC, SECRET) for file in folder.glob(f"*{ending}")}
    entries = []
    for name in sorted(names):
        secret_here = has_secret(name, folder)
        try:
            public = key_pair(name, folder).public if secret_here else public_key(name, folder)
        except ConfigError as error:
            entries.append(KeyEntry(name, "", secret_here, error.problem, error.action))
        else:
            entries.append(KeyEntry(name, public, secret_here))
    return entries


def _is_key(text: str) -> bool:
    """Return whether this is a key: five characters of Z85 for each four bytes."""
    try:  # five characters can encode more than four bytes hold: struct.error
        return len(text) == KEY_LENGTH and len(z85.decode(text)) == 32
    except (KeyError, ValueError, struct.error):
        return False


def _check_name(name: str) -> None:
    if _NAME.fullmatch(name) is None:
        raise ConfigError(
            f"{name!r} is not a valid name of a key: use 1 to 39 letters, digits, '.', '_' or '-', "
            "not '.' or '-' first; or write a public key, 40 characters of Z85"
        )


def _check_mode(path: Path) -> None:
    """Check that no other user may replace a file or folder of keys, or read a secret."""
    status = path.stat()
    if status.st_uid not in (os.geteuid(), 0):
        raise ConfigError(f"{path} belongs to another user", "use a folder and keys of your own")
    if path.suffix == SECRET and status.st_mode & 0o077:
        raise ConfigError(
            f"others can read the secret key {path} (mode {stat.S_IMODE(status.st_mode):04o})",
            f"chmod 600 {path}; if they may have done so: `forcebound keys new NAME`",
        )
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        own = f"chmod 700 {path} if it is for keys only"
        raise ConfigError(
            f"others can replace {path}", own if path.is_dir() else f"chmod 644 {path}"
        )


def _read(folder: Path, name: str, ending: str, advice: str) -> tuple[str, str | None]:
    """Return the public and the secret key in a file; None: no secret key."""
    _check_name(name)
    file = folder / f"{name}{ending}"
    try:
        _check_mode(folder)
        open_file(file).close()
        _check_mode(file)
        found = load_certificate(file)
    except FileNotFoundError:
        kind = "secret" if ending == SECRET else "public"
        raise ConfigError(f"no {kind} key {name!r}: looked for {file}", advice) from None
    except OSError as error:
        raise ConfigError(f"cannot read the key file {file}: {reason(error)}") from None
    except ConfigError:  # a ValueError, too
        raise
    except (ValueError, IndexError):  # IndexError: a line without "="
        raise ConfigError(f'{file}: no line public-key = "..." in it') from None
    public, secret = (None if key is None else key.decode("ascii", "replace") for key in found)
    for kind, key in (("public", public), ("secret", secret)):
        if key is not None and not _is_key(key):
            raise ConfigError(f"{file}: its {kind}-key is not {KEY_LENGTH} characters of Z85")
    return public or "", secret
