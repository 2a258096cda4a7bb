"""The server of a study's page: what is shown on it is :class:`LiveStudy`'s.

One page leads the participant, the one that was opened last. Those of the address to look only, an
experimenter's, show the same.
"""

import json
from typing import ClassVar

from forcebound.lab.study.live import LiveStudy
from forcebound.observe.page.feed import Message
from forcebound.observe.page.server import Server, _Page


class StudyServer(Server):
    """A server for the pages of one session."""

    index: ClassVar[str] = "study.html"
    live: LiveStudy  # set before the first page can open
    _leading: _Page | None = None

    def stop(self) -> None:
        """End the session."""
        super().stop()
        self.live.inbox.put({"do": "stop"})

    def describe(self) -> list[Message]:
        """Return the step of now."""
        return [self.live.describe()]

    def receive(self, page: _Page, request: Message) -> None:
        """Pass on what the leading page sends."""
        if page is self._leading and request["do"] != "stop":
            self.live.inbox.put(request)

    def opened(self, page: _Page) -> None:
        """Let the newest page lead; send the one before a message."""
        super().opened(page)
        if page.may_change:
            if self._leading is not None:
                self._leading.send(json.dumps({"type": "elsewhere"}))
            self._leading = page
            self.live.inbox.put({"do": "away"})  # until it is ready

    def closed(self, page: _Page) -> None:
        """Note that the participant's page has gone."""
        super().closed(page)
        if page is self._leading:
            self._leading = None
            self.live.inbox.put({"do": "away"})
