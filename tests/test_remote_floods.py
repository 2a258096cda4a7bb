"""Connections of a port whose descriptors have other holders by now."""

import os
import socket

from forcebound.network.listener import _address_of


def test_a_descriptor_that_is_no_connection_of_the_port_any_more_has_no_address() -> None:
    # libzmq may close a connection before its event is read, and its number has a new holder then.
    one, other = socket.socketpair()
    with one, other, open(os.devnull) as file:
        numbers = (one.fileno(), file.fileno(), 1000)
        assert {_address_of(number) for number in numbers} == {"unknown address"}
