"""The server bears attacks. The long run is ``python -m tests.measure.attack``."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.measure.attack import ATTACKS, attack, is_bounded
from tests.scene import make_scene

SHARE = 0.02


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_attacks_are_borne_in_bounded_memory_and_the_app_still_answers(tmp_path: Path) -> None:
    (tmp_path / "files").mkdir()
    felt = attack(make_scene(tmp_path / "files"), tmp_path, SHARE, list(ATTACKS))
    assert felt.keys() == ATTACKS.keys()
    assert all(map(is_bounded, felt.values())), felt
