"""Policies that come with the package: found by name, listed, each with its model card."""

import json
import re

import jax.random as jr
import numpy as np
import pytest

from salpchain.cli.main import run
from salpchain.controllers import released as module
from salpchain.controllers.policy import Policy, PolicyCard
from salpchain.controllers.storage import load, save_policy
from salpchain.errors import InputError
from salpchain.networks.actor_critic import actor_critic

CARD = {
    "about": "a small one", "command": "python -m studies.release.run tiny", "limits": "all",
    "licence": "Apache-2.0", "trials": 200, "training_lengths": [8], "steps": 1000, "minutes": 0.1,
    "seed": 2001, "time_limit": "scaled",
    "measured": [{"length": 8, "success": 0.985, "interval": [0.95, 0.99],
                  "closed_fraction": 0.97, "steps_to_goal": 93.5}],
}  # fmt: skip


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    """A package with one released policy."""
    card = PolicyCard(name="tiny")
    policy = Policy(actor_critic(jr.key(0), card.control, 22, 1, 8), card)
    save_policy(policy, tmp_path / "tiny.safetensors")
    (tmp_path / "tiny.json").write_text(json.dumps(CARD))
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    return policy


def test_a_released_policy_is_loaded_by_its_name(tiny, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path.parent)
    assert load("tiny").card == tiny.card
    np.testing.assert_array_equal(load("tiny").network.log_std, tiny.network.log_std)
    with pytest.raises(InputError, match=r"no such run folder or policy: tinny .* tiny"):
        load("tinny")


def test_a_card_with_a_suite_shows_a_row_for_each_trouble_and_grade(tiny, tmp_path, capsys):
    cells = [
        {"trouble": trouble, "grade": grade, "length": length, "success": share / length}
        for trouble, grade, share in (("still", "none", 4.0), ("dead", "hard", 1.0))
        for length in (4, 16)
    ]
    about = {"suite": "sea", "version": 1, "lengths": [4, 16], "trials": 40, "seed": 2001}
    (tmp_path / "tiny.json").write_text(json.dumps({**CARD, "suite": {**about, "cells": cells}}))
    assert run(["models", "tiny"]) == 0
    page = capsys.readouterr().out
    assert "suite sea, version 1: success % of 40 episodes in each cell, seed 2001" in page
    assert re.search(r"units +4 +16\n +still +100 +25\n +dead hard +25 +6\n?$", page)


def test_models_lists_it_and_shows_its_card(tiny, tmp_path, capsys):
    assert run(["models"]) == 0
    assert "tiny           a small one" in capsys.readouterr().out
    assert run(["models", "tiny"]) == 0
    page = capsys.readouterr().out
    assert (
        "made by: python -m studies.release.run tiny" in page
        and "98.5 [95, 99]      97.0           93.5" in page
    )
    assert "trained on: 8 units, 1,000 steps, 0.1 minutes" in page
    assert run(["models", "tinny"]) == 2
    assert "choose one of tiny" in capsys.readouterr().err
    for content in ("[1]", "{}", json.dumps({**CARD, "trials": None}).replace("trials", "tries")):
        (tmp_path / "tiny.json").write_text(content)
        assert run(["models", "tiny"]) == 2
        assert "tiny.json is damaged" in capsys.readouterr().err


def test_the_package_s_own_are_small_whole_and_have_cards():
    size = 0
    for name, path in module.released().items():
        card = module.model_card(name)
        assert CARD.keys() <= card.keys() and len(card["measured"]) >= 10
        assert load(name).card.name == name
        size += path.stat().st_size
    assert size < 4e6  # bytes; the repository stays small
