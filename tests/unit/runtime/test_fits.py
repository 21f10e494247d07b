"""Names and their patterns: `*` stands for any text, all other signs for themselves."""

import pytest

from drcmitsuba.runtime.toml import choose, fits


@pytest.mark.parametrize(
    ("name", "pattern", "is_meant"),
    [
        ("Office 1", "Office 1", True), ("Office 1", "Office [1]", False),
        ("Office [1]", "Office [1]", True), ("Office [1]", "Office*", True),
        ("Toilet?", "Toilet?", True), ("Toilets", "Toilet?", False), ("a.b", "a.b", True),
        ("axb", "a.b", False), ("two\nlines", "two*", True), ("A", "a", False),
        ("abab", "*ab*ab", True), ("aba", "ab*ba", False), ("abcbd", "a*b*d", True),
        ("ab", "a*b*b", False), ("a" * 60, "*a" * 6 + "*b", False), ("a*b", "a**b", True),
        ("glass pane 3", "*pane*", True), ("", "*", True), ("glass", "las", False),
    ],
)  # fmt: skip
def test_stars_alone_are_wild(name, pattern, is_meant):
    assert fits(name, ["other", pattern]) == is_meant


def test_names_are_told_as_they_are_typed():
    assert choose("x", ["Büro", "模型"]) == 'choose from: "Büro", "模型"'
