"""Closing of parts: a failure of their code does not interrupt the end of the node."""

import logging
from typing import Protocol

from forcebound.haptics.parts.user_module import describe_user_error

_logger = logging.getLogger(__name__)


class Closable(Protocol):
    """A part that was opened."""

    def close(self) -> None:
        """Release all resources."""
        ...


def close_part(part: Closable, name: str) -> None:
    """Close a part; a failure is logged, with ``name``, and not raised."""
    try:
        part.close()
    except Exception as error:
        _logger.warning("the %s failed to close: %s", name, describe_user_error(error))
