"""Names of files and keys in messages: some of them, and short."""

import pytest

from fitting_core.errors import InputError, some_of

NAMED = {
    (): "nothing",
    ("a",): "a",
    ("a", 3, None): "a, 3, None",
    tuple("abcdefgh"): "a, b, c, d, e, f, g, h",
    tuple("abcdefghij"): "a, b, c, d, e, f, g, h and 2 more",
    ("x" * 41,): "x" * 37 + "...",
    ("a\nb\x1b[2J", "\udcff"): "a?b?[2J, ?",
}


@pytest.mark.parametrize("names", NAMED)
def test_some_of_them(names: tuple):
    assert some_of(names) == NAMED[names]
    assert some_of(iter(names)) == NAMED[names]


def test_a_message_stays_short():
    assert len(some_of(f"{k}{'x' * 1000}" for k in range(5000))) < 400


def test_a_message_does_not_control_the_terminal():
    """Names of files and of a model's inputs may hold escape sequences, or reverse the text after them."""
    error = InputError("\x1b]0;title\x07 \x9b2J \u202egpj.exe:\r\n\tis größer")
    assert str(error) == "?]0;title? ?2J ?gpj.exe:?\n\tis größer"
