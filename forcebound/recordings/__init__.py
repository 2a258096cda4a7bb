"""Uses of a recording after the run: tables of its topics, recovery of a cut file."""
