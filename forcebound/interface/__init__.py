"""The Python interface: what scientists call; re-exported lazily by forcebound."""
