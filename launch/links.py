"""Links of a graph: their models, and whether anything comes through."""

from dataclasses import dataclass

from forcebound.analysis.delay_traces import trace_of
from forcebound.config.graph import GraphConfig
from forcebound.errors import ConfigError
from forcebound.launch.lifecycle import Limits
from forcebound.messages.packets import Packet
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link, Stamped, link_seed


@dataclass(frozen=True)
class _Probe:
    seq: int
    time_ns: int


def build_links(config: GraphConfig) -> dict[str, Link[Packet]]:
    """Return the impaired links by topic; the others are perfect.

    Consumers want the newest value of every topic.
    """
    return {
        topic: build_link(topic, impairment, config.seed)
        for topic, impairment in config.links.items()
        if impairment != Impairment()
    }


def build_link(topic: str, impairment: Impairment, seed: int) -> Link[Packet]:
    """Return the link of a topic in a graph with this seed."""
    return Link(impairment, link_seed(seed, topic), trace_of(impairment))


def check_links(config: GraphConfig) -> None:
    """Check that a packet gets through each link while a live run is willing to wait for it.

    Raises:
        ConfigError: If one link loses all of them, or keeps them for longer.
    """
    period_ns, end_ns = config.device.servo.period_ns, Limits().start_ns
    for topic, impairment in config.links.items():
        link: Link[Stamped] = Link(impairment, link_seed(config.seed, topic), trace_of(impairment))
        if not any(_arrives(link, seq, seq * period_ns) for seq in range(end_ns // period_ns)):
            raise ConfigError(
                f"links.{topic}: no packet gets through in the first {end_ns * 1e-9:g} s, so a live"
                " run does not start; lose them later, with phases: or `forcebound param set`"
            )


def _arrives(link: Link[Stamped], seq: int, time_ns: int) -> bool:
    link.accept(time_ns, _Probe(seq, time_ns))
    return bool(link.due(time_ns))
