"""The live page of a graph in virtual time, in a browser without a window.

Nodes, page and what the server makes of the packets are those of ``forcebound launch --view``. But
time goes on from picture to picture, and nothing depends on the load of the machine.
"""

import base64
import importlib
import io
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any

import click
import numpy as np
from PIL import Image, ImageOps

from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import load
from forcebound.graph.names import parameter_name
from forcebound.graph.parameters import change, parameters
from forcebound.messages.control import DeviceStatus, Point, Pointed
from forcebound.messages.packets import TOPIC_OF, Event, Packet, Scene, Telemetry, Vector
from forcebound.messages.topology import node_name
from forcebound.nodes.device import DeviceNode
from forcebound.observe.kernels import Kernels
from forcebound.observe.page.controls import BROKEN, SAFE, Controls
from forcebound.observe.page.feed import SHOWN, Message
from forcebound.observe.page.lead import Lead
from forcebound.observe.page.reason import Reason
from forcebound.observe.page.server import PAGE
from forcebound.observe.page.shown import ShownGraph
from forcebound.run.process.reader import Received
from forcebound.run.results import run_metadata
from forcebound.run.run_directory import RunDocument, write_configuration
from forcebound.run.virtual import VirtualGraph

STEP = 0.02  # s between two looks at the graph
FRAME = 0.1  # s between two pictures of a film
LAST = 1.5  # s that its last one stays
MORNING_NS = 9 * 3600 * 10**9  # when virtual time begins, on the clock of the page
QUALITY, METHOD = 55, 5  # of its compression
JUDGED = 1.0  # s between two judgements of the hands, as the server has it
#: Time, socket and turns of the page are those of virtual time; software counts as a graphics card.
SCRIPT = """
let seconds = 0, socket;
performance.now = () => 1e3 * seconds;
window.requestAnimationFrame = () => 0; // nothing is drawn between two pictures
window.WebSocket = class extends EventTarget {
  static OPEN = 1;
  readyState = 1;
  constructor() { super(); socket = this; }
  send() {}
};
window.show = async (now, messages) => {
  seconds = now;
  const { scene, plots } = await import("/app.js");
  for (const data of messages) socket.dispatchEvent(new MessageEvent("message", { data }));
  while (scene.isLoading) await new Promise((done) => setTimeout(done, 20));
  for (const each of [scene, ...plots]) each.draw();
};
const plain = WebGL2RenderingContext.prototype.getParameter;
WebGL2RenderingContext.prototype.getParameter = function (name) {
  const value = plain.call(this, name);
  return typeof value === "string" ? "card" : value;
};
"""
PART = """
const place = (one) => document.querySelector(one).getBoundingClientRect();
const [first, last] = [...arguments].map(place);
return { x: first.x, y: first.y, width: last.right - first.x, height: last.bottom - first.y };
"""
QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-renderer-backgrounding", "--no-first-run",
)  # fmt: skip


class Compiled(Kernels):
    """The kernels of a graph in virtual time, whose own process has them."""

    def begin(self, laws: Iterable[str]) -> None:
        """Compile none."""


class VirtualControls(Controls):
    """What a page may know of a graph in virtual time, whose run directory has no process."""

    def __init__(self, run_dir: Path, name: str, config: GraphConfig) -> None:
        self._config, self._run_dir = config, run_dir
        self.devices: Mapping[str, DeviceNode] = {}
        metadata = run_metadata(config)
        RunDocument(0, None, "", [], metadata, name, graph=config.graph).write(run_dir)
        write_configuration(run_dir, config)
        hands = config.hands
        self.period = min(hand.servo.period_ns for hand in hands.values()) * 1e-9
        self.starts = {
            name: one["pointer"]["start"]
            for name, one in ((one["name"], one) for one in self.describe()["hands"])
            if one["pointer"]
        }
        self.is_started, self.episodes = False, {}
        self.energies_before = dict.fromkeys(hands, 0.0)
        self._reasons = {hand: Reason() for hand in hands}
        self._kernels = Compiled(run_dir)

    def _statuses(self, timeout: float) -> dict[str, DeviceStatus]:
        return {hand: device.status() for hand, device in self.devices.items()}


class VirtualPointer:
    """The pointer of a page, at a device in virtual time."""

    def __init__(self, device: DeviceNode) -> None:
        self._device = device
        self.place: Vector | None = None  # m

    def point(self, target: Vector) -> None:
        """Move the pointer to a place, in m."""
        answer = self._device.handle(Point(target))
        assert isinstance(answer, Pointed), answer
        self.place = answer.target


