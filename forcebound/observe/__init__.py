"""Monitoring of running graphs: finding them, requests, parameters, loop delay, diagnosis."""
