"""Names of topics and frames. ROS allows letters, digits and underscores."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

MAP: Final = "map"  # the world; its origin is the scenario's
TF: Final = "/tf"
DIAGNOSTICS: Final = "/diagnostics"


class ReceiverNames(NamedTuple):
    """The names for one receiver.

    `map`: the frame of its poses. `frame`: its own frame. `transmitter`: the prefix of the transmitters' frames, before
    their ids. The others are topics.
    """

    map: str
    frame: str
    transmitter: str
    arva: str
    pose: str
    reported_pose: str
    fix: str
    visualization: str


def names_of(receivers: Sequence[tuple[str, str]]) -> dict[tuple[str, str], ReceiverNames]:
    """Return the names for all receivers, by (vehicle, receiver). They have no prefix if there is only one receiver."""
    if len(receivers) < 2:
        return {of: _names("", MAP) for of in receivers or [("vehicle", "receiver")]}
    vehicles = unique([vehicle for vehicle, _ in receivers])
    prefixes = unique([f"{vehicles[vehicle]}/{receiver}" for vehicle, receiver in receivers])
    return {
        (vehicle, receiver): _names(f"{prefixes[f'{vehicles[vehicle]}/{receiver}']}/", f"{vehicles[vehicle]}/{MAP}")
        for vehicle, receiver in receivers
    }


def word(name: str) -> str:
    """Return a name for ROS: letters, digits and underscores, without a digit at the start."""
    allowed = re.sub("[^A-Za-z0-9_]", "_", name)
    return f"_{allowed}" if allowed[:1].isdigit() else allowed


def unique(names: Sequence[str]) -> dict[str, str]:
    """Return a different name for ROS for each name. Slashes are kept."""
    given: dict[str, str] = {}
    for name in dict.fromkeys(names):
        allowed = "/".join(map(word, name.split("/")))
        number, free = 2, allowed
        while free in given.values():
            free, number = f"{allowed}_{number}", number + 1
        given[name] = free
    return given


def _names(prefix: str, world: str) -> ReceiverNames:
    own = world.removesuffix(MAP)
    return ReceiverNames(
        world,
        f"{prefix}arva_receiver",
        f"{own}arva_data_",
        f"/{prefix}arva",
        f"/{prefix}arva/pose",
        f"/{prefix}arva/reported_pose",
        f"/{prefix}arva/fix",
        f"/{prefix}arva/visualization",
    )
