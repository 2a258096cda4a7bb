"""Limits of the sockets and of the link to another machine."""

MAX_FRAME = 65_536  # bytes; the largest packet is about 1 kB
QUEUE_LIMIT = 10_000  # messages kept for an onlooker that is late; 2 s of five 1 kHz streams
REQUEST_QUEUE = 16  # requests of one peer of a control socket that were not answered yet
HANDSHAKE_MS = 2_000
RECONNECT_MS = 20  # a graph starts in any order; the default of 100 ms is felt
TCP_SEND_QUEUE = 64  # messages for a remote peer that does not take them; 64 ms of a 1 kHz stream
TCP_RECEIVE_QUEUE = 1_000  # messages of a remote peer that were not taken yet
TCP_CONNECT_MS = 1_000  # a lost SYN is sent again by the kernel only after 1, 3, 7 ... s
HEARTBEAT_MS = 100  # tcp only: finds a hung peer in 0.4 s
HEARTBEAT_TIMEOUT_MS = 300
DESCRIPTORS = 16_384  # of a process with a port, if the system permits so many
NO_ANSWER_NS = 3_000_000_000  # after this time without a connection it is reported, once
