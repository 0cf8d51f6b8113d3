"""The verdict on a pose by its features, and by several photos."""

from dataclasses import replace

import numpy as np
import pytest

from poseviewer.confidence.verdict import (
    FOUND_FROM,
    LOST_BELOW,
    Features,
    Verdict,
    among,
    judge,
    judge_together,
    percent_right,
    reason_against,
)

RIGHT = Features(rival_margin=3.0, spread_percent=1.0, outline=0.95, seen=1.0)


def test_worse_features_are_less_probable_and_lost_in_the_end():
    assert judge(RIGHT).label == "found"
    worse = {"rival_margin": 0.1, "spread_percent": 20.0, "outline": 0.5}
    verdicts = [judge(replace(RIGHT, **{name: value})) for name, value in worse.items()]
    assert all(one.probability < judge(RIGHT).probability for one in verdicts)
    assert judge(replace(RIGHT, **worse)).label == "lost"
    assert judge(None).label == "lost"


def test_a_model_of_which_too_little_is_seen_is_lost():
    hidden = judge(replace(RIGHT, seen=0.3))
    assert hidden.label == "lost"
    assert any("Only 30 %" in reason for reason in hidden.reasons)
    assert judge(replace(RIGHT, seen=0.5)).label == "found"


def test_a_pose_is_the_less_probable_the_less_of_the_model_is_seen():
    weak = replace(RIGHT, outline=0.85, rival_margin=1.5)
    each = [judge(replace(weak, seen=share)) for share in (1.0, 0.8, 0.6, 0.4)]
    chances = [one.probability for one in each]
    assert chances == sorted(chances, reverse=True)
    assert (each[0].label, each[-1].label) == ("found", "lost")


@pytest.mark.parametrize(
    ("alike", "short", "said"),
    [
        (0.0, {"outline": 0.6}, "only 60 %"),
        (0.95, {"outline": 0.8}, "flat and of one colour"),
        (0.95, {"seen": 0.7}, "flat and of one colour"),
    ],
)
def test_a_steep_minimum_that_lacks_outline_is_not_found(alike: float, short, said: str):
    steep = replace(RIGHT, rival_margin=20.0, spread_percent=0.1, alike=alike)
    assert judge(steep).label == "found"
    poor = judge(replace(steep, **short))
    assert poor.label == "doubtful"
    assert any(said in reason for reason in poor.reasons)


@pytest.mark.parametrize("word", ["found", "doubtful", "lost"])
def test_word_and_number_of_a_verdict_never_contradict(word: str):
    """The number alone leads to its word, and is never sure."""
    said = {percent_right(word, probability) for probability in np.linspace(0.0, 1.0, 101)}
    assert max(said) < 100
    for number in (share / 100.0 for share in said):
        is_found, is_lost = number >= FOUND_FROM, number < LOST_BELOW
        assert ("found" if is_found else "lost" if is_lost else "doubtful") == word


@pytest.mark.parametrize(
    ("alone", "word"),
    [
        ([0.99, 0.99], "found"),
        ([0.01, 0.01, 0.01], "lost"),
        ([0.99, 0.01], "doubtful"),  # one contradicts the other
    ],
)
def test_several_photos_are_of_one_mind_or_it_is_doubtful(alone: list[float], word: str):
    verdict = judge_together([Verdict("found", one) for one in alone])
    assert verdict.label == word
    assert min(alone) - 1e-9 <= verdict.probability <= max(alone) + 1e-9
    assert len(verdict.views) == len(alone)


def test_photos_that_are_doubtful_alone_find_nothing_together():
    few_edges = [Verdict("doubtful", 0.95)] * 3
    assert judge_together([Verdict("found", 0.99), *few_edges]).label == "doubtful"
    assert judge_together([Verdict("found", 0.99)] * 3 + few_edges).label == "found"


def test_what_is_known_to_be_right_needs_no_more_edges_than_it_has():
    few = replace(RIGHT, outline=0.6)
    assert judge(few).label == "doubtful"
    assert judge(few, known_outline=0.68).label == "found"
    assert judge(few, known_outline=0.9).label == "doubtful"


@pytest.mark.parametrize(
    ("worse", "word"),
    [
        ({"spread_percent": 90.0}, "near by"),
        ({"rival_margin": -3.0}, "turned"),
        ({"outline": 0.1}, "outline"),
        ({"seen": 0.2}, "is seen"),
    ],
)
def test_the_reason_that_counted_is_named(worse: dict[str, float], word: str):
    assert word in reason_against(replace(RIGHT, **worse))


def test_the_more_tries_the_surer_an_end_must_be():
    once = Verdict("found", 0.94, ("A reason.",))
    assert among(once, 1).probability == pytest.approx(once.probability)
    twice, often = among(once, 2), among(once, 4)
    odds = [one.probability / (1.0 - one.probability) for one in (once, twice, often)]
    assert odds[1:] == pytest.approx([odds[0] / 2.0, odds[0] / 4.0])
    assert (twice.label, often.label) == ("found", "doubtful")
    assert often.reasons == once.reasons
    assert among(Verdict("found", 0.998), 4).label == "found"
    assert among(Verdict("doubtful", 0.94), 2).label == "doubtful"
    assert among(Verdict("lost", 0.0), 3) == Verdict("lost", 0.0)
    assert among(Verdict("doubtful", 0.6), 3).label == "lost"
