"""How a graph starts: launch files, their schema, and the supervisor of the processes."""

if __name__ != "forcebound.launch":
    raise ImportError(f"import forcebound.launch, not {__name__}")
