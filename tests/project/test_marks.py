"""Marks of tests and the list of slow ones follow the tests that they name."""


def test_what_is_named_as_slow_or_quick_is_there(stale_names):
    assert stale_names == []
