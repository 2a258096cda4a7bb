"""Campaigns: cases, runs, rows and views, on one engine."""
