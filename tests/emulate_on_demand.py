"""``python tests/emulate_on_demand.py FILE emulate ...``: its faults count from when FILE exists.

Those of ``forcebound emulate`` count from the first reply. A test that needs something before a
fault would have to guess how long that takes on a busy machine.
"""

import sys
from pathlib import Path

from forcebound.__main__ import main
from forcebound.hardware.emulators.faults import Faults


class FaultsOnDemand(Faults):
    """Faults whose time begins with the first reply after a file exists."""

    file: Path

    def begin(self, time_ns: int) -> None:
        if self.file.exists():
            super().begin(time_ns)


if __name__ == "__main__":
    from forcebound.hardware.emulators import program

    FaultsOnDemand.file = Path(sys.argv.pop(1))
    program.__dict__["Faults"] = FaultsOnDemand  # as a test would patch it
    main()
