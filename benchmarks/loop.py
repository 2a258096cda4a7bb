"""The four-hop loop of the default launch file, device to environment and back, against bare pyzmq.

`graph`: controller and environment in the live runner, and a probe in place of the device: it
publishes a state on an absolute schedule and takes the time when the decoded answer reaches it.
`bare`: the graph's sockets, options, bytes, placement and priorities, nothing decoded. `default`:
the same without placement. No recorder listens.
"""

from functools import partial

from benchmarks.harness import Result, alternate, at, chain, compare, missed
from forcebound.observe.measure import bare, graph, loop

DURATION = 18.0
ASKED = "loop from device to controller, environment and back"


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    settings = chain()
    contestants = {
        "graph": partial(loop, graph, settings),
        "bare": partial(loop, bare, settings),
        "bare, default placement": partial(loop, bare, None),
    }
    whole, same, default = found = alternate(duration, rate, contestants)
    return found, [
        at(whole, "p50", is_shown=True),
        compare(whole, same, "p50", 1.25, "bare sockets"),
        at(whole, "p99", is_shown=True),
        compare(whole, same, "p99", 1.5, "bare sockets"),
        compare(whole, default, "p50", 0.7),
        compare(whole, default, "p99_9", 0.2),
        missed(whole),
    ]
