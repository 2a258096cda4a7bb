"""The emulated service of the Inverse3 as a program, with clients that are not ours: tornado's."""

import asyncio
import json
import os
import socket
import subprocess
import sys
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
import tornado.httpclient
import tornado.websocket
from test_inverse3_emulator import HAND, MODEL, command, configure, golden
from waiting import free_port, until

from forcebound.haptics.devices.truth_file import truth_beside
from forcebound.hardware.emulated import start

pytestmark = pytest.mark.live

SOON = 60.0  # s; a busy machine takes its time


class Client:
    """A session, and the settings over HTTP."""

    def __init__(self, socket: tornado.websocket.WebSocketClientConnection, url: str) -> None:
        self._socket, self._http = socket, url.replace("ws://", "http://")
        self.is_open = True

    async def next(self) -> Any:
        """Return the next message; None: the connection is closed."""
        text = await asyncio.wait_for(self._socket.read_message(), SOON)
        self.is_open = text is not None
        return None if text is None else json.loads(text)

    async def ask(self, message: Any, as_bytes: bool = False) -> Any:
        text = json.dumps(message).encode()
        with suppress(tornado.websocket.WebSocketClosedError):
            await self._socket.write_message(text if as_bytes else text.decode(), as_bytes)
        return await self.next()

    async def http(self, path: str, body: Any = None) -> Any:
        text = None if body is None else json.dumps(body)
        client = tornado.httpclient.AsyncHTTPClient(force_instance=True)
        method = "GET" if text is None else "POST"
        reply = await client.fetch(self._http + path, method=method, body=text, raise_error=False)
        client.close()
        return json.loads(reply.body)

    async def close(self) -> None:
        self._socket.close()
        while self.is_open:
            await self.next()


async def connected(url: str) -> Client:
    return Client(await tornado.websocket.websocket_connect(url), url)


def with_client(url: str, act: Callable[[Client], Awaitable[Any]]) -> Any:
    """Return what a coroutine returns, of a client whose inventory has not been read."""

    async def run() -> Any:
        client = await connected(url)
        try:
            return await act(client)
        finally:
            await client.close()

    return asyncio.run(run())


