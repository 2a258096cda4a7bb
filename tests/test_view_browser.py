"""The page in a real browser: one drags the hand into the wall, breaks it, and makes it safe."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pytest
from live_graph import live_graph
from waiting import PATIENCE

webdriver: Any = pytest.importorskip("selenium.webdriver", reason="needs extra browser")
ui: Any = pytest.importorskip("selenium.webdriver.support.ui")

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--window-size=1400,1000",
)  # fmt: skip

pytestmark = [
    pytest.mark.live,
    pytest.mark.xdist_group("processes"),
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs Debian's chromium-driver"),
]


@contextmanager
def browser() -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for word in QUIET:
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with tempfile.TemporaryDirectory(prefix="fb-", dir="/tmp", ignore_cleanup_errors=True) as own:
        variables = {**os.environ, "TMPDIR": own, "XDG_RUNTIME_DIR": own, "HOME": own}
        service = webdriver.ChromeService(DRIVER, env=variables)
        driver = webdriver.Chrome(options=options, service=service)
        try:
            yield driver
        finally:
            driver.quit()


@contextmanager
def page_of(runtime: str) -> Iterator[str]:
    """The address of a page of the graph that runs."""
    command = [sys.executable, "-u", "-m", "forcebound", "view", "--no-open"]
    variables = {**os.environ, "XDG_RUNTIME_DIR": runtime}
    with subprocess.Popen(command, env=variables, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().split()[-1]
        finally:
            with suppress(ProcessLookupError):
                server.terminate()


def test_one_drags_the_hand_into_the_wall_breaks_it_and_makes_it_safe() -> None:
    with live_graph("pointer_wall", is_alone=False) as graph:
        graph.until(lambda: list(graph.runtime.glob("forcebound-*/control-launcher")), "a launcher")
        graph.until(lambda: graph.status()["phase"] == "running", "an engaged force")
        with page_of(str(graph.runtime)) as address, browser() as driver:
            driver.get(address)
            wait = ui.WebDriverWait(driver, PATIENCE)

            def figure(name: str) -> float:
                pairs = driver.execute_script(
                    "return [...document.querySelectorAll('#figures > div')]"
                    ".map((pair) => [...pair.children].map((one) => one.textContent))"
                )
                words = dict(pairs).get(name, "nan").split()[0]
                return float("nan") if words == "–" else float(words)

            wait.until(lambda _: figure("position") < 0.0)
            scene = driver.find_element("id", "scene")
            drag = webdriver.ActionChains(driver).move_to_element(scene).click_and_hold()
            drag.move_by_offset(80, 0).move_by_offset(80, 0).release().perform()
            wait.until(lambda _: figure("position") > 10.0 and figure("applied") > 0.5)

            driver.find_element("id", "break").click()
            graph.until(lambda: "law: none from now on" in graph.log, "the law to go")
            graph.wait(2.0)
            driver.find_element("id", "safe").click()
            graph.until(lambda: "law: certified from now on" in graph.log, "the law to come back")
            graph.wait(2.0)
            told = [line for line in driver.get_log("browser") if line["level"] == "SEVERE"]
            assert told == []
        ended = graph.end()

    columns = ended.columns
    (broken,) = [e for e in ended.events("law_changed") if e.data["law"] == "none"]
    (safe,) = [e for e in ended.events("law_changed") if e.data["law"] == "certified"]

    def swing(start_ns: int, end_ns: int) -> float:
        seen = (columns.time_ns > start_ns) & (columns.time_ns < end_ns)
        return float(np.ptp(columns.true_position[seen, 0]))

    second = 1_000_000_000
    assert swing(broken.time_ns + second, broken.time_ns + 2 * second) > 1e-3  # it bounces
    assert swing(safe.time_ns + second, safe.time_ns + 2 * second) < 2e-4  # it rests
