"""Messages between the nodes: packets, topics and their encoding."""

if __name__ != "forcebound.messages":
    raise ImportError(f"import forcebound.messages, not {__name__}")
