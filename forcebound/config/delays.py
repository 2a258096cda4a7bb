"""Delays of a launch file: traces that can be read, and a loop that is not too long."""

from collections.abc import Mapping

from forcebound.config.fields import Section
from forcebound.config.graph import EnvironmentConfig
from forcebound.config.traces import shortest_of, trace_of
from forcebound.errors import ConfigError
from forcebound.network.impairment import Impairment
from forcebound.nodes.servo import ServoSettings


def has_trace(section: Section, key: str, impairment: Impairment) -> bool:
    """Return whether the trace, if one is named, can be read; if not, a problem is noted."""
    try:
        trace_of(impairment)
    except ConfigError as error:
        section.add(f"{key}: {error}", section.value.entries[key])
        return False
    return True


def check_delays(
    servo: ServoSettings,
    environment: EnvironmentConfig,
    links: Mapping[str, Impairment],
    section: Section,
) -> None:
    """Note a loop so long that the device would refuse every answer."""
    parts = (environment.computation, *links.values())
    delays = sum(shortest_of(part) for part in parts)
    wait = servo.reply_wait / servo.rate  # the device takes an answer when it writes
    shortest = max(delays, wait)
    if shortest < servo.age_limit:
        return
    what, remedy = "delays of the links and the environment", "lower the delays"
    if wait > delays:
        what, remedy = "reply_wait over rate", "raise the rate"
    message = (
        f"an answer takes at least {shortest * 1e3:g} ms ({what}), and the device refuses answers"
        f" older than age_limit = {servo.age_limit * 1e3:g} ms, so there would never be a force:"
        f" set age_limit in device: above {shortest * 1e3:g} ms, or {remedy}"
    )
    age_limit = section.value.entries.get("age_limit")
    if age_limit is None:
        section.add_here(message)
    else:
        section.add(message, age_limit)
