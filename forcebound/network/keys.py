"""CURVE key pairs in files; the secret ones are for their owner alone.

A pair ``NAME`` is two files in the key folder, in the format of ``zmq.auth`` (ZPL)::

    NAME.key         the public key, 40 characters of Z85: give it to the other machine
    NAME.key_secret  both keys: stays on this machine

The key folder is ``$FORCEBOUND_KEYS``, else ``$XDG_CONFIG_HOME/forcebound/keys``, else
``~/.config/forcebound/keys``.

``zmq.auth.create_certificates`` writes secrets that everybody may read, and over those that are
there. Here a secret file is born readable by its owner only (``O_EXCL``, mode 0600) in a folder
that only the owner may enter, and never overwritten. As ssh does, a secret that others may read is
refused, and so is a public key that others can replace.
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
from zmq.utils import z85

from forcebound.errors import ConfigError
from forcebound.files import open_file, reason

PUBLIC = ".key"
SECRET = ".key_secret"
KEY_LENGTH = 40  # characters of Z85 for 32 bytes
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,38}")  # shorter than a key: never taken for one
_ENTRY = re.compile(r'^\s*(public|secret)-key\s*=\s*"?([^"\s]*)"?\s*$')
_MAX_FILE = 10_000  # bytes
_PUBLIC_TEXT = """\
#   ZeroMQ CURVE public certificate, made by forcebound
#   For the other machine. Send it so that nobody can replace it on the way.

metadata
curve
    public-key = "{public}"
"""
_SECRET_TEXT = """\
#   ZeroMQ CURVE **secret** certificate, made by forcebound
#   Stays on this machine, readable by its owner only.

metadata
curve
    public-key = "{public}"
    secret-key = "{secret}"
"""


@dataclass(frozen=True)
class KeyPair:
    """A name's two keys, each 40 characters of Z85. The secret one is never shown."""

    name: str
    public: str
    secret: str = field(repr=False)


@dataclass(frozen=True)
class KeyEntry:
    """One name of the key folder."""

    name: str
    public: str  # empty if it cannot be used
    has_secret: bool  # whether this machine holds it
    problem: str = ""  # why the key cannot be used
    action: str = ""  # what to do about that; empty if the problem says it


def check_key(key: str) -> None:
    """Check that a text can be the name of a key, or is a public key.

    Raises:
        ConfigError: If it is neither. Whether there is such a key is not looked for.
    """
    if not _is_key(key):
        _check_name(key)


def key_folder(variables: Mapping[str, str] = os.environ) -> Path:
    """Return where keys are kept; it need not exist.

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
    there = next(one for one in (folder, *folder.parents) if os.path.lexists(one))
    if not there.is_dir():
        raise ConfigError(
            f"keys are kept in the folder {folder}, but {there} is no folder; name another in"
            " FORCEBOUND_KEYS, or leave it unset"
        )
    return folder


def new_key(name: str, folder: Path | None = None) -> KeyPair:
    """Make a key pair and write its two files.

    Raises:
        ConfigError: If the name will not do, a file is there already or cannot be written.
    """
    folder = _folder(folder)
    _check_name(name)
    secret_file, public_file = folder / f"{name}{SECRET}", folder / f"{name}{PUBLIC}"
    for file in (secret_file, public_file):
        if os.path.lexists(file):
            raise ConfigError(f"{file} exists and is not overwritten: choose another name")
    public, secret = (key.decode("ascii") for key in zmq.curve_keypair())
    written: list[Path] = []
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        _check_folder(folder)
        text = _SECRET_TEXT.format(public=public, secret=secret)
        _create(secret_file, 0o600, text, written)
        _create(public_file, 0o644, _PUBLIC_TEXT.format(public=public), written)
    except OSError as error:
        for file in written:  # no half of a pair stays
            with suppress(OSError):
                file.unlink()
        raise ConfigError(f"cannot write the key {name} to {folder}: {error.strerror}") from None
    return KeyPair(name, public, secret)


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
    return _read(file)["public"]


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
    keys = _read(file)
    if "secret" not in keys:
        raise ConfigError(
            f"{file}: no secret-key in it; make a pair with `forcebound keys new NAME`"
        )
    if zmq.curve_public(keys["secret"].encode("ascii")).decode("ascii") != keys["public"]:
        raise ConfigError(f"{file}: public-key and secret-key are not of one pair")
    return KeyPair(name, keys["public"], keys["secret"])


def has_secret(key: str, folder: Path | None = None) -> bool:
    """Whether this machine holds the secret of a key, named or given as a public key."""
    folder = _folder(folder)
    if not _is_key(key):
        return _is_there(folder / f"{key}{SECRET}")
    return any(entry.public == key and entry.has_secret for entry in list_keys(folder))


def list_keys(folder: Path | None = None) -> list[KeyEntry]:
    """Return the keys of a folder by name; those that cannot be used say why."""
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
    try:  # five of its characters can say more than four bytes hold: struct.error
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
            f"{name!r} names no key: use 1 to 39 letters, digits, '.', '_' or '-', beginning with "
            f"a letter, digit or '_'; or a public key, {KEY_LENGTH} characters of Z85"
        )


def _check_folder(folder: Path) -> None:
    status = folder.stat()
    if status.st_uid not in (os.geteuid(), 0):
        raise ConfigError(f"{folder} belongs to another user", "choose a folder of your own")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        # A folder that others need, such as /tmp, is not to be closed to them.
        is_shared = status.st_uid != os.geteuid() or bool(status.st_mode & stat.S_ISVTX)
        action = f"chmod 700 {folder}"
        if is_shared or any(file.suffix not in (PUBLIC, SECRET) for file in folder.iterdir()):
            action = (
                "keep them in a folder of their own, mkdir -m 700 DIR, named by FORCEBOUND_KEYS"
            )
        raise ConfigError(f"others can replace the keys in {folder}", action)


def _create(file: Path, mode: int, text: str, written: list[Path]) -> None:
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    with open(os.open(file, flags, mode), "w", encoding="ascii") as stream:
        written.append(file)
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())


def _read(file: Path) -> dict[str, str]:
    """Return the keys in a file by kind; ``public`` is always there."""
    try:
        _check_folder(file.parent)
        # The file that is checked is the file that is read, whatever happens to its name.
        with open_file(file) as stream:
            _check_file(file, os.fstat(stream.fileno()))
            text = stream.read(_MAX_FILE).decode("utf-8", "replace")
    except OSError as error:
        raise ConfigError(f"cannot read the key file {file}: {reason(error)}") from None
    keys = {m[1]: m[2] for m in map(_ENTRY.match, text.splitlines()) if m is not None}
    if "public" not in keys:
        raise ConfigError(f'{file}: no line public-key = "..." in it')
    for kind, key in keys.items():
        if not _is_key(key):
            raise ConfigError(f"{file}: its {kind}-key is not {KEY_LENGTH} characters of Z85")
    return keys


def _check_file(file: Path, status: os.stat_result) -> None:
    if status.st_uid not in (os.geteuid(), 0):
        raise ConfigError(f"{file} belongs to another user", "use a key of your own")
    if file.suffix == SECRET and status.st_mode & 0o077:
        raise ConfigError(
            f"others can read the secret key {file} (mode {stat.S_IMODE(status.st_mode):04o})",
            f"chmod 600 {file}; if they may have done so: `forcebound keys new NAME`",
        )
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise ConfigError(f"others can replace the public key {file}", f"chmod 644 {file}")
