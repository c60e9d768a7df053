"""What an exported policy says of itself."""

import json

from salpchain.controllers.policy import PolicyCard
from salpchain.tasks.features import ACTIONS, CONTROL_STEP, as_rows


def metadata(card: PolicyCard) -> dict[str, str]:
    """What one must know to run the policy; lists and tables as JSON."""
    single = card.control.model == "mlp"
    return {
        "name": card.name,
        "model": card.control.model,
        "graph": card.control.graph,
        "improved": json.dumps(card.control.improved),
        "depth": str(card.control.depth),
        "training_lengths": json.dumps(card.lengths or (card.length,)),
        "serves_units": str(card.length) if single else "any",
        "observation": card.observation,
        "observation_layout": json.dumps(as_rows(card.observation)),
        "action": card.action,
        "action_meaning": ACTIONS[card.action],
        "thrust_unit": "N along the unit's heading (its angle + 90 degrees)",
        "control_step_seconds": str(CONTROL_STEP),
    }
