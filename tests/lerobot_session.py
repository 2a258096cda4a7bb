"""A session of lerobot as a process: ``python lerobot_session.py FOLDER TELEOP ROBOT``.

``TELEOP`` and ``ROBOT`` are the configurations, as JSON. The order of calls is that of
``lerobot_teleoperate.teleoperate``. The loop is the real one if ``FOLDER`` has lerobot's sources,
else that of the stand-in; so is the discovery of plug-ins.
"""

import ast
import contextlib
import importlib
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import draccus
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot.teleoperators import TeleoperatorConfig, make_teleoperator_from_config

FPS = 60
NAMES = {
    "time": time,
    "logging": SimpleNamespace(debug=print, info=print, exception=print),
    "precise_sleep": time.sleep,
    "move_cursor_up": lambda lines: None,
    "print": lambda *words: None,
    "importlib": importlib,
}


def real(folder: Path, file: str, function: str) -> Any:
    """A function of lerobot's, from its source; what its module imports is not needed."""
    tree = ast.parse((folder / "lerobot" / file).read_text())
    [found] = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == function)
    for argument in found.args.args:
        argument.annotation = None
    names = dict(NAMES)
    exec(compile(ast.Module([found], []), file, "exec"), names)
    return names[function]


def loop(teleop: Any, robot: Any, fps: int, *_: Callable[[Any], Any]) -> None:
    while True:
        begin = time.perf_counter()
        robot.get_observation()
        robot.send_action(teleop.get_action())
        time.sleep(max(1 / fps - (time.perf_counter() - begin), 0.0))


def main(words: Sequence[str]) -> None:
    folder, teleop_words, robot_words = words
    importlib.import_module("lerobot_robot_wall")
    importlib.import_module("lerobot_teleoperator_forcebound")
    run = loop
    if folder:
        run = real(Path(folder), "scripts/lerobot_teleoperate.py", "teleop_loop")
    robot = make_robot_from_config(draccus.decode(RobotConfig, json.loads(robot_words)))
    leader = draccus.decode(TeleoperatorConfig, json.loads(teleop_words))
    teleop = make_teleoperator_from_config(leader)
    teleop.connect()
    robot.connect()
    try:
        with contextlib.suppress(KeyboardInterrupt):
            first, identity = (lambda both: both[0]), (lambda one: one)
            run(teleop, robot, FPS, first, first, identity)
    finally:
        teleop.disconnect()
        robot.disconnect()


if __name__ == "__main__":
    main(sys.argv[1:])
