"""How packets get from node to node: what a bad network does to them, and the sockets.

:mod:`forcebound.network.link` is a pure model of a bad network, used by both runners on the
receiving side. :mod:`forcebound.network.sockets` is the only module that imports ``zmq``. Neither
knows what a packet means: a link needs its stamps, a socket its bytes.
"""
