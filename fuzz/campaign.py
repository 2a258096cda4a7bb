"""Fuzz recordings and keys for a while each: ``make fuzz FUZZ_SECONDS=600``.

Inputs that reach new code are kept in ``results/fuzz/TARGET/corpus`` and the next campaign goes on
from them; inputs that broke something are kept beside it and printed. Exit status: 0 nothing was
found, 1 something was, 2 atheris is missing. (Packets and launch files have property tests.)
"""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import click

ROOT = Path(__file__).parent.parent
TARGETS = ("recording", "keys")
PAIR = (  # keys of nobody
    "0vD2B}d>Ih{WK6igW}zPWdpNP(gc6vi(/#BycP/J",
    "pjTWXhGC4O]jL]uS<J=d:l:7<Tblm(fFgJ}o-}+^",
)
WORDS = ("public-key", "secret-key", *PAIR, "null", "1e308", "[[", "/b]", "launch", "telemetry")
SLOWEST = 30  # s for one input, on a machine under load; more counts as found
MEMORY = 2048  # MB of the whole process; more counts as found


def seeds(target: str) -> dict[str, bytes]:
    """Return the inputs that a campaign begins with, by name."""
    if target == "recording":
        whole = recorded()
        return {"plain": whole, "cut": whole[:-40]}
    keys = 'curve\n    public-key = "{0}"\n    secret-key = "{1}"\n'
    return {"pair": keys.format(*PAIR).encode(), "wrong": keys.format("#" * 40, PAIR[1]).encode()}


def recorded() -> bytes:
    """Return a recording of a few ticks."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.mcap"
        words = ["simulate", "touch_sphere", "--duration", "20ms", "--record", str(file)]
        command = [sys.executable, "-m", "forcebound", *words]
        subprocess.run(command, check=False, stdout=subprocess.DEVNULL)
        return file.read_bytes()


def campaign(target: str, seconds: int) -> bool:
    """Fuzz one target; return whether nothing was found."""
    folder = ROOT / "results" / "fuzz" / target
    corpus = folder / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for name, data in seeds(target).items():
        (corpus / name).write_bytes(data)
    (folder / "words.dict").write_text("".join(f"{json.dumps(word)}\n" for word in WORDS))
    before = set(folder.glob("found-*"))
    options = [
        f"-max_total_time={seconds}",
        f"-artifact_prefix={folder}/found-",
        f"-dict={folder / 'words.dict'}",
        f"-timeout={SLOWEST}",
        f"-report_slow_units={SLOWEST}",
        f"-rss_limit_mb={MEMORY}",
        "-max_len=65536",
        "-print_final_stats=1",
    ]
    program = [sys.executable, str(ROOT / "fuzz" / f"{target}.py")]
    with tempfile.TemporaryDirectory() as scratch:  # libFuzzer ends without cleaning up
        here = {**os.environ, "TMPDIR": scratch}
        status = subprocess.run([*program, *options, str(corpus)], env=here, check=False).returncode
    for path in sorted(set(folder.glob("found-*")) - before):
        print(f"found by {target}: {path}\n  {path.read_bytes()[:2000]!r}")
        print(f"  again: {sys.executable} fuzz/{target}.py {path}")
    print(f"{target}: {'nothing found' if status == 0 else f'FOUND (status {status})'}", flush=True)
    return status == 0


@click.command()
@click.argument("targets", nargs=-1, type=click.Choice(TARGETS))
@click.option("--seconds", type=click.IntRange(min=1), default=60, help="For each target.")
def main(targets: tuple[str, ...], seconds: int) -> None:
    """Run the campaigns that were named, or all."""
    if importlib.util.find_spec("atheris") is None:
        print("atheris is not installed: make fuzz installs it, where it has a wheel for this")
        print(f"Python and machine (Linux, not every Python; this one is {sys.version.split()[0]})")
        sys.exit(2)
    sound = [campaign(target, seconds) for target in targets or TARGETS]
    sys.exit(0 if all(sound) else 1)


if __name__ == "__main__":
    main()