class VirtualPage:
    """A graph in virtual time, and the messages that its page gets."""

    def __init__(self, run_dir: Path, launch: str, words: Sequence[str]) -> None:
        self._run_dir, self._config = run_dir, load(launch, words)
        self._packets: list[Packet] = []
        controls = self._controls = VirtualControls(run_dir, launch, self._config)
        self._graph = VirtualGraph(self._config, self._packets.append, tuple(TOPIC_OF))
        controls.devices = self._graph.devices
        self._shown = ShownGraph(run_dir, controls, lambda _: None)
        self._shown.close()  # nothing is sent in this run directory
        shown: Any = self._shown
        shown.feed._reader, shown.feed._ahead_ns = self, MORNING_NS
        devices = self._graph.devices.items()
        shown.pointers = self.pointers = {hand: VirtualPointer(one) for hand, one in devices}
        shown._leads = {
            hand: Lead(self.pointers[hand].point, start, shown.feed.hands[hand].state)
            for hand, start in controls.starts.items()
        }
        self._signalling = {name.partition(".")[0] for name in self._shown.feed.signals}
        self.file = self._shown.feed.file
        self._next = 0.0

    def take(self) -> Iterator[Received]:
        """Give the packets since the last look, as a reader of the run directory does."""
        packets = self._packets.copy()
        self._packets.clear()
        for packet in packets:
            topic = TOPIC_OF[type(packet)]
            is_of_all = isinstance(packet, Scene | Event)
            name = topic if is_of_all else node_name(packet.hand, topic)
            if topic in SHOWN or name in self._signalling:
                yield Received(name, packet, b"")

    def close(self) -> None:
        """Close the nodes."""
        self._graph.close()

    def begin(self) -> list[Message]:
        """Return the messages before the first frame."""
        scene = self._shown.feed.foresee(self._controls.scene())
        first = [{**one, "may_change": True} for one in self._shown.describe()]
        return first if scene is None else [*first, scene]

    def run(self, seconds: float) -> list[Message]:
        """Let the graph run until a time, in s; return the messages since then."""
        self._graph.run(round(seconds * 1e9))
        if seconds >= self._next:
            self._next = seconds + JUDGED
            recent = {hand: one.recent for hand, one in self._shown.feed.hands.items()}
            self._shown.take_judged(self._controls.judge(recent))
        return self._shown.look(seconds)

    def press(self, button: str) -> list[Message]:
        """Press *Break it* or *Make it safe*."""
        settings = {
            parameter_name(hand, name): value
            for hand in self._graph.devices
            for name, value in {"break": BROKEN, "safe": SAFE}[button].items()
        }
        self._config = change(self._config, settings)
        self._graph.set(parameters(self._config))
        write_configuration(self._run_dir, self._config)
        if button == "safe":
            self._shown.press_again()
        return [self._controls.parameters()]


@dataclass(frozen=True)
class Take:
    """What a picture or a film shows.

    Attributes:
        launch: Name of a launch file.
        seconds: Duration, of virtual time.
        words: Arguments of the launch file.
        begin: When the first picture is taken, in s.
        moves: By hand, where its pointer is when: s, and m on each axis; straight in between.
        presses: Which button is pressed when: *break* or *safe*.
        query: Of the address: what the page shows, and how.
        part: Selectors of what is shown, from the top left of one to the bottom right of another.
        window: Of the browser, in pixels.
        shown: Pixels of the picture for each of the browser's.
        is_dark: Whether the page is dark.
        is_phone: Whether the browser is that of a phone.
    """

    launch: str
    seconds: float
    words: Sequence[str] = ()
    begin: float = 0.25
    moves: Mapping[str, Sequence[tuple[float, Vector]]] = field(default_factory=dict)
    presses: Sequence[tuple[float, str]] = ()
    query: str = ""
    part: tuple[str, str] = (".scene", ".stage")
    window: tuple[int, int] = (640, 900)
    shown: float = 1.0
    is_dark: bool = False
    is_phone: bool = False


@contextmanager
def browser(folder: str) -> Iterator[Any]:
    """Give Debian's Chromium without a window and without a graphics card."""
    webdriver = importlib.import_module("selenium.webdriver")  # in an extra of its own
    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for word in QUIET:
        options.add_argument(word)
    variables = {**os.environ, "HOME": folder, "TMPDIR": folder, "TZ": "UTC"}
    service = webdriver.ChromeService(shutil.which("chromedriver"), env=variables)
    driver = webdriver.Chrome(options, service)
    try:
        driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": SCRIPT})
        yield driver
    finally:
        driver.quit()


