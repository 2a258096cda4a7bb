"""Start of graphs, live and in virtual time, and supervision of their processes."""

if __name__ != "forcebound.launch":
    raise ImportError(f"import forcebound.launch, not {__name__}")
