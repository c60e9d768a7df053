"""The programs in `studies/`, on little work."""

import numpy as np
import pandas as pd

from studies import transfer
from tests.interop.policies import fresh


def test_a_policy_swims_in_vmas_as_it_does_here_and_a_stopped_study_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(transfer, "step_limit", lambda *_: 12)
    monkeypatch.setattr(transfer, "LENGTHS", (3,))
    monkeypatch.setattr(transfer, "SETTINGS", {"nothing": transfer.SETTINGS["nothing"]})
    played = []

    def trials(policy, *part):
        played.append(part)
        rows = {"setting": ["nothing"], "length": 3, "trial": 0, "success": True}
        return pd.DataFrame({**rows, "closed_fraction": 0.9})

    monkeypatch.setattr(transfer, "with_changes", trials)
    for _ in range(2):
        transfer.study(fresh(), tmp_path, trials=4)
    assert played == [("nothing", 3, 4)]
    frame = pd.read_csv(tmp_path / "vmas.csv")
    assert len(frame) == 8
    there, here = (frame[frame.engine == name] for name in ("VMAS", "ours"))
    assert (there.success.to_numpy() == here.success.to_numpy()).all()
    np.testing.assert_allclose(there.closed_fraction, here.closed_fraction, atol=1e-3)
    assert there.closed_fraction.abs().max() > 0.01
    text = (tmp_path / "report.md").read_text()
    assert "| VMAS |" in text and "| nothing | 100.0 (90.0) |" in text