@contextmanager
def served(file: Callable[[str], Message | None]) -> Iterator[str]:
    """Serve the files of the page, and what ``file`` has of the scene's; give the address."""

    class Handler(SimpleHTTPRequestHandler):
        """A request of the page."""

        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments, directory=str(PAGE))

        def do_GET(self) -> None:
            """Answer it."""
            if not self.path.startswith("/file/"):
                super().do_GET()
                return
            self.send_response(200)
            self.end_headers()
            digest = self.path.removeprefix("/file/").partition("?")[0]
            self.wfile.write(json.dumps(file(digest)).encode())

        def log_message(self, *_: object) -> None:
            """Log nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def pictures(driver: Any, take: Take, frame: float = FRAME) -> Iterator[Image.Image]:
    """Give a picture each ``frame`` s of a take, from its ``begin`` on."""
    dark = {"name": "prefers-color-scheme", "value": "dark" if take.is_dark else "light"}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [dark]})
    (width, height), is_phone = take.window, take.is_phone
    size = {"width": width, "height": height, "deviceScaleFactor": take.shown, "mobile": is_phone}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    driver.execute_cdp_cmd("Emulation.setScrollbarsHidden", {"hidden": True})
    with opened(take) as page, served(page.file) as address:
        driver.get(f"{address}?{take.query}")
        show(driver, 0.0, page.begin())
        every, messages = round(frame / STEP), list[Message]()
        for step, more in enumerate(played(page, take), 1):
            messages += more
            if step % every == 0:
                show(driver, step * STEP, messages)
                messages = []
                if step * STEP > take.begin:
                    yield taken(driver, take)


@contextmanager
def opened(take: Take) -> Iterator[VirtualPage]:
    """Give the page of a take, with a run directory for a while."""
    with TemporaryDirectory(prefix="fb-") as folder:
        page = VirtualPage(Path(folder), take.launch, take.words)
        with closing(page):
            yield page


def move(pointers: Mapping[str, VirtualPointer], take: Take, seconds: float) -> None:
    """Move pointers to where they are at a time; after its last move the page may lead one."""
    for hand, moves in take.moves.items():
        times, places = zip(*moves, strict=True)
        if seconds < times[-1] + STEP:
            axes = zip(*places, strict=True)
            pointers[hand].point(tuple(float(np.interp(seconds, times, one)) for one in axes))


def played(page: VirtualPage, take: Take) -> Iterator[list[Message]]:
    """Give the messages of each step of a take."""
    presses = list(take.presses)
    for step in range(1, round(take.seconds / STEP) + 1):
        now, messages = step * STEP, list[Message]()
        while presses and presses[0][0] <= now:
            messages += page.press(presses.pop(0)[1])
        move(page.pointers, take, now)
        yield messages + page.run(now)


def end_of(take: Take) -> dict[str, list[float]]:
    """Return where the tips of the hands are after a take without presses, in m, on each axis."""
    tips: dict[str, list[float]] = {}

    def note(packet: Packet) -> None:
        assert isinstance(packet, Telemetry)
        tips[packet.hand] = [round(one, 6) for one in packet.true_position or packet.position]

    graph = VirtualGraph(load(take.launch, take.words), note, (Telemetry,), has_views=False)
    with closing(graph):
        pointers = {hand: VirtualPointer(device) for hand, device in graph.devices.items()}
        for step in range(1, round(take.seconds / STEP) + 1):
            move(pointers, take, step * STEP)
            graph.run(round(step * STEP * 1e9))
    return tips


def show(driver: Any, now: float, messages: Sequence[Message]) -> None:
    """Let the page take messages and draw what it shows at a time, in s."""
    texts = [json.dumps(one) for one in messages]
    driver.execute_async_script(
        "const [now, texts, done] = arguments; window.show(now, texts).then(done);", now, texts
    )


def taken(driver: Any, take: Take) -> Image.Image:
    """Return what the browser shows of a take."""
    clip = driver.execute_script(PART, *take.part) | {"scale": 1}
    asked = {"clip": clip, "captureBeyondViewport": True}
    shot = driver.execute_cdp_cmd("Page.captureScreenshot", asked)
    return Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB")


def film(driver: Any, take: Take, file: Path, most: int) -> None:
    """Write a take as a moving picture of at most so many bytes."""
    taken = list(pictures(driver, take))
    size = max(one.width for one in taken), max(one.height for one in taken)
    first, *more = (ImageOps.pad(one, size, color="white", centering=(0, 0)) for one in taken)
    lengths = [round(1e3 * FRAME)] * len(more) + [round(1e3 * LAST)]
    how: dict[str, Any] = {"duration": lengths, "loop": 0, "quality": QUALITY, "method": METHOD}
    first.save(file, save_all=True, append_images=more, **how)
    if file.stat().st_size > most:
        raise click.ClickException(f"{file} has {file.stat().st_size} B, more than {most}")
