"""The page in Firefox, by WebDriver BiDi; source: https://w3c.github.io/webdriver-bidi."""

import asyncio
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from typing import Any

import pytest
from live_page import pointed
from tornado.websocket import WebSocketClientConnection, websocket_connect

FIREFOX = shutil.which("firefox-esr") or shutil.which("firefox")
LISTENING = "WebDriver BiDi listening on "
TIMEOUT = 240.0  # s for one answer; a browser that starts on a busy machine takes long
ARROW_LEFT = "\ue012"
WINDOW = {"width": 1400, "height": 1000}

pytestmark = [
    pytest.mark.live,
    pytest.mark.slow,  # runs in `make browser`
    pytest.mark.xdist_group("processes"),
    pytest.mark.skipif(FIREFOX is None, reason="needs Debian's firefox-esr"),
]


class Tab:
    """One tab of a browser.

    Attributes:
        errors: What the page has logged as errors.
    """

    def __init__(self, socket: WebSocketClientConnection) -> None:
        self._socket, self._numbers = socket, count(1)
        self._name = ""
        self.errors: list[str] = []

    async def order(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Give a command; return its result."""
        number = next(self._numbers)
        order = {"id": number, "method": method, "params": parameters}
        await self._socket.write_message(json.dumps(order))
        while True:
            text = await asyncio.wait_for(self._socket.read_message(), TIMEOUT)
            assert text is not None, "the browser has ended"
            answer: dict[str, Any] = json.loads(text)
            if answer.get("method") == "log.entryAdded" and answer["params"]["level"] == "error":
                self.errors.append(answer["params"]["text"])
            if answer.get("id") == number:
                assert answer["type"] == "success", answer
                result: dict[str, Any] = answer["result"]
                return result

    async def open(self, address: str) -> None:
        """Open an address in a tab."""
        await self.order("session.new", capabilities={})
        await self.order("session.subscribe", events=["log.entryAdded"])
        self._name = (await self.order("browsingContext.create", type="tab"))["context"]
        await self.order("browsingContext.setViewport", context=self._name, viewport=WINDOW)
        await self.order(
            "browsingContext.navigate", context=self._name, url=address, wait="complete"
        )

    async def value(self, expression: str) -> Any:
        """The value of an expression of JavaScript; of a promise, when it is kept."""
        done = await self.order(
            "script.evaluate",
            expression=expression,
            target={"context": self._name},
            awaitPromise=True,
        )
        assert done["type"] == "success", done
        return done["result"].get("value")

    async def until(self, condition: str) -> None:
        """Wait in the page until an expression is true."""
        look = f"const look = () => {condition} ? resolve() : setTimeout(look, 50); look();"
        await self.value(f"new Promise((resolve) => {{ {look} }})")

    async def do(self, kind: str, actions: list[dict[str, Any]], **more: Any) -> None:
        """Act as a pointer or a keyboard."""
        source = {"type": kind, "id": kind, "actions": actions, **more}
        await self.order("input.performActions", context=self._name, actions=[source])

    async def drag(self, way: int, pointer: str) -> None:
        """Draw a pointer from the middle of the scene, some pixels to the right."""
        rect = "document.getElementById('scene').getBoundingClientRect()"
        x = round(await self.value(f"{{ const r = {rect}; r.x + r.width / 2 }}"))
        y = round(await self.value(f"{{ const r = {rect}; r.y + r.height / 2 }}"))
        moves = [{"type": "pointerMove", "x": x + way * step // 4, "y": y} for step in range(5)]
        press, release = {"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}
        actions = [moves[0], press, *moves[1:], release]
        await self.do("pointer", actions, parameters={"pointerType": pointer})


@asynccontextmanager
async def firefox() -> AsyncIterator[Tab]:
    with tempfile.TemporaryDirectory(prefix="fb-", dir="/tmp", ignore_cleanup_errors=True) as own:
        words = ["--headless", "--no-remote", "--remote-debugging-port", "0", "--profile", own]
        variables = {**os.environ, "TMPDIR": own, "XDG_RUNTIME_DIR": own, "HOME": own}
        pipe = subprocess.PIPE
        browser = subprocess.Popen(
            [str(FIREFOX), *words], env=variables, stderr=pipe, stdout=subprocess.DEVNULL, text=True
        )
        try:
            assert browser.stderr is not None
            lines = (line for line in browser.stderr if line.startswith(LISTENING))
            address = next(lines).removeprefix(LISTENING).strip()
            socket = await websocket_connect(f"{address}/session")
            yield Tab(socket)
            socket.close()
        finally:
            browser.terminate()
            browser.communicate()


def figure(name: str) -> str:
    """JavaScript for a figure of the page."""
    pairs = "[...document.querySelectorAll('#figures > div')].map((one) => one.children)"
    return f"parseFloat({pairs}.find(([dt]) => dt.textContent === '{name}')[1].textContent)"


def test_one_drags_breaks_and_mends_in_firefox() -> None:
    async def visit(address: str) -> None:
        async with firefox() as tab:
            await tab.open(address)
            await tab.until("document.body.dataset.state === 'passive'")
            await tab.until(f"{figure('position')} < 0")
            await tab.drag(260, "mouse")
            await tab.until(f"{figure('position')} > 10 && {figure('applied')} > 0.5")
            await tab.drag(-260, "touch")
            await tab.until(f"{figure('position')} < 10")
            for button, law in (("break", "none"), ("safe", "certified")):
                await tab.value(f"document.getElementById('{button}').click()")
                shown = (
                    f"document.getElementById('{button}').getAttribute('aria-pressed') === 'true'"
                )
                await tab.until(shown)
                assert await tab.value("document.querySelector('.law select').value") == law
            before = await tab.value(figure("position"))
            await tab.value("document.getElementById('scene').focus()")
            press = [{"type": kind, "value": ARROW_LEFT} for kind in ("keyDown", "keyUp")]
            await tab.do("key", press * 3)
            await tab.until(f"{figure('position')} < {before - 2}")
            assert tab.errors == []

    with pointed() as (graph, (address, _)):
        asyncio.run(visit(address))
        assert "law: none from now on" in graph.log
        assert "law: certified from now on" in graph.log
