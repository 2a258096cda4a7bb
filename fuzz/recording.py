"""Fuzz target of recordings: any bytes give key figures and delays, or a ConfigError.

Run by ``make fuzz``; one input again: ``python fuzz/recording.py FILE``. One input in 64 is drawn,
too, since a figure takes a second.
"""

import io
import json
import logging
import sys
import tempfile
import zlib
from importlib import import_module
from pathlib import Path

import atheris

import_module("forcebound.haptics.devices")  # before: numba cannot compile what atheris has changed

with atheris.instrument_imports(  # pyright: ignore[reportAttributeAccessIssue]
    include=[
        "forcebound.results",
        "forcebound.recordings.delay_traces",
        "forcebound.haptics.environments.recorded",
        "forcebound.recordings.hops",
        "forcebound.mcap_file",
        "forcebound.recordings.recording",
        "mcap",
    ]
):
    from forcebound.errors import ConfigError
    from forcebound.files import content_of
    from forcebound.haptics.environments.recorded import RecordedEnvironment
    from forcebound.messages.packets import TOPICS
    from forcebound.messages.topology import LINKS
    from forcebound.recordings.delay_traces import as_link_trace, of_recording, read_trace
    from forcebound.recordings.recording import read
    from forcebound.results.plots import figure
    from forcebound.results.tables import phase_rows, summary_rows
    from forcebound.run.results import RunResult

FILE = Path(tempfile.mkdtemp(prefix="forcebound-fuzz-")) / "run.mcap"
DRAWN = 64  # one input in so many

logging.disable(logging.WARNING)  # that a recording is incomplete


def one(data: bytes) -> None:
    """Read it as a file, as each command does; see the head of this file."""
    FILE.write_bytes(data)
    for use in (packets, delays, hops, answers, plot):
        try:
            use(data)
        except ConfigError as error:
            assert len(str(error)) < 10_000, len(str(error))


def packets(data: bytes) -> None:
    """Read the packets of each topic."""
    recording = read(FILE)
    for topic in TOPICS:
        try:
            recording.packets(topic)
        except ConfigError:
            continue


def delays(data: bytes) -> None:
    """Make a trace, as ``delay`` does."""
    trace, document, _ = of_recording(FILE)
    as_link_trace(trace, document)


def hops(data: bytes) -> None:
    """Make a trace of one link, as ``replay --network`` does."""
    read_trace(FILE, LINKS[1])


def answers(data: bytes) -> None:
    """Read what an environment answered, as ``replay --environment`` does."""
    opened = RecordedEnvironment(FILE).open(1)
    opened.force("", (0.0,), (0.0,), 0.1)
    opened.contact("")


def plot(data: bytes) -> None:
    """Find the key figures, as ``plot`` does, and sometimes draw them."""
    result = RunResult.from_recording(FILE)
    with content_of(FILE):
        summary = result.summary
        summary_rows(summary)
        phase_rows(summary["phases"])
    json.dumps(summary, allow_nan=False)
    if zlib.crc32(data) % DRAWN == 0:
        drawing = figure([(result.label, result.columns, result.document)], events=[result.events])
        drawing.savefig(io.BytesIO(), format="png", dpi=30)


if __name__ == "__main__":
    atheris.Setup(sys.argv, one)
    atheris.Fuzz()
