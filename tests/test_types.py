"""What an editor or a type checker sees of the package."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import salpchain

ROOT = Path(__file__).parent.parent
PROGRAM = ROOT / "tests" / "every_name.py"
# Summaries are JSON, as in their files; NumPy's arrays leave their shape open; the rows of a
# feature are arrays of JAX or tensors of PyTorch.
KNOWN = re.compile(
    r"dict\[str, Any\]|ndarray\[tuple\[Any, \.\.\.\], dtype\[Any\]\]"
    r"|\(View\) -> (Any|tuple\[Any, Any\])"
)


def checked(folder, program):
    """What pyright says of a program, in its strictest mode, with this package beside it."""
    (folder / "program.py").write_text(program)
    settings = {"include": ["program.py"], "extraPaths": [str(ROOT)], "pythonVersion": "3.11"}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings))
    words = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--outputjson"]
    done = subprocess.run([*words, "-p", str(folder)], capture_output=True, text=True, check=False)
    return json.loads(done.stdout)["generalDiagnostics"]


def test_pyright_knows_the_type_of_every_public_name(tmp_path):
    program = PROGRAM.read_text()
    used = set(re.findall(r"salpchain\.(\w+)", program))
    assert used == set(salpchain.__all__)
    every = "".join(f"reveal_type(salpchain.{name})\n" for name in salpchain.__all__)
    said = checked(tmp_path, program + every)
    errors = [one for one in said if one["severity"] != "information"]
    assert errors == []
    told = [one["message"] for one in said if one["message"].startswith("Type of")]
    assert len(told) == program.count("reveal_type(") + len(salpchain.__all__)
    vague = [one for one in told if re.search(r"\b(Any|Unknown)\b", KNOWN.sub("", one))]
    assert vague == []


def test_the_package_says_that_it_is_typed():
    assert (ROOT / "salpchain" / "py.typed").is_file()


def test_type_checkers_see_the_names_that_there_are():
    """The names are written twice, for the lazy import and for type checkers: once would be Any."""
    seen = {}
    for node in ast.walk(ast.parse((ROOT / "salpchain" / "__init__.py").read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("salpchain."):
            seen |= {alias.asname: node.module for alias in node.names}
    assert seen == salpchain._PUBLIC
