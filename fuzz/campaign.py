"""Fuzz codec, launch files, recordings and keys for a while each: ``make fuzz FUZZ_SECONDS=600``.

Inputs that reach new code are kept in ``results/fuzz/TARGET/corpus`` and the next campaign goes on
from them; inputs that broke something are kept beside it and printed. Exit status: 0 nothing was
found, 1 something was, 2 atheris is missing.
"""

import argparse
import importlib.util
import io
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
LAUNCH_FILES = sorted((ROOT / "launch").glob("*.yaml"))
TARGETS = ("codec", "launch_file", "recording", "keys")

PAIR = (  # keys of nobody
    "0vD2B}d>Ih{WK6igW}zPWdpNP(gc6vi(/#BycP/J",
    "pjTWXhGC4O]jL]uS<J=d:l:7<Tblm(fFgJ}o-}+^",
)
LAUNCH = {
    "device": {"law": "certified", "rate": 1000.0, "hold_limit": 1.25, "reply_wait": 0.4},
    "environment": {"kind": "wall", "position": 0.01, "stiffness": 10000.0},
}
TELEMETRY = {
    "elapsed": 0.001,
    "position": [0.011],
    "commanded_force": [8.5],
    "applied_force": [2.5],
    "force_limit": 2.5,
    "estimated_energy": 0.006,
    "true_energy": 0.007,
    "true_position": [0.011],
    "hand_force": [2.5],
    "engagement": 1.0,
    "device_seq": 1,
    "loop_delay": 0.0004,
    "deadline_misses": 0,
    "rejected": {"age": 1},
}
REPLY = {
    "device_seq": 1,
    "device_time_ns": 0,
    "query_seq": 1,
    "query_time_ns": 0,
    "force": [8.5],
    "environment": "e",
    "proxy": [0.01],
    "normal": [-1.0],
}
SCENE = {
    "objects": [{"name": "ball", "shape": "sphere", "position": [0.0, 0.0, 0.1], "size": [0.05]}],
    "proxy": [0.01],
}
EVENT = {
    "node": "device",
    "event": "phase",
    "is_fault": True,
    "message": "",
    "data": {"name": "late", "link": "force_command", "lost": "1"},
}

SLOWEST = 30  # s for one input, on a machine under load; more counts as found
MEMORY = 2048  # MB of the whole process; more counts as found


def seeds(target: str) -> dict[str, bytes]:
    """Return the inputs that a campaign begins with, by name."""
    if target == "launch_file":
        return {path.name: path.read_bytes() for path in LAUNCH_FILES}
    if target == "recording":
        return {"plain": recorded(), "cut": recorded()[:-40]}
    if target == "keys":
        keys = 'curve\n    public-key = "{0}"\n    secret-key = "{1}"\n'
        return {
            "pair": keys.format(*PAIR).encode(),
            "wrong": keys.format("#" * 40, PAIR[1]).encode(),
        }
    dumps = sorted((ROOT / "tests" / "golden").glob("*.hex"))
    return {d.stem: bytes.fromhex(re.sub(r"#.*", "", d.read_text())) for d in dumps}


def recorded() -> bytes:
    """Return a recording of a few ticks, neither compressed nor summed, so that its bytes count."""
    from mcap.writer import CompressionType, Writer

    file = io.BytesIO()
    writer: Any = Writer(file, compression=CompressionType.NONE, enable_crcs=False)
    writer.start()
    writer.add_metadata("forcebound", {"launch": json.dumps(LAUNCH)})
    topics: dict[str, dict[str, Any]]
    topics = {"telemetry": TELEMETRY, "environment_reply": REPLY, "scene": SCENE, "event": EVENT}
    channels = {topic: writer.register_channel(f"/{topic}", "json", 0) for topic in topics}
    for tick in range(4):
        time_ns = 1_000_000 * tick
        for topic, message in topics.items():
            packet = {"seq": tick, "time_ns": time_ns, **message}
            data = json.dumps(packet).encode()
            writer.add_message(channels[topic], time_ns, data, time_ns, tick)
    writer.finish()
    return file.getvalue()


def words(target: str) -> str:
    """Return what is worth inserting, in the form of libFuzzer's dictionaries."""
    texts = [path.read_text(encoding="utf-8") for path in LAUNCH_FILES]
    texts.append("include: ${env:X:-1} &a *a !!str | > ? [ ] --- %YAML gemodel slot outages 1e999")
    found = re.findall(rb"[a-z_]{4,}", b" ".join(seeds("codec").values()))
    names = {word.decode() for word in found}
    if target == "launch_file":
        names = {word for text in texts for word in text.split() if word.isascii()}
    if target in ("recording", "keys"):
        names = {
            *TELEMETRY,
            *EVENT,
            "public-key",
            "secret-key",
            *PAIR,
            "null",
            "1e308",
            "[[",
            "/b]",
        }
    quoted = (re.sub(r'(["\\])', r"\\\1", name) for name in sorted(names))
    return "".join(f'"{name}"\n' for name in quoted)


def campaign(target: str, seconds: int) -> bool:
    """Fuzz one target; return whether nothing was found."""
    folder = ROOT / "results" / "fuzz" / target
    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for name, data in seeds(target).items():
        (corpus / name).write_bytes(data)
    (folder / "words.dict").write_text(words(target), encoding="utf-8")
    before = set(folder.glob("found-*"))
    options = [
        f"-max_total_time={seconds}",
        f"-artifact_prefix={folder}/found-",
        f"-dict={folder / 'words.dict'}",
        f"-timeout={SLOWEST}",
        f"-report_slow_units={SLOWEST}",
        f"-rss_limit_mb={MEMORY}",
        "-max_len=8192",
        "-print_final_stats=1",
    ]
    program = [sys.executable, str(ROOT / "fuzz" / f"{target}.py")]
    with tempfile.TemporaryDirectory() as scratch:  # libFuzzer ends without cleaning up
        here = {**os.environ, "TMPDIR": scratch}
        command = [*program, *options, str(corpus)]
        status = subprocess.run(command, env=here, check=False).returncode
    for path in sorted(set(folder.glob("found-*")) - before):
        print(f"found by {target}: {path}\n  {path.read_bytes()[:2000]!r}")
        print(f"  again: {sys.executable} fuzz/{target}.py {path}")
    print(f"{target}: {'nothing found' if status == 0 else f'FOUND (status {status})'}", flush=True)
    return status == 0


def main() -> int:
    """Run the campaigns that were named; return the exit status."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}")
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    options = parser.parse_args()
    unknown = set(options.targets) - set(TARGETS)
    if unknown or options.seconds <= 0:
        parser.error(f"expected TARGETs of {', '.join(TARGETS)} and a positive number of seconds")
    if importlib.util.find_spec("atheris") is None:
        print("atheris is not installed: make fuzz installs it, where it has a wheel for this")
        print(f"Python and machine (Linux, not every Python; this one is {sys.version.split()[0]})")
        return 2
    sound = [campaign(target, options.seconds) for target in options.targets or TARGETS]
    return 0 if all(sound) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("interrupted; what was found until now is kept")
        sys.exit(130)
