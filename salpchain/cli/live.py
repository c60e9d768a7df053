"""`salpchain live`."""

import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from salpchain.checks import check_seed
from salpchain.cli.options import Folder, Whole, World, number, text_option
from salpchain.cli.settings import Sets, changed_world
from salpchain.cli.streams import say
from salpchain.controllers.named import check_live, check_there, is_name, is_own
from salpchain.controllers.released import PAPER_DYNAMICS, dynamics_of, released
from salpchain.errors import InputError
from salpchain.files import read_arrays
from salpchain.installation import install_command
from salpchain.starting import check_can_compute
from salpchain.world.presets import world_config

POLICY_FILE = "policy.safetensors"  # as in control.storage, which imports JAX
LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Live:
    """Steer a chain yourself in the browser, while it swims.

    Drag the target, draw one by hand, change the length, cut links, push units, switch policies,
    record it all and replay it: the page says how, on a phone, too. Only this machine can open it
    unless you give another --host. Needs the extra `live`; where it is missing, the error names
    the command that installs it.

    With --world there are walls, currents or broken thrusters in the water: a world is drawn when
    the page starts and anew at each Reset, its walls and posts clear of the chain and its target.

    Example: salpchain live runs/eight --world room
    """

    policy: tyro.conf.Positional[Annotated[str, text_option("RUN_OR_POLICY")]] = ""
    """A run folder, a policy.safetensors, a name that `salpchain models` lists (but mpc), or a
    controller of your own as module:Class.
    A name wins over a folder that is called so: write ./NAME for the folder.
    Default: any-water where it is released, else any-length, a run, or approach."""
    port: Whole = "8000"
    """Where the page is; 0 takes any free port."""
    host: Annotated[str, text_option("ADDRESS")] = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets other machines in, without any password."""
    runs: Folder = "runs"
    """Folder whose runs the page offers; it may be missing."""
    allow_origin: Annotated[str, text_option("ORIGIN[,ORIGIN...]")] = ""
    """Where a reverse proxy shows the page, such as https://lab.example.org (no path).
    Default: only the address that the terminal shows may connect."""
    world: World = "still"
    set: Sets = ()
    """Any number of the world, such as world.current.speed=0:0.08; may be given several times.
    docs/settings.md lists them."""
    seed: Whole = "0"
    """Seed of the random targets and worlds."""


def run(options: Live) -> None:
    """Serves the page until interrupted."""
    port, seed = number("port", options.port), check_seed(number("seed", options.seed))
    if not 0 <= port < 65536:
        raise InputError(f"--port must be 0 to 65535, got {port}")
    world = changed_world(world_config(options.world), options.set)
    if world.dynamics.kind != "vmas":
        raise InputError(
            f"the live page shows the paper's chains, not those of {world.dynamics.kind}: leave"
            " world.dynamics.kind out"
        )
    origins = _origins(options.allow_origin)
    _check_policy(options.policy)
    try:
        from salpchain.web import server
    except ImportError as error:
        raise InputError(
            f"the live page needs {error.name}: run {install_command('live')}"
        ) from None
    check_can_compute()
    bound = server.listen(options.host, port)
    with bound:
        _say_where(options.host, bound.getsockname()[1])
        say("compiling: the page shows the chain as soon as it swims")
        for origin in sorted(origins):
            print(f"  a proxy may show it under {origin}", flush=True)
        live = server.Live(options.policy, options.runs, seed, world)
        server.serve(live, frozenset(_names(options.host)), origins, bound)


def _origins(text: str) -> frozenset[str]:
    from salpchain.web.guard import checked_origin

    return frozenset(checked_origin(part.strip()) for part in text.split(",") if text)


def _check_policy(policy: str) -> None:
    """Raise InputError unless such a policy can steer; before a port is taken or JAX imported."""
    check_live(policy)
    if policy in released() and dynamics_of(policy) != PAPER_DYNAMICS:
        raise InputError(
            f"{policy} is for chains of {dynamics_of(policy)}, the live page shows the paper's:"
            " name another policy, or watch it with salpchain replay"
        )
    if not policy or is_name(policy) or is_own(policy):
        return
    check_there(policy)
    path = Path(policy)
    if path.is_dir() and not (path / POLICY_FILE).exists():
        raise InputError(f"{policy} is not a run folder with a policy: it has no {POLICY_FILE}")
    read_arrays(path / POLICY_FILE if path.is_dir() else path, "policy", 1)


def _say_where(host: str, port: int) -> None:
    shown = "127.0.0.1" if host in ("0.0.0.0", "::", *LOOPBACK) else host
    shown = f"[{shown}]" if ":" in shown else shown
    print(f"salpchain live: open http://{shown}:{port} in a browser (Ctrl-C ends)", flush=True)
    if host not in LOOPBACK:
        print("  other machines can open it too, without a password", flush=True)


def _names(host: str) -> set[str]:
    """Host names under which the page may be opened."""
    return {host.lower()} if host in LOOPBACK else {host.lower(), socket.gethostname().lower()}
