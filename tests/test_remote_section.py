"""Launch files with an environment on another machine, and what they need of this one."""

import os
import socket
from pathlib import Path

import pytest
from click.testing import CliRunner
from waiting import free_port

from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.graph.graph import RemoteConfig
from forcebound.graph.loader import from_document, load
from forcebound.graph.resolved import to_document
from forcebound.run.worker import serve_environment

# --- Launch files and the command ----------------------------------------------------------------


def remote_file(folder: Path, remote: str) -> Path:
    file = folder / "remote.yaml"
    file.write_text(f"forcebound: 1\ninclude: stiff_wall.yaml\nremote: {remote}\n")
    return file


def test_a_launch_file_says_where_graph_and_environment_meet(tmp_path: Path) -> None:
    config = load(remote_file(tmp_path, "{address: '::1', port: 8000, listens: environment}"))
    assert config.only.remote is not None
    assert config.only.remote.end("graph").listens is False
    assert config.only.remote.end("environment").listens is True
    assert config.only.remote.end("environment").port == 8000


def test_the_section_survives_the_way_to_the_processes(tmp_path: Path) -> None:
    config = load(
        remote_file(tmp_path, "{address: 127.0.0.1, graph_key: c, environment_keys: [a, b]}")
    )
    assert from_document(to_document(config)) == config


