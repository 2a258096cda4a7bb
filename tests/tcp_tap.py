"""A TCP relay that keeps the bytes of the listener behind it."""

import selectors
import socket
import threading
from contextlib import suppress
from types import TracebackType
from typing import Self

from waiting import free_port


class TcpTap:
    """Listens at a port and passes on to another one; ends with its ``with`` block."""

    def __init__(self, port: int, target: int) -> None:
        self._port, self._target = port, target
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._selector = selectors.DefaultSelector()
        self._open: list[socket.socket] = []
        self.is_held = False  # whether bytes stay where they are
        self.seen = bytearray()  # all that has passed

    @staticmethod
    def free_port() -> int:
        """Return a port that is free."""
        return free_port()

    def __enter__(self) -> Self:
        listener = socket.create_server(("127.0.0.1", self._port))
        self._open.append(listener)
        self._selector.register(listener, selectors.EVENT_READ, self._target)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._selector.close()
        for one in self._open:
            one.close()

    def _run(self) -> None:
        while not self._ended.is_set():
            if self.is_held:
                self._ended.wait(0.02)
                continue
            for key, _ in self._selector.select(0.02):
                source = key.fileobj
                assert isinstance(source, socket.socket)
                if isinstance(key.data, int):
                    self._accept(source, key.data)
                else:
                    self._pass_on(source, *key.data)

    def _accept(self, listener: socket.socket, target: int) -> None:
        incoming, _ = listener.accept()
        self._open.append(incoming)
        try:
            outgoing = socket.create_connection(("127.0.0.1", target), timeout=1.0)
        except OSError:  # nobody listens there yet
            incoming.close()
            return
        self._open.append(outgoing)
        self._selector.register(incoming, selectors.EVENT_READ, (outgoing,))
        self._selector.register(outgoing, selectors.EVENT_READ, (incoming,))

    def _pass_on(self, source: socket.socket, sink: socket.socket) -> None:
        data = b""
        with suppress(OSError):
            data = source.recv(65_536)
            sink.sendall(data)
        self.seen += data
        if not data:
            for one in (source, sink):
                with suppress(KeyError, ValueError):
                    self._selector.unregister(one)
                one.close()
