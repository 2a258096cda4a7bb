"""What the films of docs/gallery.md and the pictures of the live page show.

A launch file has one film, which has its name; what a hand follows is written down here in mm.
"""

from collections.abc import Sequence
from dataclasses import replace

from experiments.page import Take
from forcebound.messages.packets import Vector

MM = 1e-3  # m
TWO, ARMS = (640, 1000), (800, 500)  # windows for the states of two hands, for their dials
WHOLE = ("body", "body")


def way(*places: tuple[float, ...]) -> Sequence[tuple[float, Vector]]:
    """Return the moves of a pointer: each has a time, in s, and a place, in mm on each axis."""
    return [(seconds, tuple(MM * one for one in place)) for seconds, *place in places]


#: Out of the wall and into it; it lets go by itself once it is safe again.
INTO_WALL = {"hand": way((1, -5), (2, -28), (11, -28), (13, 18))}
FILMS = {
    "pointer_touch": Take(
        "pointer_touch",
        6.0,
        moves={
            "hand": way(
                (0.4, -10, 0, 0),
                (1.2, 12, 0, 0),
                (2.6, 14, 0, 20),
                (4, 12, -18, 12),
                (5.2, 12, 0, 0),
                (5.8, -10, 0, 0),
            )
        },
    ),
    "pointer_rabbit": Take(
        "pointer_rabbit",
        6.0,
        query="view=0.055,-0.22,0.32,0.028,0,0.008",
        moves={
            "hand": way(
                (0.4, -10, 0, 20),
                (1.4, 8, 0, -4),
                (2.2, 16, 0, 1),
                (3, 28, 0, 1),
                (3.6, 40, 0, 5),
                (4.2, 28, 0, 1),
                (4.8, 12, 0, -1),
                (5.8, -10, 0, 20),
            )
        },
    ),
    "touch_points": Take("touch_points", 5.0, query="view=0.06,1.9,1.05,0.02,0,0.01"),
    "pointer_membrane": Take(
        "pointer_membrane", 5.0, moves={"hand": way((0.4, -5), (3.2, 26), (4, 26), (4.8, -5))}
    ),
    "push_boxes": Take(
        "push_boxes", 4.0, ["approach_speed:=20 mm/s"], query="view=0.06,-0.5,0.5,0.04,0,0.01"
    ),
    "push_mass": Take("push_mass", 3.0, ["approach_speed:=30 mm/s"]),
    "pointer_two_hands": Take(
        "pointer_two_hands",
        6.0,
        window=TWO,
        moves={
            "left": way((0.4, -20), (1.4, -4), (2, -4), (3.2, 12), (3.8, 12), (5.6, -20)),
            "right": way((0.4, 20), (1.4, 4), (2, 4), (3.2, 20), (3.8, 20), (5.6, -12)),
        },
    ),
    "leader_follower_transfer": Take(
        "leader_follower_transfer", 3.0, ["approach_speed:=20 mm/s"], window=TWO
    ),
    "joint_arms": Take("joint_arms", 2.0, window=ARMS, shown=0.8),
    "hold_arm": Take(
        "hold_arm", 3.0, ["approach_speed:=20 mm/s"], query="view=0.1,-0.4,0.4,-0.04,0,0"
    ),
    "desktop_arm": Take(
        "desktop_arm", 2.5, ["approach_speed:=20 mm/s"], query="view=0.075,-0.6,0.35,0,0,0"
    ),
    "follow_path": Take("follow_path", 3.0, query="view=0.03,0,0.9,0.03,0.005,0"),
    "sliding_friction": Take("sliding_friction", 4.0, query="view=0.045,-0.7,0.4,0.005,0,0"),
    "palpation": Take("palpation", 3.0),
    "far_wall": Take("far_wall", 3.0, ["approach_speed:=60 mm/s"]),
}
README = Take(
    "pointer_wall",
    26.5,
    begin=10.5,
    moves=INTO_WALL,
    presses=[(15, "break"), (20, "safe")],
    part=WHOLE,
    window=(1120, 680),
    shown=0.8,
)
LARGE = (1400, 1000)
_PRESSED = Take(
    "pointer_wall",
    14.0,
    moves={"hand": way((0.2, -5), (1, 18))},
    presses=[(5, "break"), (11, "safe")],
    part=WHOLE,
    window=LARGE,
)
_RABBIT, _BOX = FILMS["pointer_rabbit"], FILMS["pointer_two_hands"]
PICTURES = {
    "live-page-phone": replace(
        _PRESSED, part=("body", ".plots"), window=(390, 844), shown=1.5, is_phone=True
    ),
    "live-page-touch": replace(
        _RABBIT, seconds=2.8, query="", part=WHOLE, window=LARGE, is_dark=True
    ),
    "two-hands-page": replace(_BOX, seconds=2.0, part=WHOLE, window=LARGE),
}