@pytest.mark.parametrize(
    ("remote", "message"),
    [
        ("{}", "remote needs 'address'"),
        ("{address: 'tcp://a', port: 0}", r"(?s):3:19: .*tcp://.*:3:36: port"),  # both at once
        ("{address: a, listens: nobody}", "listens"),
        ("{address: '10.77.0.1:7410'}", r":3:19: .* the port, which belongs under port:"),
        ("{address: '[fd00::1]:7410'}", ":3:19: .* is not an address"),
        ("{address: 10.77.0.300}", r":3:19: address: '10.77.0.300' is not an address"),
        ("{address: '[10.77.0.1]'}", r":3:19: address: .* is not an address"),
        ("{address: 10.77.0.1}", r":3:19: address 10.77.0.1 is on a network, and without keys"),
        ("{address: a, graph_key: g, environment_keys: []}", r":3:33: environment_keys is missing"),
        ("{address: a, environment_keys: [e]}", r":3:40: graph_key is missing"),
        ("{address: a, graph_key: 'g g', environment_keys: [e]}", ":3:33: .*'g g' is not"),
        ("{address: a, graph_key: g, environment_keys: [e, -]}", ":3:58: .*'-' is not a"),
        ("{address: a, graph_key: g, environment_keys: [e, e]}", r":3:54: .* names a key twice"),
        (
            "{address: a, graph_key: g, environment_keys: [e, f], listens: environment}",
            ":3:54: .*only one",
        ),
        (
            "{address: a, graph_key: g, environment_keys: [e], insecure: true}",
            r":3:69: insecure: true means no keys",
        ),
    ],
)
def test_a_wrong_section_is_a_problem_of_the_launch_file(
    tmp_path: Path, remote: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        load(remote_file(tmp_path, remote))


@pytest.mark.parametrize(
    "address", ["192.168.1.20", "fd00::20", "[fd00::20]", "[fe80::1%eth0]", "lab-2.example.", "a_b"]
)
def test_an_address_is_a_number_or_a_name(tmp_path: Path, address: str) -> None:
    config = load(remote_file(tmp_path, f"{{address: '{address}', insecure: true}}"))
    assert config.only.remote is not None
    assert config.only.remote.address == address


def test_on_loopback_only_this_user_takes_part_unless_insecure_is_set(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(run_dir))
    section = RemoteConfig("localhost")
    graph, environment = section.end("graph"), section.end("environment")
    assert graph.key is not None
    assert environment.key is not None
    assert set(graph.peers) == {environment.key.public}
    assert set(environment.peers) == {graph.key.public}
    assert section.end("graph").key == graph.key  # as another process reads it
    for path in (run_dir / "forcebound").rglob("*.key_secret"):
        assert path.stat().st_mode & 0o077 == 0
    assert RemoteConfig("localhost", insecure=True).end("graph").key is None


def test_a_damaged_key_of_loopback_is_told_before_the_start(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(run_dir))
    section = RemoteConfig("localhost")
    section.check_here("environment")
    (secret,) = (run_dir / "forcebound").glob("*graph.key_secret")
    secret.write_text("")
    for check in (section.check_here, section.end):
        with pytest.raises(ConfigError, match=rf"(?s){secret.name}.* delete the folder"):
            check("graph")


def test_without_a_private_folder_loopback_is_not_left_open(
    run_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "")
    monkeypatch.setattr("tempfile.tempdir", str(run_dir))
    (run_dir / f"forcebound-run-{os.getuid()}").symlink_to(run_dir)
    monkeypatch.setattr("forcebound.folders.SESSIONS", run_dir)
    section = RemoteConfig("127.0.0.1")
    for check in (section.check_here, section.end):
        with pytest.raises(ConfigError, match="set XDG_RUNTIME_DIR"):
            check("graph")


# --- What a live run needs of this machine --------------------------------------------------------


@pytest.fixture
def key_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "keys"
    monkeypatch.setenv("FORCEBOUND_KEYS", str(folder))
    return folder


def refusal(file: Path, *words: str) -> str:
    """Return what is said to a launch and to its check, which is the same, and how they end."""
    said = []
    for more in ((), ("--check",)):
        result = CliRunner().invoke(main, ["launch", str(file), *words, *more])
        assert result.exit_code == 2, result.output
        said.append(result.stderr)
    assert said[0] == said[1]
    return said[0]


def test_keys_and_an_address_that_are_not_on_this_machine_are_told_before_anything_starts(
    tmp_path: Path, key_folder: Path
) -> None:
    remote = "{address: 192.0.2.77, graph_key: here, environment_keys: [there, far]}"
    said = refusal(remote_file(tmp_path, remote))
    assert f"remote.graph_key: no secret key 'here': looked for {key_folder}" in said
    assert "remote.environment_keys: no public key 'there'" in said
    assert "remote.environment_keys: no public key 'far'" in said
    assert said.count("no network interface of this machine has this address") == 1


def test_a_port_in_use_is_told_before_anything_starts(tmp_path: Path) -> None:
    port = free_port()
    file = remote_file(tmp_path, f"{{address: localhost, port: {port}}}")
    with socket.create_server(("127.0.0.1", port)):
        said = refusal(file)
        assert f"127.0.0.1 port {port}: the address is in use" in said
        with pytest.raises(ConfigError, match="in use"):
            load_remote(file).check_here("graph")
        load_remote(file).check_here("environment")  # which connects
    load_remote(file).check_here("graph")


def test_the_launch_file_of_the_page_is_complete(tmp_path: Path, key_folder: Path) -> None:
    page = (Path(__file__).parent.parent / "docs" / "remote.md").read_text()
    file = tmp_path / "remote.yaml"
    file.write_text(page.partition("```yaml\n")[2].partition("```")[0])
    said = refusal(file)  # it lacks what is not on this machine, and nothing else
    assert "remote.graph_key: no secret key 'device-lab'" in said
    assert "remote.environment_keys: no public key 'server-lab'" in said
    assert "remote.yaml" not in said


def load_remote(file: Path) -> RemoteConfig:
    remote = load(file).only.remote
    assert remote is not None
    return remote


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("forcebound: 1\ninclude: stiff_wall.yaml\n", "no section remote"),
        (
            "forcebound: 1\ninclude: stiff_wall.yaml\nremote: {address: 192.0.2.1}\n",
            "without keys",
        ),
    ],
)
def test_an_environment_that_cannot_serve_says_what_is_missing(
    tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "graph.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message):
        serve_environment(file)
