"""Sweeps: many runs of one launch file, side by side in compiled code where that is possible."""
