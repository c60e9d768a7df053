"""What every test has: two devices, and Ctrl-C that can be sent to the programs it starts."""

import signal
from pathlib import Path

import jax
import pytest

# Sharing chains out over devices is part of what is tested.
jax.config.update("jax_num_cpu_devices", 2)
# Shells let what they start in the background ignore Ctrl-C, and so would all that tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Memory maps that a worker may hold before it forgets its programs: Linux allows 65,530.
MOST_MAPS = 8000


@pytest.fixture(scope="module", autouse=True)
def forget_programs():
    """Forget compiled programs after a file: each holds memory maps, and XLA crashes without."""
    yield
    maps = Path("/proc/self/maps")
    if not maps.exists() or len(maps.read_bytes().splitlines()) > MOST_MAPS:
        jax.clear_caches()


def forget_compiled():
    """What was compiled holds the old constants."""
    from salpchain.physics import batching  # not before its types are checked

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


# Files with long tests come first, so that the workers end together (with --no-loadscope-reorder).
LONG = ("test_study", "test_against_vmas", "test_resume", "test_devices", "test_laws", "test_ppo")
LONG += ("test_docs", "test_pages", "test_wheel")


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: LONG.index(name) if (name := item.path.stem) in LONG else len(LONG))
