"""Two devices for every test: sharing chains out over devices is part of what is tested."""

import jax

jax.config.update("jax_num_cpu_devices", 2)
