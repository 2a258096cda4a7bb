"""What shows that forcebound keeps its promises: attacks, the paper's experiments, grids."""
