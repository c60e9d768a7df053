"""The pictures of architecture.md: `python docs/draw.py` draws them into docs/images.

The layers are drawn from the imports as they are; each place on the way of an action must exist.
"""

import ast
import re
import sys
from collections import Counter
from importlib import import_module
from operator import attrgetter
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

HERE = Path(__file__).parent
PACKAGE = HERE.parent / "salpchain"
SEA, DEEP, PALE, SUN = "#e8f4f6", "#0b3c49", "#7fb6c2", "#e4572e"
GROUND = "ground floor"

# What happens in one control step: the place in the code, and what it does there.
WAY = [
    ("salpchain.controllers.policy:Policy.act", "observations in, an action for each unit out"),
    ("salpchain.tasks.task:Task.step", "one control step (0.1 s); all below happens in it"),
    ("salpchain.world.sensing:Sensing.given", "delay: the action that arrives now"),
    ("salpchain.tasks.task:Task.thrust", "from the action to newtons"),
    ("salpchain.world.thrusters:Thrusters.thrust", "gain, lag, dead thrusters"),
    ("salpchain.world.world:World.step", "current, walls and posts"),
    ("salpchain.physics.chain:step", "one chain, vmapped into one call for the batch"),
    ("salpchain.physics.broadphase:far_pairs", "which units may touch"),
    ("salpchain.physics.substeps:run_substeps", "joints, drag, contact, semi-implicit Euler"),
    ("salpchain.tasks.task:Task.move", "where the target is now"),
    ("salpchain.tasks.task:Task.judge", "the terms of the reward, and whether it ends"),
    ("salpchain.world.world:World.advance", "the water changes"),
    ("salpchain.tasks.observations:observe", "what each unit sees, in its own frame"),
]


def rooms():
    """The rooms from bottom to top, as the table of architecture.md has them."""
    text = (HERE / "architecture.md").read_text(encoding="utf-8")
    return re.findall(r"^\| `(\w+)/` \|", text, re.MULTILINE)


def imports(order):
    """How many modules of one room import another, by (importing, imported)."""
    found = Counter()
    for path in sorted(PACKAGE.rglob("*.py")):
        room = path.relative_to(PACKAGE).parts[0]
        if room not in order:
            continue
        names = [
            node.module
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("salpchain.")
        ]
        others = {name.split(".")[1] for name in names}
        found.update((room, other if other in order else GROUND) for other in others)
    return {pair: number for pair, number in found.items() if len(set(pair)) == 2}


def box(axes, x, y, width, height, colour=SEA):
    style = {"boxstyle": "round,pad=0,rounding_size=0.12", "linewidth": 1}
    axes.add_patch(FancyBboxPatch((x, y), width, height, fc=colour, ec=DEEP, **style))


def sheet(width, height):
    figure, axes = plt.subplots(figsize=(width, height))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis("off")
    figure.subplots_adjust(0, 0, 1, 1)
    return figure, axes


def layers():
    """Each room a box; an arc for each room that it imports, to the right, wider the more do."""
    order = [GROUND, *rooms()]
    figure, axes = sheet(9, 0.5 * len(order) + 0.4)
    level = {name: 0.3 + 0.5 * i for i, name in enumerate(order)}
    files = Counter(path.relative_to(PACKAGE).parts[0] for path in PACKAGE.rglob("*.py"))
    files[GROUND] = sum(path.name != "__init__.py" for path in PACKAGE.glob("*.py"))
    for name, y in level.items():
        box(axes, 0.3, y, 3.2, 0.34, SEA if name != GROUND else "#f3eee2")
        label = name if name == GROUND else f"{name}/"
        axes.text(0.45, y + 0.17, label, va="center", color=DEEP, family="monospace")
        axes.text(3.35, y + 0.17, f"{files[name]} files", va="center", ha="right", color=PALE)
    pairs = imports(order[1:])
    for (above, below), number in sorted(pairs.items(), key=lambda item: -item[1]):
        ends = (3.55, level[above] + 0.17), (3.55, level[below] + 0.17)
        upward = level[below] > level[above]
        arrow = FancyArrowPatch(
            *ends,
            connectionstyle=f"arc3,rad={-0.75 if not upward else 0.75}",
            arrowstyle="-|>,head_length=4,head_width=2",
            color=SUN if upward else DEEP,
            alpha=1.0 if upward else min(0.9, 0.18 + 0.05 * number),
            linewidth=0.5 + 0.12 * number,
        )
        axes.add_patch(arrow)
    said = "an arc: modules of the upper room\nimport from the lower one;\nthe wider, the more do"
    axes.text(8.8, 0.5 * len(order) + 0.1, said, ha="right", va="top", color=DEEP)
    figure.savefig(HERE / "images" / "layers.png", dpi=90)


def way():
    """The places that an action passes, one below the other, and back to the next observation."""
    figure, axes = sheet(9, 0.5 * len(WAY) + 0.4)
    height = 0.5 * len(WAY)
    for i, (place, said) in enumerate(WAY):
        module, _, name = place.partition(":")
        attrgetter(name)(import_module(module))  # it must be there
        y = height - 0.5 * i - 0.2
        inset = 0.0 if i < 2 else 0.9 if module.startswith("salpchain.physics") else 0.45
        box(axes, 0.6 + inset, y, 4.9 - inset, 0.34)
        short = f"{module.removeprefix('salpchain.').replace('.', '/')}.py"
        text = f"{short}  {name}"
        axes.text(0.72 + inset, y + 0.17, text, va="center", color=DEEP, family="monospace", size=8)
        axes.text(5.65, y + 0.17, said, va="center", color=DEEP, size=9)
        if i:
            arrow = {"arrowstyle": "-|>,head_length=3,head_width=2", "color": PALE}
            axes.add_patch(FancyArrowPatch((2.9, y + 0.5), (2.9, y + 0.34), **arrow))
    back = "arc3,rad=-0.12"
    bottom, top = height - 0.5 * (len(WAY) - 1), height
    arrow = {"arrowstyle": "-|>,head_length=5,head_width=3", "connectionstyle": back, "color": SUN}
    axes.add_patch(FancyArrowPatch((0.98, bottom), (0.58, top), **arrow))
    figure.savefig(HERE / "images" / "action.png", dpi=90)


if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    layers()
    way()
