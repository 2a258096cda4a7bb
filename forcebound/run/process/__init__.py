"""Live processes: the loop of a node, the loop of the recorder, and reading whole streams."""
