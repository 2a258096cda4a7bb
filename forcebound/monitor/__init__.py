"""What one asks of a graph that runs: which there are, orders, parameters, delays, diagnosis."""
