"""Start of graphs, live and in virtual time, and supervision of their processes."""
