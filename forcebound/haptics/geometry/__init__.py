"""Shapes in space, and the proxy that slides on them.

Positions are Cartesian, in m; an outward normal points out of the solid. What is compiled is a
plain function of numbers and of tuples of three numbers (:mod:`forcebound.compiled`).
"""
