"""A short run of what tools/fuzz/autopilot.py does ten million times."""

from __future__ import annotations

import random

import pytest

from tools.fuzz.autopilot import BURST, KEY, Bench, Enemy


@pytest.mark.parametrize("key", [None, KEY])
def test_nothing_hostile_is_believed(key: bytes | None) -> None:
    bench = Bench(random.Random(7), key)
    enemy = Enemy(bench.numbers, bench.past, signing=key is not None)
    for _ in range(10):
        bench.hear(b"".join(enemy(bench.boot) for _ in range(BURST)))
        bench.fly()
    assert not bench.wrong
    assert len(enemy.made) == len(enemy.kinds)
    counts = bench.session.counts()
    ignored = ["packets_incompatible", "bad_checksums"]
    ignored += (
        ["packets_forged", "packets_unsigned", "packets_replayed"]
        if key
        else ["packets_ignored", "stray_times", "stray_positions"]
    )
    assert all(counts[name] > 100 for name in ignored)


def test_a_lie_that_is_believed_is_noticed() -> None:
    """Without a key, who says just what the vehicle might say is believed."""
    bench = Bench(random.Random(7), None)
    bench.hear(Enemy(bench.numbers, bench.past, signing=False).unsigned(bench.boot))
    assert bench.wrong["believed others"] == 1
