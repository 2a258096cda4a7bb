"""Tables of deviations in the format of tc."""

import math
from functools import partial
from pathlib import Path
from statistics import NormalDist

import pytest
from builders import MS
from launch_texts import GOOD, problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.loader import from_document, load
from forcebound.graph.resolved import to_document
from forcebound.network.chances import Chances, Draws
from forcebound.network.distribution import LONGEST, read_distribution
from forcebound.network.impairment import Impairment


def table(folder: Path, text: str, name: str = "table.dist") -> Path:
    return written(folder, text, name)


def normal_table(folder: Path) -> Path:
    """As iproute2's normal.c makes it: 4096 quantiles of the normal distribution."""
    entries = [round(8192 * NormalDist().inv_cdf((i + 0.5) / 4096)) for i in range(4096)]
    lines = [" ".join(map(str, entries[i : i + 8])) for i in range(0, 4096, 8)]
    return table(folder, "# a comment\n" + "\n".join(lines) + "\n", "normal.dist")


def delays_ns(impairment: Impairment, count: int) -> list[int]:
    chances = Chances(impairment, Draws(1))
    return [chances.travel_ns() or 0 for _ in range(count)]


def test_entries_stand_between_white_space_and_comments(tmp_path: Path) -> None:
    path = table(tmp_path, "# tc\n  8192\t-8192\n\n0 4096 # 77\n-0x2000\r\n")
    assert read_distribution(path) == (-1.0, -1.0, 0.0, 0.5, 1.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2\n3 x\n", r"table.dist:2: "),
        ("010", r"table.dist:1: "),
        ("# nothing\n", "got 0"),
        ("1 " * (LONGEST + 1), f"got {LONGEST + 1}"),
    ],
)
def test_what_is_no_table_is_refused_at_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_distribution(table(tmp_path, text))


def test_the_longest_table_and_the_largest_entries_are_taken(tmp_path: Path) -> None:
    entries = read_distribution(table(tmp_path, "-32768 32767 " + "0 " * (LONGEST - 2)))
    assert (entries[0], entries[-1], len(entries)) == (-4.0, 32767 / 8192, LONGEST)


def test_each_entry_is_as_likely_and_scaled_by_the_jitter(tmp_path: Path) -> None:
    path = table(tmp_path, "-8192 0 0 16384")
    count = 20_000
    found = delays_ns(Impairment(delay=0.01, jitter=0.002, distribution_file=path), count)
    for delay_ns, share in ((8 * MS, 0.25), (10 * MS, 0.5), (14 * MS, 0.25)):
        deviation = math.sqrt(count * share * (1.0 - share))
        assert abs(found.count(delay_ns) - count * share) < 4.0 * deviation
    assert set(found) == {8 * MS, 10 * MS, 14 * MS}


def test_a_table_agrees_with_the_built_in_distribution_packet_by_packet(tmp_path: Path) -> None:
    made = partial(Impairment, delay=0.01, jitter=0.001, correlation=0.5)
    ours = delays_ns(made(distribution_file=normal_table(tmp_path)), 1000)
    built_in = delays_ns(made(distribution="normal"), 1000)
    # The same numbers, so only the steps of the table lie between: coarse in the last of them.
    apart = sorted(abs(a - b) for a, b in zip(ours, built_in, strict=True))
    assert apart[900] < 0.001 * MS * 2
    assert apart[-1] < 0.5 * MS


def test_the_shortest_time_is_that_of_the_lowest_entry(tmp_path: Path) -> None:
    path = table(tmp_path, "8192 -4096")
    impairment = Impairment(delay=0.01, jitter=0.002, distribution_file=path)
    assert impairment.shortest == pytest.approx(0.009)
    assert not impairment.is_plain


def test_table_and_named_distribution_exclude_each_other(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="distribution_file excludes distribution"):
        Impairment(distribution="normal", distribution_file=table(tmp_path, "0"))


def test_a_launch_file_names_the_table_relative_to_itself(tmp_path: Path) -> None:
    path = table(tmp_path, "-8192 8192")
    text = GOOD.replace("delay: 2 ms", "delay: 2 ms, jitter: 1 ms, distribution_file: table.dist")
    config = load(written(tmp_path, text))
    assert config.links["environment_query"].distribution_file == path
    assert from_document(to_document(config)) == config


@pytest.mark.parametrize(
    ("name", "what"), [("gone.dist", "No such file"), ("bad.dist", "expected")]
)
def test_a_table_that_cannot_be_read_is_told_at_its_place(
    tmp_path: Path, name: str, what: str
) -> None:
    table(tmp_path, "x", "bad.dist")
    text = GOOD.replace("delay: 2 ms", f"delay: 2 ms, jitter: 1 ms, distribution_file: {name}")
    message = problems_of(written(tmp_path, text))
    assert "distribution_file: " in message
    assert what in message
    assert "graph.yaml:16:69: " in message
