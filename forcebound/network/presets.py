"""Named networks: links as somebody measured them, in the words of an impairment.

Each is one way, in either direction; a link gets it by ``preset: NAME``. What is assumed, because
its source does not say it, stands in each docstring; a deviation of 0.5 ms is such that at 1 kHz no
packet overtakes another, since these networks keep the order. To add one: a function here, with
source and year, and one line in ``PRESETS``.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

from forcebound.errors import ConfigError
from forcebound.network.impairment import Impairment, Spike

PRESET: Final = "preset"  # key of a link that names one


def lan() -> Impairment:
    """Return a switched local network of 1 Gbit/s.

    On the wire a packet of 128 bytes takes 1.2 us for each switch (IEEE 802.3, 2022). Assumed: 0.1
    ms with a deviation of 20 us, for the two operating systems.
    """
    return Impairment(delay=0.1e-3, jitter=20e-6)


def wifi() -> Impairment:
    """Return a busy wireless network of a campus.

    Round trips of 47,000 devices had a median of 3 ms, a 90th percentile of 20 ms and a 99th of 250
    ms: half of each here. Assumed: the two ways are equal and independent; the upper tenth is in
    spells of 20 ms, the upper hundredth in spells of 125 ms; nothing is lost.

    Source: K. Sui et al., Characterizing and improving WiFi latency in large-scale operational
    networks, MobiSys 2016.
    """
    busy = Spike(period=0.1, duration=0.02, delay=0.0095, chance=0.5)
    blocked = Spike(period=10.0, start=5.0, duration=0.125, delay=0.1235, chance=0.8)
    return Impairment(delay=0.0015, jitter=0.0005, spikes=(busy, blocked))


def five_g_nsa() -> Impairment:
    """Return a public 5G network with a core of 4G (non-standalone).

    One way took 7 ms in the best case, down, and 18 ms in the worst, up: the mean of both here,
    since a link does not know its direction. Assumed: a deviation of 0.5 ms; nothing is lost.

    Source: M. Kottkamp, 5G NR and LTE latency analysis in a public network, Rohde & Schwarz, Munich
    2022.
    """
    return Impairment(delay=0.0125, jitter=0.0005)


def starlink() -> Impairment:
    """Return a satellite link in low orbit, whose satellite changes every 15 s.

    Round trips: a median of 33 ms; a 99th percentile below 65 ms in the worst hour (SpaceX, United
    States, 2024): half of each here. Each cycle has a spike that lasts 140 ms at its beginning, and
    one of 75 ms at its end: 1.4 % of the time. Assumed: these are what lies above the 99th
    percentile, so both add 16 ms; else a deviation of 0.5 ms; 0.1 % is lost; a cycle begins with
    the first packet of the link, so the ways there and back change together.

    Source: A. Casparsen et al., Statistical characterization and prediction of E2E latency over LEO
    satellite networks, arXiv 2601.08439, 2026 (its abstract); SpaceX, Improving Starlink's latency,
    2024.
    """
    begins = Spike(period=15.0, duration=0.14, delay=0.016)
    ends = Spike(period=15.0, start=14.925, duration=0.075, delay=0.016)
    return Impairment(delay=0.0165, jitter=0.0005, loss=0.001, spikes=(begins, ends))


def transatlantic() -> Impairment:
    """Return a cable from London to New York.

    5570 km at 5 us/km (ITU-T G.114, 2003, fibre). Assumed: the way of the cable and over land is a
    quarter longer; a deviation of 0.5 ms; 0.01 % is lost.
    """
    return Impairment(delay=0.035, jitter=0.0005, loss=0.0001)


def geo() -> Impairment:
    """Return a link over a geostationary satellite.

    36,000 km up and down take 260 ms with the stations (ITU-T G.114, 2003). Assumed: a deviation of
    0.5 ms; 0.1 % is lost. The device needs an ``age_limit`` of more than 0.52 s for both ways.
    """
    return Impairment(delay=0.26, jitter=0.0005, loss=0.001)


PRESETS: Mapping[str, Callable[[], Impairment]] = {
    "lan": lan,
    "wifi": wifi,
    "5g_nsa": five_g_nsa,
    "starlink": starlink,
    "transatlantic": transatlantic,
    "geo": geo,
}


def named_link(preset: str, **own: Any) -> Impairment:
    """Return a named network; what is given in other words of an impairment wins.

    ConfigError if there is none of this name.
    """
    if preset not in PRESETS:
        words = f"preset must be one of {', '.join(PRESETS)}, got {preset!r}"
        raise ConfigError(words, field="preset")
    return replace(PRESETS[preset](), **own)
