"""Fixtures of the tests of the physics."""

import jax
import pytest

from salpchain.physics import batching


def forget_compiled():
    """What was compiled holds the old constants."""
    jax.clear_caches()
    batching._for_one.cache_clear()
    batching._for_many.cache_clear()


@pytest.fixture
def recompiling(monkeypatch):
    """A function that sets a constant of a module for all that is compiled from now on."""

    def change(module, name, value):
        forget_compiled()
        monkeypatch.setattr(module, name, value)

    yield change
    monkeypatch.undo()
    forget_compiled()
