"""The live page of a running graph, and the server that gives it to browsers.

:mod:`~forcebound.observe.page.access` has the access rules, :mod:`~forcebound.observe.page.feed`
the messages to pages, :mod:`~forcebound.observe.page.controls` the changes that a page may make;
:mod:`~forcebound.observe.page.server` joins them. The page itself is in ``page/``. Nothing here
runs in a process of the graph.
"""
