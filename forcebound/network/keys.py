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
from forcebound.files import reason

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
    """Check that a text is a valid name of a key, or a public key.

    Raises:
        ConfigError: If it is neither. Whether there is such a key is not checked.
    """
    if not _is_key(key):
        _check_name(key)


def key_folder(variables: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of the keys; it need not exist.

    Raises:
        ConfigError: If this user has no home and names no folder.
    """
    config = Path(variables.get("XDG_CONFIG_HOME", ""))
    try:
        if variables.get("FORCEBOUND_KEYS"):
            return Path(variables["FORCEBOUND_KEYS"]).expanduser()
        base = config if config.is_absolute() else Path.home() / ".config"  # by the XDG standard
    except RuntimeError as error:  # no such user, or no home
        raise ConfigError(f"no folder of keys ({error})", "name one in FORCEBOUND_KEYS") from None
    return base / "forcebound" / "keys"


def _folder(folder: Path | None) -> Path:
    folder = key_folder() if folder is None else folder
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise ConfigError(
            f"keys are kept in the folder {folder}, which is not a folder; name another in"
            " FORCEBOUND_KEYS, or leave it unset"
        )
    return folder


def new_key(name: str, folder: Path | None = None) -> KeyPair:
    """Make a key pair and write its two files.

    Raises:
        ConfigError: If the name is invalid, a file exists already or cannot be written.
    """
    folder = _folder(folder)
    _check_name(name)
    files = (folder / f"{name}{SECRET}", folder / f"{name}{PUBLIC}")
    for file in files:
        if os.path.lexists(file):
            raise ConfigError(f"{file} exists and is not overwritten: choose another name")
    umask = os.umask(0o077)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _check_folder(folder)
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
    _check_name(key)
    folder = _folder(folder)
    file = folder / f"{key}{PUBLIC}"
    if not _is_there(file):
        if _is_there(folder / f"{key}{SECRET}"):
            return key_pair(key, folder).public
        raise ConfigError(
            f"no public key {key!r}: looked for {file}. Copy {key}{PUBLIC} from the machine that "
            f"made it (`forcebound keys new {key}`), or write the {KEY_LENGTH} characters of the "
            "key in place of its name"
        )
    return _read(file)[0]


def key_pair(key: str, folder: Path | None = None) -> KeyPair:
    """Return the key pair of a name or a public key; this machine must hold its secret.

    Raises:
        ConfigError: If the secret is not here, is damaged, or others may read it.
    """
    folder = _folder(folder)
    name = key
    if _is_key(key):
        entries = list_keys(folder)
        name = next((e.name for e in entries if e.public == key and e.has_secret), "")
        if not name:
            raise ConfigError(f"the secret of the public key {key} is in no file of {folder}")
    _check_name(name)
    file = folder / f"{name}{SECRET}"
    if not _is_there(file):
        raise ConfigError(
            f"no secret key {name!r}: looked for {file}. Make a pair with `forcebound keys new "
            f"{name}`; if it is another machine's, this end needs a pair of its own"
        )
    public, secret = _read(file)
    if secret is None:
        raise ConfigError(
            f"{file}: no secret-key in it; make a pair with `forcebound keys new NAME`"
        )
    if zmq.curve_public(secret.encode("ascii")).decode("ascii") != public:
        raise ConfigError(f"{file}: public-key and secret-key are not of one pair")
    return KeyPair(name, public, secret)


def has_secret(key: str, folder: Path | None = None) -> bool:
    """Whether this machine holds the secret of a key, named or given as a public key."""
    folder = _folder(folder)
    if not _is_key(key):
        return _is_there(folder / f"{key}{SECRET}")
    return any(entry.public == key and entry.has_secret for entry in list_keys(folder))


def list_keys(folder: Path | None = None) -> list[KeyEntry]:
    """Return the keys of a folder by name; a key that cannot be used has a ``problem``."""
    folder = _folder(folder)
    files = [*folder.glob(f"*{PUBLIC}"), *folder.glob(f"*{SECRET}")] if folder.is_dir() else []
    entries = []
    for name in sorted({file.name.removesuffix(file.suffix) for file in files}):
        secret_here = folder / f"{name}{SECRET}" in files
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


def _is_there(file: Path) -> bool:
    try:
        file.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        raise ConfigError(f"cannot read the key file {file}: {reason(error)}") from None
    return True


def _check_name(name: str) -> None:
    if _NAME.fullmatch(name) is None:
        raise ConfigError(
            f"{name!r} is not a valid name of a key: use 1 to 39 letters, digits, '.', '_' or '-', "
            "not '.' or '-' first; or write a public key, 40 characters of Z85"
        )


def _check_folder(folder: Path) -> None:
    status = folder.stat()
    if status.st_uid not in (os.geteuid(), 0):
        raise ConfigError(f"{folder} belongs to another user", "choose a folder of your own")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise ConfigError(
            f"others can replace the keys in {folder}",
            f"chmod 700 {folder} if it is for keys only; else keep them in a folder of their own, "
            "mkdir -m 700 DIR, named by FORCEBOUND_KEYS",
        )


def _read(file: Path) -> tuple[str, str | None]:
    """Return the public and the secret key in a file; None: no secret key."""
    try:
        _check_folder(file.parent)
        _check_file(file)
        found = load_certificate(file)
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


def _check_file(file: Path) -> None:
    status = file.stat()
    if not stat.S_ISREG(status.st_mode):
        raise ConfigError(f"{file} is not a file")
    if status.st_uid not in (os.geteuid(), 0):
        raise ConfigError(f"{file} belongs to another user", "use a key of your own")
    if file.suffix == SECRET and status.st_mode & 0o077:
        raise ConfigError(
            f"others can read the secret key {file} (mode {stat.S_IMODE(status.st_mode):04o})",
            f"chmod 600 {file}; if they may have done so: `forcebound keys new NAME`",
        )
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise ConfigError(f"others can replace the public key {file}", f"chmod 644 {file}")
