"""Keys in files: permissions and error messages."""

import os
import stat
from pathlib import Path

import pytest
import zmq
from invoking import invoke
from zmq.auth import create_certificates, load_certificate

from forcebound.errors import ConfigError
from forcebound.folders import cache_folder
from forcebound.network import keys
from forcebound.network.keys import has_secret, key_folder, key_pair, list_keys, new_key, public_key
from forcebound.observe import machine


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "config" / "keys"


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_secret_is_its_owners_alone_whatever_the_umask(folder: Path) -> None:
    before = os.umask(0)
    try:
        new_key("lab", folder)
    finally:
        os.umask(before)
    assert mode(folder) == 0o700
    assert mode(folder / "lab.key_secret") == 0o600
    assert mode(folder / "lab.key") & 0o022 == 0


def test_a_secret_is_never_open_to_others_while_it_is_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    masks: list[int] = []

    def create(where: Path, name: str) -> None:
        masks.append(os.umask(0o077))
        create_certificates(where, name)

    monkeypatch.setattr(keys, "create_certificates", create)
    new_key("lab", folder)
    assert masks == [0o077]


def test_zmq_reads_what_is_written_and_the_pair_is_one(folder: Path) -> None:
    made = new_key("lab", folder)
    public, secret = load_certificate(folder / "lab.key_secret")
    assert (public.decode(), (secret or b"").decode()) == (made.public, made.secret)
    assert load_certificate(folder / "lab.key") == (made.public.encode(), None)
    assert zmq.curve_public(made.secret.encode()).decode() == made.public
    assert key_pair("lab", folder) == made
    assert public_key("lab", folder) == made.public
    assert key_pair(made.public, folder) == made
    assert made.secret not in repr(made)
    assert made.secret not in (folder / "lab.key").read_text()


@pytest.mark.parametrize("existing", ["lab.key", "lab.key_secret"])
def test_nothing_is_overwritten(folder: Path, existing: str) -> None:
    folder.mkdir(parents=True, mode=0o700)
    (folder / existing).write_text("mine")
    with pytest.raises(ConfigError, match=rf"{existing} exists and is not overwritten"):
        new_key("lab", folder)
    assert [path.name for path in folder.iterdir()] == [existing]
    assert (folder / existing).read_text() == "mine"


def test_a_link_where_the_secret_should_be_is_not_followed(folder: Path, tmp_path: Path) -> None:
    folder.mkdir(parents=True, mode=0o700)
    (folder / "lab.key_secret").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ConfigError, match="not overwritten"):
        new_key("lab", folder)
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize("name", ["", "../lab", ".lab", "-lab", "a b", "a" * 40, "ä"])
def test_a_name_that_is_no_file_name_is_refused(folder: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="name of a key"):
        new_key(name, folder)
    with pytest.raises(ConfigError, match=r"name of a key|in no file"):
        key_pair(name, folder)


@pytest.mark.parametrize("bits", [0o640, 0o604])
def test_a_secret_that_others_may_read_is_refused(folder: Path, bits: int) -> None:
    new_key("lab", folder)
    (folder / "lab.key_secret").chmod(bits)
    with pytest.raises(ConfigError, match=r"others can read .*: chmod 600 .*lab.key_secret"):
        key_pair("lab", folder)
    (entry,) = list_keys(folder)
    assert entry.action.startswith("chmod 600")


def test_a_public_key_that_others_can_replace_is_refused(folder: Path) -> None:
    new_key("lab", folder)
    (folder / "lab.key").chmod(0o666)
    with pytest.raises(ConfigError, match=r"chmod 644 .*lab.key"):
        public_key("lab", folder)
    (folder / "lab.key").chmod(0o644)
    folder.chmod(0o777)
    with pytest.raises(ConfigError, match=r"chmod 700 .*keys"):
        public_key("lab", folder)
    with pytest.raises(ConfigError, match=r"chmod 700 .*keys"):
        new_key("other", folder)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")
def test_a_secret_of_another_user_is_refused(folder: Path) -> None:
    new_key("lab", folder)
    os.chown(folder / "lab.key_secret", 12345, -1)
    with pytest.raises(ConfigError, match="belongs to another user"):
        key_pair("lab", folder)


