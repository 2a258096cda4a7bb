"""Attacks on the certificates along any path, with a ground truth that is independent.

The ground truth (:mod:`forcebound_proofs.paths.truth`) is written from ``docs/theory.md`` alone and
shares nothing with the simulated devices; the law is the live bounder, by its public calls.
"""
