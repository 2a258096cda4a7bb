"""The path of packets from node to node: the model of a bad network, and the sockets.

:mod:`forcebound.network.link` is a pure model of a bad network, used by both runners on the
receiving side. :mod:`forcebound.network.sockets` opens every socket, and only this room imports
``zmq``. :mod:`forcebound.network.remote` is the link to another machine, secured with the keys of
:mod:`forcebound.network.keys`. None of them knows what a packet means: a link needs its stamps, a
socket its bytes; only a :mod:`deadband <forcebound.network.deadband>` its force or velocity.
"""
