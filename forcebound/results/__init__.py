"""Key figures, tables and plots of a recorded run."""
