"""Mutation tests of bounding, safety chain and codec: ``make mutation``.

mutmut changes one thing at a time, and the tests should fail. It works on a copy of the tree in
``results/mutation``, because it does not follow the links to ``nodes`` and ``messages``, and
without compilation, because numba cannot compile its wrappers. Uncompiled, numpy warns of infinite
numbers; that is ignored. The score is the share of mutants that a test has found.
"""

import json
import os
import shutil
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "results" / "mutation"
FILES = ("forcebound/haptics/laws/*", "forcebound/nodes/safety.py", "forcebound/messages/codec.py")
TESTS = (
    "bounding",
    "certified_law",
    "paper_laws",
    "device_node",
    "safety",
    "codec",
    "codec_refusals",
)
COPIED = ("launch", "messages", "nodes", "tests", "docs", "examples", "README.md")
LEAST = 85  # %; fewer found mutants fail the target

SETTINGS = f"""
[tool.mutmut]
source_paths = ["forcebound"]
only_mutate = {json.dumps(FILES)}
do_not_mutate = ["forcebound/haptics/laws/contract.py"]
also_copy = {json.dumps(COPIED)}
pytest_add_cli_args_test_selection = {json.dumps([f"tests/test_{name}.py" for name in TESTS])}
pytest_add_cli_args = ["-p", "no:cacheprovider", "-W", "ignore::RuntimeWarning"]
"""

FOUND = ("killed", "timeout", "caught by type check", "suspicious", "segfault")


def copy_tree() -> None:
    """Copy what the tests need, links as folders."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    ignored = shutil.ignore_patterns("__pycache__", "target", "node_modules")
    for name in ("forcebound", *COPIED):
        source, copy = ROOT / name, FOLDER / name
        if source.is_dir():
            shutil.copytree(source, copy, ignore=ignored)
        else:
            shutil.copy(source, copy)
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (FOLDER / "pyproject.toml").write_text(text + SETTINGS, encoding="utf-8")


def mutmut(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run a command of mutmut in the copy; standard error is shown."""
    return subprocess.run(
        [sys.executable, "-m", "mutmut", *words],
        cwd=FOLDER,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )


def statuses() -> dict[str, str]:
    """Return what became of each mutant, by its name."""
    lines = mutmut("results", "--all", "true").stdout.splitlines()
    pairs = (line.strip().rpartition(": ") for line in lines if "__mutmut_" in line)
    return {name: status for name, _, status in pairs}


def main() -> int:
    """Run all mutants and print the score by module; return the exit status."""
    copy_tree()
    mutmut("run", "--max-children", str(len(os.sched_getaffinity(0))))
    modules: defaultdict[str, Counter[bool]] = defaultdict(Counter)
    survived = []
    for name, status in statuses().items():
        is_found = status in FOUND
        modules[name.partition(".x")[0]][is_found] += 1
        if not is_found:
            survived.append(f"{name}: {status}")
    total: Counter[bool] = sum(modules.values(), Counter())
    print("mutants that no test has found:", *survived, sep="\n  ")
    for name, count in [*sorted(modules.items()), ("all", total)]:
        print(f"{name:<42}{count[True]:>6} of {count.total():>5}  {score(count):>6.1f} %")
    return 0 if score(total) >= LEAST else 1


def score(count: "Counter[bool]") -> float:
    """Return the share of mutants that were found, in %."""
    return 100.0 * count[True] / max(count.total(), 1)


if __name__ == "__main__":
    sys.exit(main())
