"""Errors modulo the symmetry of a shape, where the turn is known."""

from __future__ import annotations

from tests.measure.symmetric import Ended, summary


def test_the_summary_tells_symmetric_shapes_from_others():
    turned = [
        Ended("hope", f"soup-{i}", "soup", 15, "every turn about (0, 0, 1)", "found", off, 0.4)
        for i, off in enumerate((0.5, 9.0))
    ]
    other = Ended("hope", "mustard", "mustard", 15, "", "lost", 3.0, 3.0)
    _, soup, near, others = summary([*turned, other]).splitlines()
    shares = ["50%", "50%", "50%", "2"], ["100%", "100%", "100%"]
    assert soup.split() == ["soup", "2", "4.75%", *shares[0], "0.40%", *shares[1]]
    assert near.split()[:4] == ["all", "nearly", "symmetric", "2"]
    one = ["3.00%", "0%", "0%", "100%"]
    assert others.split() == ["others", "1", *one, "0", *one]
