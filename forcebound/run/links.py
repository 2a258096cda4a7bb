"""Links of a graph: their models, and whether anything comes through."""

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig
from forcebound.messages.packets import Packet
from forcebound.network.impairment import Impairment
from forcebound.network.link import Link, link_seed
from forcebound.results.delay_traces import trace_of
from forcebound.run.actions import Limits


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
    """Raise ConfigError if no packet gets through a link while a live run waits for it."""
    end = Limits().start_ns * 1e-9
    for topic, impairment in config.links.items():
        if max(impairment.loss, impairment.corrupt) == 1.0 or impairment.delay >= end:
            raise ConfigError(
                f"links.{topic}: no packet gets through in the first {end:g} s, so a live run does"
                " not start; lose them later, with phases: or `forcebound param set`"
            )
