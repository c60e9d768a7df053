"""What is missing is named with the one command that installs it, bridge by bridge."""

import json
import subprocess
import sys

import pytest

from salpchain.errors import InputError
from salpchain.installation import install_command
from salpchain.interop.extras import need

EXTRAS = {
    "salpchain.interop.gymnasium": ("gymnasium", "gymnasium"),
    "salpchain.interop.stable_baselines3": ("stable_baselines3", "stable-baselines3"),
    "salpchain.interop.pettingzoo": ("pettingzoo", "pettingzoo"),
    "salpchain.interop.brax": ("brax", "brax"),
    "salpchain.interop.onnx": ("onnx", "onnx"),
    "salpchain.interop.network": ("torch", "torch"),
}

# Without the optional packages: each bridge's error, by its module.
PROGRAM = """
import importlib, json, sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name in {packages}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
said = {{}}
for bridge in {bridges}:
    try:
        importlib.import_module(bridge)
    except ValueError as error:
        said[bridge] = str(error)
print(json.dumps(said))
"""


def test_every_bridge_names_the_command_for_what_is_missing():
    packages = sorted({package for package, _ in EXTRAS.values()})
    code = PROGRAM.format(packages=packages, bridges=list(EXTRAS))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == {
        bridge: f"{package} is not installed: run {install_command(extra)}"
        for bridge, (package, extra) in EXTRAS.items()
    }


def test_a_package_that_is_broken_in_itself_is_not_called_missing(tmp_path, monkeypatch):
    (tmp_path / "salpfish.py").write_text("import salpwater\n")
    (tmp_path / "salpbroken").mkdir()
    (tmp_path / "salpbroken" / "__init__.py").write_text("import salpbroken.part\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match="salpfish needs salpwater, which is not installed"):
        need("salpfish", "fish")
    with pytest.raises(ModuleNotFoundError, match=r"salpbroken\.part"):
        need("salpbroken", "broken")
    with pytest.raises(InputError, match="salpfowl is not installed"):
        need("salpfowl.envs", "fowl")
