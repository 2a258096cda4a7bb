"""A study in a real browser: a dragged hand, a command that is killed twice, every trial once."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from test_view_browser import CHROMIUM, DRIVER, browser
from waiting import until

from forcebound.lab.study.plan import SHIPPED
from forcebound.network import sockets
from forcebound.recordings.recording import read

CHANGES = {
    r"repetitions: 30": "repetitions: 2",
    r"repetitions: 3 }": "repetitions: 1 }",
    r"every: 15": "every: 0",
    r"touch_time: 2 s": "touch_time: 0.3 s",
    r"band: \[.*\]": "band: [1 mm/s, 2 m/s]",
}
TRIALS = 6

pytestmark = [
    pytest.mark.live,
    pytest.mark.xdist_group("processes"),
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs Debian's chromium-driver"),
]


@contextmanager
def session(folder: Path) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """The command, and the address of its page."""
    words = ["study", "run", "short.yaml", "--participant", "p01", "--no-open"]
    command = [sys.executable, "-u", "-m", "forcebound", *words]
    variables = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "TMPDIR": str(folder)}
    with subprocess.Popen(
        command, cwd=folder, env=variables, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline().split()[-1]
        finally:
            process.send_signal(signal.SIGINT)


class Participant:
    """Somebody who touches and answers; what they meet is what the page says."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def act(self) -> str:
        """Do what the page asks for now, and return what that was; it may change at any moment."""
        sockets.wait((), 50_000_000)  # a browser that is asked all the time fills a core
        kind = ""
        with suppress(WebDriverException):
            begin = self.driver.find_element("id", "begin")
            if begin.is_displayed():
                begin.click()
            for button in self.driver.find_elements("css selector", "#choices button")[:1]:
                button.click()
            kind = self.driver.execute_script("return document.body.dataset.kind")
            if kind in ("back", "go"):
                self.drag(0.5 if kind == "go" else -0.5)
        return kind

    def drag(self, way: float) -> None:
        """Drag the hand to the right by a share of the width of the scene."""
        scene = self.driver.find_element("id", "scene")
        pixels = round(way * scene.rect["width"] / 4)
        moves = webdriver.ActionChains(self.driver, duration=50).move_to_element(scene)
        moves.click_and_hold()
        for _ in range(4):
            moves.move_by_offset(pixels, 0)
        moves.release().perform()


def rows_in(folder: Path) -> list[dict[str, str]]:
    file = folder / "short" / "p01" / "trials.csv"
    if not file.exists():
        return []
    whole = file.read_text()
    return list(csv.DictReader(whole[: whole.rfind("\n") + 1].splitlines()))


def test_a_killed_study_goes_on_and_has_every_trial_once(tmp_path: Path) -> None:
    text = (SHIPPED / "friction.yaml").read_text()
    for old, new in CHANGES.items():
        text = re.sub(old, new, text, flags=re.MULTILINE)
    (tmp_path / "short.yaml").write_text(text)
    with browser() as driver:
        person = Participant(driver)

        def answered(count: int) -> bool:
            person.act()
            return len(rows_in(tmp_path)) >= count

        for goal in (2, 4):
            with session(tmp_path) as (process, address):
                driver.get(address)
                until(partial(answered, goal), f"{goal} answers")
                until(lambda: person.act() == "go", "the next touch")
                process.kill()
        with session(tmp_path) as (process, address):
            driver.get(address)
            until(lambda: answered(TRIALS), "the last answer")
            until(lambda: process.poll() is not None, "the command to end")
        assert driver.find_element("id", "title").text.startswith("Finished")
    rows = rows_in(tmp_path)
    assert [int(row["trial"]) for row in rows] == list(range(1, TRIALS + 1))
    assert {row["kind"] for row in rows} == {"rehearsal"}
    about = json.loads((tmp_path / "short" / "p01" / "participant.json").read_text())
    assert len(about["sessions"]) == 3
    for row in rows:
        for place in ("1", "2"):
            assert 0.001 <= float(row[f"speed_{place}"]) <= 2.0
            name = f"{int(row['trial']):04d}-{place}-{row[f'touches_{place}']}.mcap"
            recording = read(tmp_path / "short" / "p01" / "recordings" / name, ("event",))
            device = recording.launch["device"]
            assert (device["law"], device["hold_limit"]) == (row[f"law_{place}"], "auto")
