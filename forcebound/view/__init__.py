"""The live page of a running graph, and the server that gives it to browsers.

:mod:`~forcebound.view.access` says who may look, :mod:`~forcebound.view.feed` what there is to see,
:mod:`~forcebound.view.controls` what a page may change, :mod:`~forcebound.view.server` joins them.
The page itself is in ``page/``. Nothing here runs in a process of the graph.
"""
