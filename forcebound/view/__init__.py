"""The live page of a running graph, and the server that gives it to browsers.

:mod:`~forcebound.view.access` has the access rules, :mod:`~forcebound.view.feed` the messages to
pages, :mod:`~forcebound.view.controls` the changes that a page may make;
:mod:`~forcebound.view.server` joins them.
The page itself is in ``page/``. Nothing here runs in a process of the graph.
"""
