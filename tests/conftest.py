"""What every test has: two devices, and Ctrl-C that can be sent to the programs it starts."""

import signal

import jax

# Sharing chains out over devices is part of what is tested.
jax.config.update("jax_num_cpu_devices", 2)
# Shells let what they start in the background ignore Ctrl-C, and so would all that tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Files with long tests come first, so that the workers end together (with --no-loadscope-reorder).
LONG = ("test_study", "test_against_vmas", "test_resume", "test_devices", "test_laws", "test_ppo")
LONG += ("test_docs", "test_pages", "test_wheel")


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: LONG.index(name) if (name := item.path.stem) in LONG else len(LONG))