@contextmanager
def program(link: Path, *words: str) -> Iterator["subprocess.Popen[str]"]:
    """Start an emulator as in a terminal, and wait until it listens."""
    command = [sys.executable, "-m", "forcebound", "emulate", "haply_inverse3", "--link", str(link)]
    with subprocess.Popen(
        [*command, "--port", "0", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            until(lambda: link.is_symlink() or process.poll() is not None, "the emulator")
            yield process
        finally:
            process.kill()


def test_a_driver_starts_it_and_drives_it_with_its_truth_until_it_is_unused() -> None:
    emulator = start("haply_inverse3", MODEL, HAND)
    truth = truth_beside(emulator.link)
    assert truth is not None

    async def drive(client: Client) -> None:
        inventory = await client.next()
        assert inventory["inverse3"][0]["config"]["port"] == emulator.link
        for k in range(50):  # most clients in Python send bytes
            reply = await client.ask(golden("to_service/force_vector"), as_bytes=k % 2 == 1)
        assert reply["inverse3"][0]["state"]["current_cursor_force"]["z"] == 1.5
        found = truth.look()
        assert found is not None
        assert any(found.torque)
        gravity = await client.http("/inverse3/049D/config/gravity_compensation")
        assert gravity["data"]["enabled"]
        wanted = {"devices/force_scale": 0.5}
        assert (await client.http("/settings", wanted))["ok"]
        reply = await client.ask(golden("to_service/force_vector"))
        assert reply["inverse3"][0]["state"]["current_cursor_force"]["z"] == 0.75

    try:
        with_client(os.readlink(emulator.link), drive)
        until(lambda: not Path(emulator.link).is_symlink(), "the end of the emulator")
        assert truth_beside(emulator.link) is None
    finally:
        truth.close()
        emulator.close()


def test_it_restarts_on_demand_and_forgets_its_sessions(tmp_path: Path) -> None:
    link = tmp_path / "port"

    async def drive(client: Client) -> tuple[int, str]:
        inventory = await client.next()
        await client.http("/inverse3/049D/config/torque_scaling", {"enabled": False})
        message = golden("to_service/force_vector")
        message["inverse3"][0] |= configure(damping={"scalar": 1.0})["inverse3"][0]
        while await client.ask(message) is not None:
            await asyncio.sleep(0.01)
        until(lambda: not any(looked(truth).torque), "the end of the force")
        return inventory["session_id"], os.readlink(link)

    async def again(client: Client) -> Any:
        return await client.next()

    with program(link, "--fault", "restart:at=500ms,for=5s"):
        truth = truth_beside(str(link))
        assert truth is not None
        session, url = with_client(os.readlink(link), drive)
        until(lambda: listens(url), "the service")
        inventory = with_client(url, again)
        truth.close()
    config = inventory["inverse3"][0]["config"]
    assert inventory["session_id"] > session
    assert config["filters"]["damping"] == {"scalar": 0.0}
    assert config["torque_scaling"] == {"enabled": False}


def listens(url: str) -> bool:
    host, _, port = url.removeprefix("ws://").partition(":")
    with socket.socket() as found:
        return found.connect_ex((host, int(port))) == 0


def test_events_come_at_their_own_port(tmp_path: Path) -> None:
    link = tmp_path / "port"

    async def drive(client: Client) -> Any:
        await client.next()
        port = (await client.http("/settings/communication/events/port"))["data"]
        listener = await connected(f"ws://127.0.0.1:{port}")
        await client.ask({})
        event = await listener.next()
        await listener.close()
        return event

    with program(link, "--fault", "ebrake:at=0s"):
        event = with_client(os.readlink(link), drive)
    assert {**event, "message": ""} == {**golden("events/ebrake"), "message": ""}


def test_the_force_ends_with_a_last_message_a_close_and_half_a_connection(tmp_path: Path) -> None:
    """As a guardian leaves: it reads nothing any more."""
    link = tmp_path / "port"
    push = json.dumps(command({"set_cursor_force": {"vector": {"x": 0, "y": 0, "z": 1}}})).encode()
    zero = json.dumps(command({"set_cursor_force": {"vector": {"x": 0, "y": 0, "z": 0}}})).encode()

    def frame(code: int, text: bytes) -> bytes:  # with a mask of zeros
        size = bytes([0x80 | len(text)]) if len(text) < 126 else b"\xfe" + len(text).to_bytes(2)
        return bytes([0x80 | code]) + size + bytes(4) + text

    with program(link, "--idle", "20s"):
        truth = truth_beside(str(link))
        assert truth is not None
        port = int(os.readlink(link).rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port)) as client:
            lines = ("GET / HTTP/1.1", "Host: here", "Sec-WebSocket-Key: AAAA", "", "")
            client.sendall("\r\n".join(lines).encode() + frame(1, push))
            until(lambda: any(looked(truth).torque), "the force")
            client.sendall(frame(1, zero) + frame(8, b""))
            client.shutdown(socket.SHUT_WR)
            until(lambda: not any(looked(truth).torque), "its end")
        truth.close()


def looked(truth: Any) -> Any:
    found = truth.look()
    assert found is not None
    return found


def test_ctrl_c_ends_it_and_its_report_has_the_replies(tmp_path: Path) -> None:
    link = tmp_path / "port"

    async def drive(client: Client) -> None:
        await client.next()
        for _ in range(3):
            await client.ask({})

    with program(link) as process:
        with_client(os.readlink(link), drive)
        process.terminate()
        text, _ = process.communicate(timeout=SOON)
    assert "3 replies" in text
    assert process.returncode == 0
    assert not link.is_symlink()


def test_a_port_that_is_taken_is_refused_with_its_number(tmp_path: Path) -> None:
    port = free_port()
    with (
        socket.create_server(("127.0.0.1", port)),
        program(tmp_path / "port", "--port", str(port)) as process,
    ):
        text, _ = process.communicate(timeout=SOON)
    assert process.returncode == 2
    assert str(port) in text
    assert not (tmp_path / "port.truth").exists()


def test_the_hand_is_left_out_on_demand(tmp_path: Path) -> None:
    link = tmp_path / "port"
    with program(link, "--no-hand") as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert "identify" in process.stdout.readline()
        truth = truth_beside(str(link))
        assert truth is not None

        async def drive(client: Client) -> None:
            await client.next()
            for _ in range(100):
                await client.ask({})

        with_client(os.readlink(link), drive)
        assert looked(truth).truth.hand_force == pytest.approx((0.0, 0.0, 0.0))
        truth.close()