def test_a_missing_key_says_what_was_looked_for_and_what_to_type(folder: Path) -> None:
    with pytest.raises(ConfigError, match=r"looked for .*lab.key_secret.*forcebound keys new lab"):
        key_pair("lab", folder)
    with pytest.raises(ConfigError, match=r"looked for .*lab.key: .*forcebound keys new lab"):
        public_key("lab", folder)
    with pytest.raises(ConfigError, match="in no file of"):
        key_pair(zmq.curve_keypair()[0].decode(), folder)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "no line public-key"),
        ('curve\n    public-key = "short"\n', "not 40 characters"),
        ("\xff\xfe binary", "no line public-key"),
        ('curve\n    public-key = "{public}"\n', "no secret-key"),
        ('curve\n    public-key = "{public}"\n    secret-key = "{other}"\n', "not of one pair"),
    ],
)
def test_a_damaged_secret_is_refused(folder: Path, text: str, word: str) -> None:
    made, other = new_key("lab", folder), new_key("other", folder)
    text = text.replace("{public}", made.public).replace("{other}", other.secret)
    (folder / "lab.key_secret").write_text(text, encoding="latin-1")
    with pytest.raises(ConfigError, match=word):
        key_pair("lab", folder)


def test_a_secret_alone_also_gives_the_public_key(folder: Path) -> None:
    made = new_key("lab", folder)
    (folder / "lab.key").unlink()
    assert public_key("lab", folder) == made.public


def test_a_public_key_stands_for_itself(folder: Path) -> None:
    key = zmq.curve_keypair()[0].decode()
    assert public_key(key, folder) == key
    assert not has_secret(key, folder)


NO_KEY = "#" * 40  # characters of Z85, each group of five above 2**32


def test_forty_characters_that_hold_no_32_bytes_are_no_key(folder: Path) -> None:
    made = new_key("lab", folder)
    for text in (NO_KEY, "~" * 40, "\x00" * 40, "é" * 40):
        (folder / "other.key").write_text(f'curve\n    public-key = "{text}"\n', "utf-8")
        with pytest.raises(ConfigError, match=r"other\.key: "):
            public_key("other", folder)
        (first, second) = list_keys(folder)
        assert (first.name, first.public) == ("lab", made.public)
        assert (second.name, second.public) == ("other", "")
        assert key_pair(made.public, folder) == made
        for use in (public_key, key_pair):
            with pytest.raises(ConfigError, match="name of a key"):
                use(text, folder)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may enter every folder")
def test_a_folder_that_may_not_be_entered_is_said(folder: Path) -> None:
    new_key("lab", folder)
    folder.chmod(0o600)
    for use in (public_key, key_pair):
        with pytest.raises(ConfigError, match="Permission denied"):
            use("lab", folder)
    folder.chmod(0o700)


def test_keys_are_listed_with_those_of_others(folder: Path) -> None:
    assert list_keys(folder) == []
    made = new_key("lab", folder)
    new_key("server", folder)
    (folder / "server.key_secret").unlink()
    first, second = list_keys(folder)
    assert (first.name, first.public, first.has_secret) == ("lab", made.public, True)
    assert (second.name, second.has_secret, second.problem) == ("server", False, "")
    assert has_secret("lab", folder)
    assert has_secret(made.public, folder)


def test_the_folder_follows_the_environment() -> None:
    assert key_folder({"FORCEBOUND_KEYS": "/a/b"}) == Path("/a/b")
    assert key_folder({"XDG_CONFIG_HOME": "/c"}) == Path("/c/forcebound/keys")
    assert key_folder({}) == Path.home() / ".config" / "forcebound" / "keys"
    assert key_folder({"XDG_CONFIG_HOME": "relative"}) == key_folder({})


def test_without_a_home_folder_the_keys_and_the_completion_say_so_and_the_doctor_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("os.path.expanduser", lambda path: path)  # as without an entry in passwd
    for name in ("FORCEBOUND_KEYS", "XDG_CONFIG_HOME"):
        monkeypatch.delenv(name, raising=False)
    for words in (["keys", "list"], ["keys", "new", "lab"], ["completion", "bash"]):
        done = invoke(*words)
        assert done.exit_code == 2
        assert "no home folder" in done.stderr
    (finding,) = machine.key_folder()
    assert finding.severity == "note"
    assert "no home folder" in finding.seen
    assert "HOME" in finding.advice
    assert cache_folder("tests") != Path("~/.cache/forcebound/tests")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(ConfigError, match="cannot write the key lab"):
        new_key("lab", tmp_path / "keys")
