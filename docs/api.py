"""The page api.md: `python docs/api.py` writes it from the code's own signatures and docstrings."""

import ast
import inspect
import sys
import textwrap
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent

SECTIONS = {
    "Train": "train resume preset TrainConfig PPOConfig Mix ControlConfig new_learner iterate"
    " Learner",
    "Evaluate and record": "evaluate run_suite record Trajectory",
    "Controllers": "load save_policy Policy PolicyCard Controller Greedy Approach MPC steering"
    " identity",
    "Tasks": "SCLD TaskConfig FollowConfig Task State Start Judgement make_task renew_done",
    "Observations": "OBSERVATIONS Feature scalar_feature vector_feature",
    "Worlds": "WorldConfig DynamicsConfig CurrentConfig ThrusterConfig SensingConfig"
    " ObstacleConfig Range World",
    "Chains": "Chain Bodies Physics",
    "Other": "InputError use_cache",
}
INTRODUCTION = """# Public names

All of `salpchain` that programs may rely on, written by `python docs/api.py` from the docstrings.
What is wrong with an argument is told by an `InputError` in one line. Shapes are those of one
chain: `jax.vmap` adds an axis for a batch.
"""


def page() -> str:
    """The whole page."""
    parts = [INTRODUCTION]
    for title, names in SECTIONS.items():
        parts.append(f"## {title}\n")
        parts += [entry(name) for name in names.split()]
    return "\n".join(parts)


def entry(name: str) -> str:
    """A public name: its signature, what its docstring says, its fields and methods."""
    import salpchain

    thing: Any = getattr(salpchain, name)
    if not (inspect.isclass(thing) or inspect.isfunction(thing)):
        keys = ", ".join(f"`{key}`" for key in thing)
        return f"### {name}\n\nA table by name: {keys}.\n"
    source = textwrap.dedent(inspect.getsource(inspect.unwrap(thing)))
    constants = vars(sys.modules[inspect.unwrap(thing).__module__])
    node = Valued(constants).visit(ast.parse(source).body[0])
    said = prose(inspect.cleandoc(ast.get_docstring(node) or ""))
    if isinstance(node, ast.ClassDef):
        return "\n".join([f"### {name}\n", said, *fields(node, source), *methods(node)])
    return f"### {name}\n\n{code(signature(name, node))}\n{said}"


class Valued(ast.NodeTransformer):
    """Puts the numbers and texts of constants in the place of their names."""

    def __init__(self, constants: dict[str, Any]) -> None:
        self.constants = constants

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """The value of a constant; any other name as it is."""
        value = self.constants.get(node.id)
        if node.id.isupper() and isinstance(value, int | float | str):
            return ast.copy_location(ast.Constant(value), node)
        return node


def code(text: str) -> str:
    """A block that is shown, not run."""
    return f"```text\n{text}\n```\n"


def signature(name: str, node: Any) -> str:
    """As in the source; an argument on each line where it would be long."""
    given = ast.unparse(node.args)
    after = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    line = f"{name}({given}){after}"
    if len(line) <= 100:
        return line
    return f"{name}(\n" + "".join(f"    {one},\n" for one in apart(given)) + f"){after}"


def apart(arguments: str) -> list[str]:
    """Arguments one by one: those between commas that are in no bracket."""
    depth, parts = 0, [""]
    for letter in arguments:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and not depth:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def prose(doc: str) -> str:
    """A docstring as text, what it raises as one paragraph."""
    text, _, raises = doc.partition("Raises:\n")
    if raises:
        text += "Raises " + " ".join(raises.split()) + "\n"
    return text.strip() + "\n"


def fields(node: ast.ClassDef, source: str) -> list[str]:
    """A table of the fields: type, default, and the comment beside it."""
    lines, rows = source.splitlines(), []
    for one in node.body:
        if not isinstance(one, ast.AnnAssign) or ast.unparse(one.target).startswith("_"):
            continue
        _, _, comment = lines[(one.end_lineno or 1) - 1][one.end_col_offset :].partition("#")
        value = "" if one.value is None else plain(one.value)
        value = f" = {value}" if value else ""
        kind = ast.unparse(one.annotation).replace("'", "").replace("|", "\\|")
        said = comment.partition(" # ")[0].strip().replace("|", "\\|")
        rows.append(f"| `{ast.unparse(one.target)}: {kind}{value}` | {said} |")
    return ["| field | |\n| --- | --- |", *rows, ""] if rows else []


def plain(value: ast.expr) -> str:
    """A default as one would give it; empty if a field has none."""
    if not (isinstance(value, ast.Call) and ast.unparse(value.func).endswith("field")):
        return ast.unparse(value)
    given = {word.arg: ast.unparse(word.value) for word in value.keywords}
    made = given.get("default_factory")
    return f"{made}()" if made else given.get("default", "")


def methods(node: ast.ClassDef) -> list[str]:
    """The public methods and properties, each with its first sentence."""
    rows = []
    for one in node.body:
        if not isinstance(one, ast.FunctionDef) or one.name.startswith("_"):
            continue
        is_property = any(ast.unparse(mark) == "property" for mark in one.decorator_list)
        given = [arg.arg for arg in (*one.args.args, *one.args.kwonlyargs)]
        words = ", ".join(word for word in given if word not in ("self", "cls"))
        called = one.name if is_property else f"{one.name}({words})"
        said = " ".join((ast.get_docstring(one) or "").partition("\n\n")[0].split())
        rows.append(f"- `{called}`: {said}")
    return [*rows, ""] if rows else []


if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    (HERE / "api.md").write_text(page(), encoding="utf-8")
