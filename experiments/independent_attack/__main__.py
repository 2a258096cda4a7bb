"""Attack the certified laws with a ground truth of its own.

    python -m experiments.independent_attack [CERTIFICATE ...] [--runs 20000] [--workers 2]
    python -m experiments.independent_attack CERTIFICATE --restart 17 [--law certified]

A *restart* draws a device and a program and searches by CMA-ES for the lowest energy; every tenth
draws all its runs at random. The table shows for each certificate and law the runs, the lowest
energy, and the share of restarts that came back to within 1e-6 J of zero after at least 0.1 mJ: how
tight the attack, and the law, are. The last column is the lowest energy with the certificate's
number left out of what the bounder is given. Exit status: 1 if a law leaks more than 1e-9 J.
"""

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from typing import NamedTuple

import numpy as np

from experiments.independent_attack.cases import CERTIFICATES, draw
from experiments.independent_attack.search import Restart, attack_at_random, attack_with_cma
from forcebound.bounding import ENERGY_TOLERANCE

LAWS = ("certified", "certified_memoryless")
RUNS_OF_RESTART = 2000
RUNS_LEFT_OUT = 500  # in each of
RESTARTS_LEFT_OUT = 4  # restarts with the number left out


class Task(NamedTuple):
    """One restart; its fields seed it."""

    certificate: str
    law: str
    left_out: bool
    seed: int
    restart: int


def work(task: Task) -> tuple[Task, Restart]:
    """Do one restart; return what it found."""
    words = [ord(letter) for letter in task.certificate]
    random = np.random.default_rng([task.seed, task.restart, int(task.left_out), *words])
    case = draw(task.certificate, task.law, random, task.left_out)
    runs = RUNS_LEFT_OUT if task.left_out else RUNS_OF_RESTART
    attack = attack_at_random if task.restart % 10 == 9 else attack_with_cma
    return task, attack(case, random, runs)


@dataclass
class Row:
    """Sums over the restarts of a certificate and a law."""

    runs: int = 0
    samples: int = 0
    restarts: int = 0
    tight: int = 0
    lowest: float = 0.0
    left_out: float = 0.0
    worst: int = -1

    def add(self, task: Task, found: Restart) -> None:
        """Take in a restart."""
        lowest = found.worst
        if task.left_out:
            self.left_out = min(self.left_out, lowest)
            return
        self.runs += found.runs
        self.samples += found.steps
        self.restarts += 1
        self.tight += found.is_tight
        if lowest < self.lowest:
            self.lowest, self.worst = lowest, task.restart


def tasks_of(names: list[str], runs: int, seed: int) -> list[Task]:
    """Return the restarts that give at least ``runs`` runs of each certificate, over the laws."""
    tasks = []
    restarts = -(-runs // (RUNS_OF_RESTART * len(LAWS)))
    for name in names:
        for law in LAWS:
            tasks += [Task(name, law, False, seed, number) for number in range(restarts)]
            if CERTIFICATES[name].left_out:
                tasks += [
                    Task(name, law, True, seed, number) for number in range(RESTARTS_LEFT_OUT)
                ]
    return tasks


HEAD = """| certificate | law | runs | samples | lowest energy | tight | left out |
|---|---|---|---|---|---|---|"""


def line(name: str, law: str, row: Row) -> str:
    """Return a row of the Markdown table."""
    left_out = f"{row.left_out * 1e3:.3g} mJ" if CERTIFICATES[name].left_out else "–"
    return (
        f"| {CERTIFICATES[name].summary} | `{law}` | {row.runs:,} | {row.samples:,} | "
        f"{row.lowest:.1e} J | {row.tight} of {row.restarts} | {left_out} |"
    )


def main(arguments: list[str]) -> int:
    """Run the attack that ``arguments`` name; return the exit status."""
    parser = argparse.ArgumentParser(description="Attack the certified laws.")
    parser.add_argument("certificates", nargs="*", help=f"of {', '.join(CERTIFICATES)}")
    parser.add_argument("--runs", type=int, default=20000, help="of each certificate")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--restart", type=int, help="one restart alone")
    parser.add_argument("--law", choices=LAWS, default=LAWS[0], help="of that restart")
    options = parser.parse_args(arguments)
    names = options.certificates or list(CERTIFICATES)
    unknown = sorted(set(names) - set(CERTIFICATES))
    if unknown:
        parser.error(f"no certificate {', '.join(unknown)}; known are {', '.join(CERTIFICATES)}")
    if options.restart is not None:
        _, found = work(Task(names[0], options.law, False, options.seed, options.restart))
        sys.stdout.write(json.dumps(vars(found)) + "\n")
        return 0
    leaks = 0
    _say(HEAD)
    with ProcessPoolExecutor(options.workers) as pool:
        found_by_task = pool.map(work, tasks_of(names, options.runs, options.seed))
        for (name, law), pairs in groupby(found_by_task, lambda pair: pair[0][:2]):
            row = Row()
            for task, found in pairs:
                row.add(task, found)
                if not task.left_out and found.worst < -ENERGY_TOLERANCE:
                    leaks += 1
                    sys.stderr.write(f"leak: {task}, {found}\n")
            _say(line(name, law, row))
    return int(leaks > 0)


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
