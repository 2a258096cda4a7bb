"""Fuzz target of launch files: any bytes give a configuration or a ConfigError.

Run by ``make fuzz``; one input again: ``python fuzz/launch_file.py FILE``.
"""

import json
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import atheris

for compiled in ("forcebound.devices", "forcebound.geometry.vectors"):
    import_module(compiled)  # before: numba cannot compile what atheris has changed

with atheris.instrument_imports(  # pyright: ignore[reportAttributeAccessIssue]
    include=[
        "forcebound.config",
        "forcebound.launch",
        "forcebound.quantities",
        "forcebound.units",
        "ruamel",
    ]
):
    from forcebound.config.loader import arguments_of, from_document, load
    from forcebound.config.resolved import to_document
    from forcebound.errors import ConfigError
    from forcebound.launch.build import build_node
    from forcebound.launch.links import build_links
    from forcebound.topology import ONE_HAND

FILE = Path(tempfile.mkdtemp(prefix="forcebound-fuzz-")) / "graph.yaml"
SHIPPED = sorted((Path(__file__).parent.parent / "launch").glob("*.yaml"))


def one(data: bytes) -> None:
    """Load it as a file; see the head of this file."""
    FILE.write_bytes(data)
    try:
        arguments_of(FILE)
        config = load(FILE)
    except ConfigError as error:
        str(error).encode()
        return
    document = json.loads(json.dumps(to_document(config), allow_nan=False))
    assert from_document(document) == config, document
    build_links(config)
    if hasattr(config.device.model, "simulated_in"):
        return  # to build it opens a port
    for kind in ONE_HAND.loop:
        build_node(kind, config).close()


if __name__ == "__main__":
    atheris.Setup(sys.argv, one)
    for shipped in SHIPPED:
        one(shipped.read_bytes())  # compiles laws and worlds, which is no time of an input
    atheris.Fuzz()
